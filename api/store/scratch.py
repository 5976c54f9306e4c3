"""A folder for what is not finished: uploads on their way, logs and results of analyses that are being worked on.

Every process has one of its own, locked as long as it lives, so that several servers may share a data folder and each
clears away only what the dead left behind.
"""

import fcntl
import hashlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from api.store.ids import new_id


class Scratch:
    """The folder of this process."""

    def __init__(self, parent: Path) -> None:
        parent.mkdir(parents=True, exist_ok=True)
        guard = open_locked(parent, wait=True)  # nobody clears away between our making a folder and locking it
        assert guard is not None
        try:
            for old in parent.iterdir():
                _clear(old)
            self.folder = parent / new_id()
            self.folder.mkdir()
            self._lock = open_locked(self.folder)
        finally:
            os.close(guard)
        with tempfile.TemporaryFile(dir=self.folder):
            pass  # so that a read-only folder is known at the start, not at the first upload

    def close(self) -> None:
        """Clear the folder away."""
        if self._lock is not None:
            shutil.rmtree(self.folder, ignore_errors=True)
            os.close(self._lock)
            self._lock = None


def _clear(folder: Path) -> None:
    """Remove a folder whose process is dead."""
    try:
        lock = open_locked(folder)
    except OSError:
        return
    if lock is not None:
        shutil.rmtree(folder, ignore_errors=True)
        os.close(lock)


def open_locked(folder: Path, *, wait: bool = False) -> int | None:
    """Lock a folder; return what holds the lock until it is closed, or None when another process has it."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except BlockingIOError:
        os.close(descriptor)
        return None
    return descriptor


class Upload:
    """A log on its way: its bytes go to a file, its digest grows with them."""

    def __init__(self, path: Path, file: BinaryIO) -> None:
        self.path = path
        self.size = 0
        self._file = file
        self._digest = hashlib.sha256()

    @property
    def sha256(self) -> str:
        """Digest of what has arrived, hexadecimal."""
        return self._digest.hexdigest()

    def write(self, data: bytes | bytearray) -> None:
        """Append bytes."""
        rest = memoryview(data)
        while rest:  # a disk that fills up takes a part before it refuses
            rest = rest[self._file.write(rest) :]
        self._digest.update(data)
        self.size += len(data)

    def seek(self, _: int) -> None:
        """Be read by nobody through this: what has arrived is read by its path."""


@contextmanager
def open_upload(folder: Path) -> Iterator[Upload]:
    """Open a place for a log to arrive at, in a folder on this computer."""
    path = folder / new_id()
    try:
        with path.open("wb", buffering=0) as file:
            yield Upload(path, file)
    finally:
        path.unlink(missing_ok=True)
