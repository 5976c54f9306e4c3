"""Where the bytes of logs and results are kept: a folder, or whatever else fsspec reaches by a URL, such as s3://.

An object is never seen half-written: in a folder it arrives under another name, is synced and then renamed; S3 shows an
object only when it is complete. Names are made of ids and of our own file names, never of what a user sent.
"""

import errno
import shutil
from collections.abc import Iterator
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path, PurePosixPath
from typing import NamedTuple
from urllib.parse import urlsplit

import fsspec

from api.store.ids import new_id
from pipeline.storage.store import as_os_error, sync

#: How the name of an object that is still being written ends.
_PARTIAL = ".partial"


class Object(NamedTuple):
    """One object of a listing."""

    key: str
    written: datetime


class Objects:
    """Objects by key, such as ``logs/5f0c...`` or ``analyses/0a1b.../7c2e.../report.html``."""

    def __init__(self, url: str) -> None:
        self.url = url
        self._files, root = fsspec.url_to_fs(url)
        self._root = PurePosixPath(root)
        #: The folder itself, where it is one on this computer.
        self.folder = Path(root) if urlsplit(url).scheme in ("", "file") else None

    def prepare(self) -> None:
        """Make sure that objects can be written; OSError, or what the storage says, where they cannot."""
        probe = str(self._root / f"{new_id()}{_PARTIAL}")  # others may probe at the same time
        with as_os_error():
            self._files.makedirs(str(self._root), exist_ok=True)
            try:
                self._files.pipe_file(probe, b"probe")
            finally:  # a full disk takes the name and refuses the bytes
                with suppress(FileNotFoundError):
                    self._files.rm_file(probe)

    def put(self, source: Path, key: str) -> None:
        """Keep a file, which is on a disk and synced, under `key`; in a folder on the same disk it moves."""
        if self.folder is None:
            with as_os_error():
                self._files.put_file(str(source), str(self._root / key))
            return
        target = self.folder / key
        made = [folder for folder in target.parents if not folder.exists()]
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            source.replace(target)
        except OSError as error:
            if error.errno != errno.EXDEV:
                raise
            _copy(source, target)
        for folder in {target.parent, *(each.parent for each in made)}:
            sync(folder)

    def fetch(self, key: str, target: Path) -> None:
        """Copy an object to a file, or let the file be another name for it; FileNotFoundError where there is none."""
        if self.folder is None:
            with as_os_error():
                self._files.get_file(str(self._root / key), str(target))
        else:
            target.symlink_to((self.folder / key).resolve(strict=True))

    def read(self, key: str, start: int = 0, stop: int | None = None) -> bytes:
        """Read an object, or the bytes from `start` to before `stop` of it; FileNotFoundError where there is none."""
        with as_os_error():
            content: bytes = self._files.cat_file(str(self._root / key), start=start, end=stop)
        return content

    def list(self, prefix: str) -> Iterator[Object]:
        """List the objects below a prefix, also those that are only partly written."""
        try:
            with as_os_error():
                self._files.invalidate_cache()  # other servers write there as well
                found = self._files.find(str(self._root / prefix), detail=True)
        except FileNotFoundError:
            return
        for path, facts in found.items():
            modified = facts.get("LastModified") or facts.get("mtime") or self._files.modified(path)
            if isinstance(modified, (int, float)):
                modified = datetime.fromtimestamp(modified, UTC)
            yield Object(str(PurePosixPath(path).relative_to(self._root)), modified)

    def remove(self, key: str) -> None:
        """Remove an object, or all objects below a prefix; nothing happens where there is none."""
        path = str(self._root / key)
        try:
            with as_os_error():
                self._files.invalidate_cache()
                self._files.rm(path, recursive=True)
        except FileNotFoundError:
            return


def _copy(source: Path, target: Path) -> None:
    """Bring a file to another disk, where it is whole or not there."""
    partial = target.with_name(target.name + _PARTIAL)
    try:
        shutil.copyfile(source, partial)
        sync(partial)
        partial.replace(target)
    finally:
        partial.unlink(missing_ok=True)
