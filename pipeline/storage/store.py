"""Where the products of a folder of logs are kept: a folder, or whatever else fsspec reaches by a URL, such as s3://.

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
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, TypeVar
from urllib.parse import urlsplit

from core.lazy import lazy
from core.serialization import plain, restored
from pipeline.errors import ConfigError

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


class Store(ABC):
    """Products by path, such as ``flights/paper01/report.json``, below one root.

    Every method raises OSError when the storage fails, whatever its library calls that; FileNotFoundError where there
    is no such product.
    """

    url: str  #: Opens the same store in another process, see `open_store`.
    folder: Path | None = None  #: Where it is on a disk of this computer.

    @abstractmethod
    def read(self, path: str) -> bytes:
        """Read a file."""

    @abstractmethod
    def write(self, path: str, content: bytes) -> None:
        """Write a file, which others see as it was or as it is now."""

    @abstractmethod
    def put(self, file: Path, path: str) -> None:
        """Keep a file, likewise; it may be gone afterwards from where it was."""

    @abstractmethod
    def scratch(self) -> AbstractContextManager[Path]:
        """Make a folder on a disk for the time of a ``with``, to write products in."""

    @abstractmethod
    def commit(self, folder: Path, path: str) -> None:
        """Keep a folder of `scratch` under `path`, whole, in place of what was there."""

    @abstractmethod
    def remove(self, path: str) -> None:
        """Remove a file or a folder; nothing happens where there is none."""

    @abstractmethod
    def move(self, path: str, new: str) -> None:
        """Move a folder to where there is none."""

    @abstractmethod
    def names(self, path: str) -> list[str]:
        """List what is in a folder; nothing where there is none."""

    @abstractmethod
    def prepare(self) -> None:
        """Make sure that products can be written."""

    @abstractmethod
    def locked(self) -> AbstractContextManager[None]:
        """Keep other runs out for the time of a ``with``, as far as the storage can; ConfigError when one is in."""

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


def open_store(where: str | Path) -> Store:
    """Open a store by its folder or URL."""
    scheme = urlsplit(str(where)).scheme
    # One letter is a drive of Windows.
    if isinstance(where, Path) or len(scheme) < 2:
        return FolderStore(Path(where))
    if scheme == "file":
        return FolderStore(Path(request.url2pathname(urlsplit(str(where)).path)))
    return ObjectStore(str(where))


class FolderStore(Store):
    """A store in a folder."""

    folder: Path

    def __init__(self, folder: Path) -> None:
        self.folder = folder.absolute()
        self.url = str(self.folder)

    def read(self, path: str) -> bytes:
        """Read a file."""
        return (self.folder / path).read_bytes()

    def write(self, path: str, content: bytes) -> None:
        """Write a file, which others see as it was or as it is now."""
        with self.scratch() as scratch:
            file = scratch / "file"
            file.write_bytes(content)
            self.put(file, path)

    def put(self, file: Path, path: str) -> None:
        """Keep a file, likewise; it is gone afterwards from where it was."""
        target = self.folder / path
        target.parent.mkdir(parents=True, exist_ok=True)
        sync(file)
        file.replace(target)
        sync(target.parent)

    @contextmanager
    def scratch(self) -> Iterator[Path]:
        """Make a folder on the same disk for the time of a ``with``, to write products in."""
        folder = self.folder / SCRATCH / uuid.uuid4().hex
        folder.mkdir(parents=True)
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def commit(self, folder: Path, path: str) -> None:
        """Keep a folder of `scratch` under `path`, whole, in place of what was there."""
        target = self.folder / path
        target.parent.mkdir(parents=True, exist_ok=True)
        for each in (*folder.rglob("*"), folder):
            sync(each)
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
        target = self.folder / path
        if target.is_dir() and not target.is_symlink():
            shutil.rmtree(target)
        else:
            target.unlink(missing_ok=True)

    def move(self, path: str, new: str) -> None:
        """Move a folder to where there is none."""
        target = self.folder / new
        target.parent.mkdir(parents=True, exist_ok=True)
        (self.folder / path).rename(target)

    def names(self, path: str) -> list[str]:
        """List what is in a folder; nothing where there is none."""
        folder = self.folder / path
        return sorted(each.name for each in folder.iterdir()) if folder.is_dir() else []

    def prepare(self) -> None:
        """Make the folder and try to write there."""
        self.folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=self.folder):
            pass

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Keep other runs out for the time of a ``with``; what a killed run left half-written is removed."""
        with (self.folder / LOCK).open("w") as lock:
            if sys.platform != "win32":
                try:
                    # The system releases it with the process, however that ends.
                    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except BlockingIOError:
                    what = f"another run of rotorid writes to {self.url}; wait for it or choose another --out"
                    raise ConfigError(what) from None
                except OSError:  # some network file systems have no locks
                    pass
            shutil.rmtree(self.folder / SCRATCH, ignore_errors=True)
            try:
                yield
            finally:
                shutil.rmtree(self.folder / SCRATCH, ignore_errors=True)


