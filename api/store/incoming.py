"""Uploads that are still arriving: each a file of its own that is gone unless it is kept."""

import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from api.store.ids import new_id


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

    def sync(self) -> None:
        """Flush the bytes to disk (fsync)."""
        os.fsync(self._file.fileno())


class Incoming:
    """The folder on this computer in which uploads arrive."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    @contextmanager
    def receive(self) -> Iterator[Upload]:
        """Open a place for a log to arrive at."""
        path = self._folder / new_id()
        try:
            with path.open("wb", buffering=0) as file:
                yield Upload(path, file)
        finally:
            path.unlink(missing_ok=True)
