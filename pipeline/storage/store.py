"""Where products of logs, and the logs of a service, are kept: a folder, or what else fsspec reaches by a URL (s3://).

A product is a folder such as ``flights/NAME``, or a single file. Nothing is ever seen half-written: on a disk it is
written elsewhere, synced and renamed; among objects, which cannot be renamed, `ENTRY` goes first and comes last, so
that a folder with it is whole.
"""

from __future__ import annotations

import errno
import json
import os
import shutil
import sys
import tempfile
import uuid
import weakref
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, TypeVar
from urllib.parse import urlsplit

from core.lazy import lazy
from core.serialization import plain, restored
from pipeline.config import ConfigError

if TYPE_CHECKING:
    import fcntl
    from urllib import request

    import fsspec
else:
    fcntl, fsspec, request = lazy("fcntl"), lazy("fsspec"), lazy("urllib.request")  # Windows has no fcntl

T = TypeVar("T")

#: The file that makes a product whole.
ENTRY = "entry.json"

#: Below the root of a store on a disk: what is being written. The name hides it from query engines.
SCRATCH = ".scratch"

#: Which process works on a store on a disk.
LOCK = ".lock"


class Store:
    """Products by path, such as ``flights/paper01/report.json``, below one folder.

    Every method raises OSError when the storage fails, whatever its library calls that; FileNotFoundError where there
    is no such product.
    """

    url: str  #: Opens the same store in another process, see `open_store`.
    folder: Path | None = None  #: Where it is on a disk of this computer.

    def __init__(self, folder: Path) -> None:
        self.folder = self._root = folder.absolute()
        self.url = str(folder.absolute())

    def read(self, path: str) -> bytes:
        """Read a file."""
        return (self._root / path).read_bytes()

    def write(self, path: str, content: bytes) -> None:
        """Write a file, which others see as it was or as it is now."""
        with self.scratch() as scratch:
            file = scratch / "file"
            file.write_bytes(content)
            self.put(file, path)

    def put(self, file: Path, path: str) -> None:
        """Keep a file, likewise; from the same disk it moves."""
        target = self._root / path
        made = [folder for folder in target.parents if not folder.exists()]
        target.parent.mkdir(parents=True, exist_ok=True)
        sync(file)
        try:
            file.replace(target)
        except OSError as error:
            if error.errno != errno.EXDEV:
                raise
            _copy(file, target)
        for folder in {target.parent, *(path.parent for path in made)}:
            sync(folder)

    def get(self, path: str, file: Path) -> None:
        """Make a file another name for one that is kept, or a copy of it."""
        file.symlink_to((self._root / path).resolve(strict=True))

    def files(self, path: str) -> Iterator[tuple[str, datetime]]:
        """List all files below a folder, and when each was written."""
        for file in (self._root / path).rglob("*"):
            with suppress(FileNotFoundError):  # removed at this moment
                if file.is_file():
                    yield file.relative_to(self._root).as_posix(), datetime.fromtimestamp(file.stat().st_mtime, UTC)

    @contextmanager
    def scratch(self) -> Iterator[Path]:
        """Make a folder on the same disk for the time of a ``with``, to write products in."""
        folder = self._root / SCRATCH / uuid.uuid4().hex
        folder.mkdir(parents=True)
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def commit(self, folder: Path, path: str) -> None:
        """Keep a folder of `scratch` under `path`, whole, in place of what was there."""
        target = self._root / path
        target.parent.mkdir(parents=True, exist_ok=True)
        for entry in (*folder.rglob("*"), folder):
            sync(entry)
        replaced = folder.with_name(f"{folder.name}-replaced-{uuid.uuid4().hex}")
        while True:
            try:
                folder.rename(target)
                break
            except OSError as error:
                if error.errno not in (errno.ENOTEMPTY, errno.EEXIST, errno.EACCES) or not target.exists():
                    raise
            try:
                target.rename(replaced)
            except FileNotFoundError:  # another process was faster
                continue
            shutil.rmtree(replaced, ignore_errors=True)
        sync(target.parent)

    def remove(self, path: str) -> None:
        """Remove a file or a folder; nothing happens where there is none."""
        target = self._root / path
        with suppress(FileNotFoundError):
            if target.is_dir() and not target.is_symlink():
                shutil.rmtree(target)
            else:
                target.unlink()

    def move(self, path: str, new: str) -> None:
        """Move a folder to where there is none."""
        target = self._root / new
        target.parent.mkdir(parents=True, exist_ok=True)
        (self._root / path).rename(target)

    def names(self, path: str) -> list[str]:
        """List what is in a folder; nothing where there is none."""
        folder = self._root / path
        return sorted(path.name for path in folder.iterdir()) if folder.is_dir() else []

    def prepare(self) -> None:
        """Make the folder and try to write there."""
        self._root.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=self._root, buffering=0) as probe:
            probe.write(b"probe")  # a full disk takes the name and refuses the bytes

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Keep other runs out for the time of a ``with``; what a killed run left half-written is removed."""
        with (self._root / LOCK).open("w") as lock:
            if sys.platform != "win32":
                try:
                    # The system releases it with the process, however that ends.
                    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except BlockingIOError:
                    what = f"another run of rotorid writes to {self.url}; wait for it or choose another --out"
                    raise ConfigError(what) from None
                except OSError:  # some network file systems have no locks
                    pass
            shutil.rmtree(self._root / SCRATCH, ignore_errors=True)
            try:
                yield
            finally:
                shutil.rmtree(self._root / SCRATCH, ignore_errors=True)

    def fetch(self, path: str, folder: Path) -> None:
        """Copy the files of a product, without its folders, into a new folder on a disk."""
        folder.mkdir()
        for name in self.names(path):
            with suppress(IsADirectoryError, FileNotFoundError):
                (folder / name).write_bytes(self.read(f"{path}/{name}"))

    def read_json(self, path: str) -> Any:
        """Read JSON; None where there is none, or none that can be read: whoever needs it makes it anew."""
        try:
            return json.loads(self.read(path))
        except (FileNotFoundError, NotADirectoryError, ValueError):
            return None

    def read_as(self, path: str, kind: type[T]) -> T | None:
        """Read JSON as a type; None where there is none, or of another version: whoever needs it makes it anew."""
        facts = self.read_json(path)
        try:
            return None if facts is None else restored(facts, kind)
        except ValueError:
            return None

    def write_json(self, path: str, value: object) -> None:
        r"""Write JSON, see `write`; names of files that are not UTF-8 come back as they were, by way of ``\udcff``."""
        self.write(path, (json.dumps(plain(value), indent=1) + "\n").encode())


class TemporaryStore(Store):
    """A store that goes with its last reference."""

    def __init__(self) -> None:
        super().__init__(Path(tempfile.mkdtemp(prefix="rotorid-")))
        weakref.finalize(self, shutil.rmtree, self._root, ignore_errors=True)


class ObjectStore(Store):
    """A store among objects, by an fsspec URL. Runs that write at the same time are not kept apart."""

    def __init__(self, url: str) -> None:
        self.url = url
        self._files, root = fsspec.url_to_fs(url)
        self._base = PurePosixPath(root)

    def read(self, path: str) -> bytes:
        """Read an object."""
        with as_os_error():
            content: bytes = self._files.cat_file(str(self._base / path))
        return content

    def write(self, path: str, content: bytes) -> None:
        """Write an object, which others see as it was or as it is now."""
        with as_os_error():
            self._files.pipe_file(str(self._base / path), content)

    def put(self, file: Path, path: str) -> None:
        """Keep a file as an object."""
        with as_os_error():
            self._files.put_file(str(file), str(self._base / path))

    def get(self, path: str, file: Path) -> None:
        """Copy an object to a file."""
        with as_os_error():
            self._files.get_file(str(self._base / path), str(file))

    def files(self, path: str) -> Iterator[tuple[str, datetime]]:
        """List all objects below a prefix, and when each was written."""
        for name, facts in self._below(path).items():
            written = facts.get("LastModified") or facts.get("mtime") or self._files.modified(str(self._base / name))
            if isinstance(written, int | float):
                written = datetime.fromtimestamp(written, UTC)
            yield name, written

    def _below(self, path: str) -> dict[str, dict[str, Any]]:
        """Return what is told of all objects below a prefix, by path."""
        try:
            with as_os_error():
                self._files.invalidate_cache()  # others write there as well
                listing = self._files.find(str(self._base / path), detail=True)
        except FileNotFoundError:
            return {}
        return {str(PurePosixPath(name).relative_to(self._base)): facts for name, facts in listing.items()}

    @contextmanager
    def scratch(self) -> Iterator[Path]:
        """Make a folder on this computer's disk for the time of a ``with``, to write products in."""
        with tempfile.TemporaryDirectory(prefix="rotorid-") as folder:
            yield Path(folder)

    def commit(self, folder: Path, path: str) -> None:
        """Keep a folder of `scratch` under `path`: its entry is removed first and comes back last."""
        self.remove(f"{path}/{ENTRY}")
        files = sorted(path for path in folder.rglob("*") if path.is_file())
        new = {file.relative_to(folder).as_posix(): file for file in files}
        for old in self._below(path):
            if old.removeprefix(f"{path}/") not in new:
                self.remove(old)
        for name in sorted(new, key=lambda name: name == ENTRY):
            self.put(new[name], f"{path}/{name}")

    def remove(self, path: str) -> None:
        """Remove an object, or all objects below a prefix; nothing happens where there is none."""
        try:
            with as_os_error():
                self._files.invalidate_cache()
                self._files.rm(str(self._base / path), recursive=True)
        except FileNotFoundError:
            return

    def move(self, path: str, new: str) -> None:
        """Copy all objects below a prefix to another, and remove them there."""
        with as_os_error():
            for name in self._below(path):
                self._files.cp_file(str(self._base / name), str(self._base / f"{new}{name.removeprefix(path)}"))
        self.remove(path)

    def names(self, path: str) -> list[str]:
        """List what is directly below a prefix."""
        try:
            with as_os_error():
                self._files.invalidate_cache()
                listing = self._files.ls(str(self._base / path), detail=False)
        except FileNotFoundError:
            return []
        return sorted(PurePosixPath(name).name for name in listing)

    def prepare(self) -> None:
        """Try to write there."""
        probe = f"{uuid.uuid4().hex}.probe"  # others may probe at the same time
        with as_os_error():
            self._files.makedirs(str(self._base), exist_ok=True)
        try:
            self.write(probe, b"probe")
        finally:
            self.remove(probe)

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Do nothing: object storage has no locks that end with their process."""
        yield


def open_store(where: str | Path) -> Store:
    """Open a store by its folder or URL."""
    scheme = urlsplit(str(where)).scheme
    # One letter is a drive of Windows.
    if isinstance(where, Path) or len(scheme) < 2:
        return Store(Path(where))
    if scheme == "file":
        return Store(Path(request.url2pathname(urlsplit(str(where)).path)))
    return ObjectStore(str(where))


@contextmanager
def as_os_error() -> Iterator[None]:
    """Turn the errors of every storage into OSError: the libraries behind fsspec have exceptions of their own."""
    try:
        yield
    except OSError:
        raise
    except Exception as error:
        raise OSError(errno.EIO, f"{type(error).__name__}: {error}") from error


def _copy(file: Path, target: Path) -> None:
    """Copy a file to another disk, atomically."""
    partial = target.with_name(f"{target.name}.partial")
    try:
        shutil.copyfile(file, partial)
        sync(partial)
        partial.replace(target)
    finally:
        partial.unlink(missing_ok=True)


def sync(path: Path) -> None:
    """Make a file, or the names in a folder, on the disk."""
    if sys.platform == "win32" and path.is_dir():
        return
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        # Some network file systems cannot sync folders, and need not.
        if error.errno not in (errno.EINVAL, errno.ENOTSUP) or not path.is_dir():
            raise
    finally:
        os.close(descriptor)