class TemporaryStore(FolderStore):
    """A store that goes with its last reference."""

    def __init__(self) -> None:
        super().__init__(Path(tempfile.mkdtemp(prefix="rotorid-")))
        weakref.finalize(self, shutil.rmtree, self.folder, ignore_errors=True)


class ObjectStore(Store):
    """A store among objects, by an fsspec URL. Runs that write at the same time are not kept apart."""

    def __init__(self, url: str) -> None:
        self.url = url
        with as_os_error():
            self._files, root = fsspec.url_to_fs(url)
        self._root = PurePosixPath(root)

    def read(self, path: str) -> bytes:
        """Read an object."""
        with as_os_error():
            content: bytes = self._files.cat_file(str(self._root / path))
        return content

    def write(self, path: str, content: bytes) -> None:
        """Write an object, which others see as it was or as it is now."""
        with as_os_error():
            self._files.pipe_file(str(self._root / path), content)

    def put(self, file: Path, path: str) -> None:
        """Keep a file as an object."""
        with as_os_error():
            self._files.put_file(str(file), str(self._root / path))

    @contextmanager
    def scratch(self) -> Iterator[Path]:
        """Make a folder on this computer's disk for the time of a ``with``, to write products in."""
        with tempfile.TemporaryDirectory(prefix="rotorid-") as folder:
            yield Path(folder)

    def commit(self, folder: Path, path: str) -> None:
        """Keep a folder of `scratch` under `path`: its entry is removed first and comes back last."""
        self.remove(f"{path}/{ENTRY}")
        files = sorted(each for each in folder.rglob("*") if each.is_file())
        new = {each.relative_to(folder).as_posix(): each for each in files}
        for old in self._below(path):
            if old not in new:
                self.remove(f"{path}/{old}")
        for name in sorted(new, key=lambda name: name == ENTRY):
            self.put(new[name], f"{path}/{name}")

    def remove(self, path: str) -> None:
        """Remove an object, or all objects below a prefix; nothing happens where there is none."""
        try:
            with as_os_error():
                self._files.invalidate_cache()
                self._files.rm(str(self._root / path), recursive=True)
        except FileNotFoundError:
            return

    def move(self, path: str, new: str) -> None:
        """Copy all objects below a prefix to another, and remove them there."""
        with as_os_error():
            for name in self._below(path):
                self._files.cp_file(str(self._root / path / name), str(self._root / new / name))
        self.remove(path)

    def names(self, path: str) -> list[str]:
        """List what is directly below a prefix."""
        try:
            with as_os_error():
                self._files.invalidate_cache()
                found = self._files.ls(str(self._root / path), detail=False)
        except FileNotFoundError:
            return []
        return sorted(PurePosixPath(each).name for each in found)

    def _below(self, path: str) -> list[str]:
        try:
            with as_os_error():
                self._files.invalidate_cache()
                found = self._files.find(str(self._root / path))
        except FileNotFoundError:
            return []
        return [str(PurePosixPath(each).relative_to(self._root / path)) for each in found]

    def prepare(self) -> None:
        """Try to write there."""
        probe = f"{uuid.uuid4().hex}.probe"
        with as_os_error():
            self._files.makedirs(str(self._root), exist_ok=True)
        self.write(probe, b"probe")
        self.remove(probe)

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Do nothing: object storage has no locks that end with their process."""
        yield


@contextmanager
def as_os_error() -> Iterator[None]:
    """Turn the errors of every storage into OSError: the libraries behind fsspec have exceptions of their own."""
    try:
        yield
    except OSError:
        raise
    except Exception as error:
        raise OSError(errno.EIO, f"{type(error).__name__}: {error}") from error


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
