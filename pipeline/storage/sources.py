"""What there is to analyse: files in folders and behind URLs, each once, whatever links and copies lie about."""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import BufferedIOBase
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from core.lazy import lazy
from pipeline.names import file_name, is_url
from pipeline.results.fleet import LogFailure
from pipeline.storage.store import as_os_error

if TYPE_CHECKING:
    import fsspec
else:
    fsspec = lazy("fsspec")

#: Endings that promise a flight log: a file found in a folder is reported as failed only if it has one of them.
LOG_SUFFIXES = frozenset({".bin", ".log", ".tlog", ".ulg", ".raw"})


@dataclass(frozen=True, slots=True)
class Source:
    """A file that may be a log."""

    url: str  #: Absolute path, or URL.
    named: bool  #: Named by the user; not merely found in a folder.
    size: int  #: Bytes.
    #: When it was written last, ns, or what else its storage marks versions with: with the size it tells, without
    #: reading the file, that it is the one of last time.
    modified: int | str

    @property
    def file(self) -> str:
        """The file's name, without its folder."""
        return file_name(self.url)

    @property
    def called_a_log(self) -> bool:
        """Whether its ending promises a log, packed (``flight.bin.gz``) or not."""
        return called_a_log(self.file)


def called_a_log(file: str) -> bool:
    """Return whether the ending of a file promises a log, packed (``flight.bin.gz``) or not."""
    name = PurePosixPath(file)
    if name.suffix.lower() in (".gz", ".zip"):
        name = PurePosixPath(name.stem)
    return name.suffix.lower() in LOG_SUFFIXES


@dataclass(frozen=True, slots=True)
class FoundFiles:
    """Files to look into, those that cannot be opened, and what else was passed over, with reasons."""

    sources: tuple[Source, ...]
    failures: tuple[LogFailure, ...]
    passed_over: tuple[LogFailure, ...]


def find(places: Iterable[str | Path], exclude: Path | None = None) -> FoundFiles:
    """List the files in places given by the user, each once, except in the folder that results go to."""
    search = _Search(exclude)
    for place in places:
        before = search.count
        if is_url(place):
            search.remote(str(place))
        else:
            search.local(Path(place).absolute())
        if search.count == before:
            search.passed_over.append(LogFailure(str(place), "holds no further files"))
    return FoundFiles(tuple(search.sources.values()), tuple(search.failures), tuple(search.passed_over))


class _Search:
    """What was found so far."""

    def __init__(self, exclude: Path | None) -> None:
        self.sources: dict[str, Source] = {}
        self.failures: list[LogFailure] = []
        self.passed_over: list[LogFailure] = []
        self._exclude = exclude
        #: Folders that were searched, by device and inode: links may lead back to them.
        self._seen: set[tuple[int, int]] = set()

    @property
    def count(self) -> int:
        return len(self.sources) + len(self.failures) + len(self.passed_over)

    def local(self, place: Path) -> None:
        """Search a folder with what it links to, or take a file that the user named."""
        if not place.is_dir():
            self._file(place, named=True)
            return
        for folder, folders, files in os.walk(place, onerror=self._closed, followlinks=True):
            if not self._enter(Path(folder)):
                folders.clear()
                continue
            folders[:] = sorted(name for name in folders if not name.startswith("."))
            for name in sorted(files):
                if not name.startswith("."):
                    self._file(Path(folder, name), named=False)

    def _enter(self, folder: Path) -> bool:
        """Return whether a folder is to be searched: it is new, and not where results go."""
        try:
            status = folder.stat()
            results = self._exclude is not None and self._exclude.exists() and self._exclude.samefile(folder)
        except OSError as error:
            self._closed(error)
            return False
        known = (status.st_dev, status.st_ino) in self._seen
        self._seen.add((status.st_dev, status.st_ino))
        return not known and not results

    def _file(self, path: Path, *, named: bool) -> None:
        url = str(path)
        if url in self.sources:
            return
        try:
            status = path.stat()
        except OSError as error:
            reason = "a link to nothing" if path.is_symlink() else f"cannot be opened: {error.strerror}"
            self._unusable(url, reason, named)
            return
        if stat.S_ISREG(status.st_mode):
            self.sources[url] = Source(url, named, status.st_size, status.st_mtime_ns)
        else:
            self._unusable(url, "neither a file nor a folder", named)

    def _unusable(self, url: str, reason: str, named: bool) -> None:
        (self.failures if named else self.passed_over).append(LogFailure(url, reason))

    def _closed(self, error: OSError) -> None:
        self.passed_over.append(LogFailure(str(error.filename), f"cannot be opened: {error.strerror}"))

    def remote(self, url: str) -> None:
        """Search what fsspec lists below a URL, or take the file that it names."""
        try:
            with as_os_error():
                files, root = fsspec.url_to_fs(url)
                # Over HTTP a page with links would pass for a folder.
                folder = not url.startswith(("http:", "https:")) and files.isdir(root)
                listing: dict[str, Any] = files.find(root, detail=True) if folder else {root: files.info(root)}
        except OSError as error:
            self._unusable(url, f"cannot be opened: {error.strerror or error}", named=True)
            return
        for path, facts in sorted(listing.items()):
            inner = PurePosixPath(path).relative_to(root).parts if folder else ()
            if any(part.startswith(".") for part in inner):
                continue
            name = files.unstrip_protocol(path)
            marks = (facts.get(mark) for mark in ("ETag", "etag", "mtime", "LastModified", "created"))
            modified = next((str(mark) for mark in marks if mark is not None), "")
            self.sources.setdefault(name, Source(name, not folder, int(facts.get("size") or 0), modified))


def digest(url: str) -> str:
    """Return the SHA-256 of a file's content, or raise OSError."""
    with opened(url) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@contextmanager
def opened(url: str) -> Iterator[BufferedIOBase]:
    """Open a file by path or URL for reading; OSError whatever its storage calls that."""
    if not is_url(url):
        with Path(url).open("rb") as file:
            yield file
        return
    with as_os_error(), fsspec.open(url, "rb") as remote:
        yield remote


@contextmanager
def fetched(url: str) -> Iterator[Path]:
    """Make a file on a disk of this computer for the time of a ``with``; OSError where it cannot be had."""
    if not is_url(url):
        yield Path(url)
        return
    with TemporaryDirectory(prefix="rotorid-") as scratch:
        target = Path(scratch, PurePosixPath(urlsplit(url).path).name or "log")
        with as_os_error():
            files, path = fsspec.url_to_fs(url)
            files.get_file(path, str(target))
        yield target
