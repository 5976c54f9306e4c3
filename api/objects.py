"""Where the bytes of logs and results are kept: a folder, or whatever else fsspec reaches by a URL, such as s3://.

An object is never seen half-written: in a folder it arrives under another name, is synced and then renamed; S3 shows an
object only when it is complete. Names are made of ids and of our own file names, never of what a user sent.
"""

import os
import shutil
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path, PurePosixPath
from typing import NamedTuple
from urllib.parse import urlsplit

import fsspec

#: How the name of an object that is still being written ends.
_PARTIAL = ".partial"


class Object(NamedTuple):
    """One object of a listing."""

    key: str
    written: datetime


class Objects:
    """Objects by key, such as ``logs/5f0c...`` or ``analyses/0a1b.../7c2e.../report.html``.

    Parameters
    ----------
    url : str
        A folder, or a URL with a protocol that fsspec knows.
    """

    def __init__(self, url: str) -> None:
        self.url = url
        self._files, root = fsspec.url_to_fs(url)
        self._root = PurePosixPath(root)
        #: The folder itself, where it is one on this computer.
        self.folder = Path(root) if urlsplit(url).scheme in ("", "file") else None

    def prepare(self) -> None:
        """Make sure that objects can be written; OSError, or what the storage says, where they cannot."""
        probe = str(self._root / f"probe{_PARTIAL}")
        self._files.makedirs(str(self._root), exist_ok=True)
        self._files.pipe_file(probe, b"")
        self._files.rm_file(probe)

    def put(self, source: Path, key: str) -> None:
        """Keep a file, which is on a disk and synced, under `key`; in a folder on the same disk it moves."""
        if self.folder is None:
            self._files.put_file(str(source), str(self._root / key))
            return
        target = self.folder / key
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            source.replace(target)
        except OSError:  # another disk
            partial = target.with_name(target.name + _PARTIAL)
            shutil.copyfile(source, partial)
            _sync(partial)
            partial.replace(target)
        _sync(target.parent)

    def fetch(self, key: str, target: Path) -> None:
        """Copy an object to a file, or let the file be another name for it; FileNotFoundError where there is none."""
        if self.folder is None:
            self._files.get_file(str(self._root / key), str(target))
        else:
            target.symlink_to((self.folder / key).resolve(strict=True))

    def read(self, key: str, start: int = 0, stop: int | None = None) -> bytes:
        """Read an object, or the bytes from `start` to before `stop` of it; FileNotFoundError where there is none."""
        content: bytes = self._files.cat_file(str(self._root / key), start=start, end=stop)
        return content

    def list(self, prefix: str) -> Iterator[Object]:
        """List the objects below a prefix, also those that are only partly written."""
        try:
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
            self._files.rm(path, recursive=True)
        except FileNotFoundError:
            return


def _sync(path: Path) -> None:
    """Have a file, or the names in a folder, on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
