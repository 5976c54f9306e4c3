"""Open the file behind a log: mapped into memory, unpacked first when it is a gzip or zip archive."""

import gzip
import io
import mmap
import os
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO, cast

from core.errors import LogError
from core.findings import Finding, warning

#: An archive that holds more than this is refused: a few kB can unpack to terabytes.
MAX_UNPACKED_BYTES = 4 << 30

#: So is one that unpacks to more than so many times its own size, beyond a size that does no harm: logs of flights
#: shrink to a third. Rows of 667 kB that were 95 MB, one of them again and again, took 1.2 GB and 14 s.
_MOST_TIMES, _HARMLESS = 10, 20_000_000

_limit = MAX_UNPACKED_BYTES

_PIECE = 1 << 20
_HEAD = 1 << 16

Buffer = bytes | mmap.mmap

#: Bytes of a mapped file that are kept in memory before they are given back.
_KEEP = 1 << 23
#: A page cache of huge pages maps them whole: giving back a part of one brings it all back at the next touch.
_HUGE_PAGE = 1 << 21


class MappedPages:
    """Pages of a mapped file in memory, given back on the way so that a file larger than memory can be read."""

    def __init__(self, buffer: "Buffer"):
        self._map = buffer if isinstance(buffer, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED") else None
        self.matter = self._map is not None and len(buffer) > _KEEP
        self._released = 0

    def start_at(self, position: int) -> None:
        """Begin to read at a byte of the file."""
        self._released = position - position % _HUGE_PAGE

    def release_up_to(self, position: int) -> None:
        """Return what was read before `position`, a good piece at a time."""
        position -= position % _HUGE_PAGE
        if self._map is not None and self.matter and position - self._released >= _KEEP:
            self._map.madvise(mmap.MADV_DONTNEED, self._released, position - self._released)
            self._released = position

    def release(self) -> None:
        """Return everything."""
        if self._map is not None and self.matter:
            self._map.madvise(mmap.MADV_DONTNEED)
        self._released = 0

    def pieces(self, start: int, stop: int) -> range:
        """Bytes at which to pause and release, for a pass from `start` to `stop`."""
        step = _KEEP if self.matter else max(stop - start, 1)
        return range(start + step, stop + step, step)


def limit_unpacked(size: int) -> None:
    """Set how many bytes an archive may unpack to in this process, at most `MAX_UNPACKED_BYTES`."""
    global _limit
    _limit = size


def open_buffer(path: Path, is_log: Callable[[bytes], bool]) -> tuple[Buffer, tuple[Finding, ...]]:
    """Map a file; what a gzip or zip archive holds is unpacked into a temporary file and mapped."""
    with _opened(path, is_log) as (file, packed):
        return (_map(file), ()) if packed is None else _unpacked(packed, path)


def read_head(path: Path, is_log: Callable[[bytes], bool]) -> bytes:
    """Read the first 64 kB of a log, unpacked no further than that; parameters and errors as of `open_buffer`."""
    with _opened(path, is_log) as (file, packed):
        return file.read(_HEAD) if packed is None else _first(packed, path.name)


@contextmanager
def _opened(
    path: Path, is_log: Callable[[bytes], bool]
) -> Iterator[tuple[IO[bytes], gzip.GzipFile | zipfile.ZipExtFile | None]]:
    """Open a file, and the log in it where it is an archive."""
    try:
        if path.is_dir():
            raise LogError(f"{path} is a folder, not a log")
        if path.exists() and not path.is_file():
            raise LogError(f"{path} is a pipe or a device, not a file; save the log to a file first")
        with path.open("rb") as file, ExitStack() as stack:
            magic = file.read(4)
            if not magic:
                raise LogError(f"{path.name} is empty (0 bytes): the autopilot or the download wrote nothing")
            packed: gzip.GzipFile | zipfile.ZipExtFile | None = None
            if magic[:3] == b"\x1f\x8b\x08":
                packed = stack.enter_context(gzip.open(path))
            elif magic == b"PK\x03\x04":
                packed = stack.enter_context(_zip_member(path, is_log))
            file.seek(0)
            yield file, packed
    except OSError as error:
        raise LogError(f"{path} cannot be read: {error.strerror or error}") from error


@contextmanager
def _zip_member(path: Path, is_log: Callable[[bytes], bool]) -> Iterator[zipfile.ZipExtFile]:
    """Open the one log of an archive."""
    with ExitStack() as stack:
        try:
            archive = stack.enter_context(zipfile.ZipFile(path))
            logs = [each for each in archive.infolist() if _looks_like_log(archive, each, is_log)]
            packed = stack.enter_context(archive.open(logs[0])) if len(logs) == 1 else None
        except Exception as error:  # a damaged directory ends in whatever zipfile and its decompressors happen to raise
            raise LogError(f"{path.name} is a zip archive that cannot be opened: {_said(error)}") from error
        if packed is None:
            what = "no log" if not logs else f"{len(logs)} logs"
            advice = "" if not logs else ": unpack it and give the logs one by one or as a folder"
            raise LogError(f"{path.name} is a zip archive with {what} in it{advice}")
        yield cast(zipfile.ZipExtFile, packed)


def _looks_like_log(archive: zipfile.ZipFile, member: zipfile.ZipInfo, is_log: Callable[[bytes], bool]) -> bool:
    if member.is_dir() or member.file_size == 0:
        return False
    with archive.open(member) as packed:
        return is_log(packed.read(_HEAD))


def _first(packed: io.BufferedIOBase, name: str) -> bytes:
    """Unpack the first 64 kB, or what of them comes before damage."""
    head, damage = b"", None
    while damage is None and len(head) < _HEAD:
        piece, damage = _piece(packed, _HEAD - len(head))
        if not piece:
            break
        head += piece
    if damage is not None and not head:
        raise LogError(f"{name} is an archive that cannot be unpacked: {_said(damage)}") from damage
    return head


def _piece(packed: io.BufferedIOBase, size: int) -> tuple[bytes, Exception | None]:
    """Unpack the next bytes; what a decompressor raises at damage is given beside them."""
    try:
        return packed.read1(size), None
    except Exception as error:
        return b"", error


def _said(error: Exception) -> str:
    return str(error) or type(error).__name__


def most_unpacked(packed: int) -> int:
    """Return how many bytes may become of so many in this process."""
    return min(_limit, MAX_UNPACKED_BYTES, max(_HARMLESS, _MOST_TIMES * packed))


def unpack(packed: io.BufferedIOBase, file: IO[bytes], archive: Path) -> tuple[int, Exception | None]:
    """Unpack into a file, up to damage; return the bytes and what the decompressor raised.

    LogError where there are more than `most_unpacked`.
    """
    name, most = archive.name, most_unpacked(archive.stat().st_size)
    size, damage = 0, None
    while damage is None:
        piece, damage = _piece(packed, _PIECE)
        if not piece:
            break
        size += len(piece)
        if size > most:
            raise LogError(
                f"{name} unpacks to more than {most / 1e9:.3g} GB, the most that is read of such a file here: "
                "unpack it and give what is in it"
            )
        file.write(piece)
    file.flush()
    return size, damage


def _unpacked(packed: io.BufferedIOBase, archive: Path) -> tuple[Buffer, tuple[Finding, ...]]:
    """Unpack into a temporary file that disappears with its map; keep what comes before damage."""
    findings: tuple[Finding, ...] = ()
    with tempfile.TemporaryFile() as file:
        size, damage = unpack(packed, file, archive)
        name = archive.name
        if damage is not None:
            if size == 0:
                raise LogError(f"{name} is an archive that cannot be unpacked: {_said(damage)}") from damage
            findings = (
                warning(
                    "file-damaged",
                    f"The archive is damaged or cut short ({_said(damage)}); the first {size} bytes of the log were "
                    "read.",
                    "Copy or download the file again.",
                    bytes=size,
                ),
            )
        if size == 0:
            raise LogError(f"{name} is an archive of an empty file")
        return _map(file), findings


def _map(file: IO[bytes]) -> mmap.mmap:
    os.lseek(file.fileno(), 0, os.SEEK_SET)
    return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
