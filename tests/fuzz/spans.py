"""Where the messages of an undamaged log lie, after each format's description alone, without rotorid's readers."""

from __future__ import annotations

import struct
from collections.abc import Iterator

import numpy as np

from logparse import FlightLog

#: Messages that say how others are to be read: what is lost along with them is no wonder.
_EXPLAIN = {"FMT", "FMTU", "UNIT", "MULT", "F", "A", "B", "I", "M"}


def messages(data: bytes, ending: str) -> Iterator[tuple[str, range]]:
    """Yield the name (its number where the format has none) and the bytes of each whole message."""
    yield from {"bin": _dataflash, "log": _lines, "tlog": _telemetry, "ulg": _px4}[ending](data)


def wound(data: bytes, ending: str, rng: np.random.Generator) -> tuple[bytes, int]:
    """Overwrite, remove or insert one to forty bytes behind the formats; return how many messages were hit, too."""
    every = list(messages(data, ending))
    last = max((k for k, (name, _) in enumerate(every) if name in _EXPLAIN), default=0)
    # Nor within two messages of a seam of the log: one between two breaks would have nothing to be known by.
    seams = (k + 2 for k in range(1, len(every)) if every[k][1].start != every[k - 1][1].stop)
    victims = every[max(last + 1, *seams, 1) : -1]
    if not victims:
        return data, 0
    at = int(rng.integers(victims[0][1].start, victims[-1][1].stop))
    size = int(rng.integers(1, 41))
    # A message of PX4 has a length and no mark of its own: one that lost bytes may take the head of the next along.
    gone, put = [(size, size), (size, 0), (0, size)][0 if ending == "ulg" else int(rng.integers(3))]
    stop = min(at + gone, victims[-1][1].stop)
    damaged = bytearray(data)
    damaged[at:stop] = rng.integers(0, 256, min(put, stop - at) if gone else put, np.uint8).tobytes()
    # A line begins behind the end of the one before it: where that is lost, they are one.
    before = ending == "log"
    # The end of a DataFlash message is known by the header behind it: without any of that, its own may be what is lost.
    behind = ending == "bin"
    return bytes(damaged), sum(span.start - before < stop and at < span.stop + behind for _, span in every)


def count(log: FlightLog) -> int:
    """Return how many messages were read, of all power-ups."""
    return sum(sum(log.of_boot(boot).messages.counts.values()) for boot in log.boots)


def _dataflash(data: bytes) -> Iterator[tuple[str, range]]:
    known, at = {0x80: (89, "FMT")}, 0
    while at + 3 <= len(data):
        length, name = known.get(data[at + 2], (0, "")) if data[at : at + 2] == b"\xa3\x95" else (0, "")
        if not length or at + length > len(data):
            at = data.find(b"\xa3\x95", at + 1)
            if at < 0:
                return
            continue
        if name == "FMT" and data[at + 3] != 0x80:
            known[data[at + 3]] = (data[at + 4], data[at + 5 : at + 9].rstrip(b"\0").decode("ascii", "replace"))
        yield name, range(at, at + length)
        at += length


def _lines(data: bytes) -> Iterator[tuple[str, range]]:
    at = 0
    while at < len(data):
        stop = data.find(b"\n", at) + 1 or len(data)
        yield data[at:stop].partition(b",")[0].decode(), range(at, stop)
        at = stop


def _telemetry(data: bytes) -> Iterator[tuple[str, range]]:
    at = 0
    while at + 14 <= len(data) and data[at + 8] in b"\xfd\xfe":
        second = data[at + 8] == 0xFD
        size = data[at + 9] + (8 + 12 + 13 * (data[at + 10] & 1) if second else 8 + 8)
        if at + size > len(data):
            return
        yield str(data[at + 13]), range(at, at + size)
        at += size


def _px4(data: bytes) -> Iterator[tuple[str, range]]:
    at = 16
    while at + 3 <= len(data):
        (size,) = struct.unpack_from("<H", data, at)
        yield chr(data[at + 2]), range(at, at + 3 + size)
        at += 3 + size
