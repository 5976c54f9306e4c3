"""Seeded mutations of flight logs: bits, bytes, blocks, numbers that no sensor gives, lines and fields of text."""

from __future__ import annotations

import numpy as np

#: Floats that arithmetic stumbles over, as DataFlash and MAVLink store them.
_ODD_FLOATS = np.array([np.inf, -np.inf, np.nan, 3.4e38, -3.4e38, 1e-45, 0.0, 1e9, -1e9], np.float32)
#: Integers at the ends of their types.
_ODD_INTEGERS = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0x8000, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)
#: What a text log may hold in the place of a number.
_ODD_WORDS = (b"inf", b"-inf", b"nan", b"", b"abc", b"1e400", b"-1", b"99999999999999999999", b"0x10", b"\xff\xfe")


def mutate(data: bytes, rng: np.random.Generator, *, text: bool) -> bytes:
    """Return a damaged copy of a log: one to eight mutations of kinds drawn by `rng`."""
    damaged = bytearray(data)
    kinds = (
        (_words, _lines, _flip, _remove, _cut) if text else (_flip, _bytes, _floats, _integers, _remove, _copy, _cut)
    )
    for _ in range(int(rng.integers(1, 9))):
        kind = kinds[int(rng.integers(len(kinds)))]
        # A cut near the head leaves nothing to look at: seldom.
        if damaged and (kind is not _cut or rng.random() < 0.2):
            kind(damaged, rng)
    return bytes(damaged)


def _at(damaged: bytearray, rng: np.random.Generator, size: int = 1) -> int:
    """Return a place; every second time among the first 4 kB, where formats and parameters stand."""
    last = max(1, len(damaged) - size)
    return int(rng.integers(min(last, 4096) if rng.random() < 0.5 else last))


def _flip(damaged: bytearray, rng: np.random.Generator) -> None:
    damaged[_at(damaged, rng)] ^= 1 << int(rng.integers(8))


def _bytes(damaged: bytearray, rng: np.random.Generator) -> None:
    size = int(rng.integers(1, 17))
    at = _at(damaged, rng, size)
    damaged[at : at + size] = rng.integers(0, 256, size, np.uint8).tobytes()


def _floats(damaged: bytearray, rng: np.random.Generator) -> None:
    at = _at(damaged, rng, 4)
    damaged[at : at + 4] = rng.choice(_ODD_FLOATS).tobytes()


def _integers(damaged: bytearray, rng: np.random.Generator) -> None:
    size = int(rng.choice((1, 2, 4, 8)))
    at = _at(damaged, rng, size)
    value = int(rng.choice(_ODD_INTEGERS)) & ((1 << 8 * size) - 1)
    damaged[at : at + size] = value.to_bytes(size, "little")


def _remove(damaged: bytearray, rng: np.random.Generator) -> None:
    size = int(rng.integers(1, 200))
    at = _at(damaged, rng, size)
    del damaged[at : at + size]


def _copy(damaged: bytearray, rng: np.random.Generator) -> None:
    size = int(rng.integers(1, 500))
    source, at = _at(damaged, rng, size), _at(damaged, rng)
    damaged[at:at] = damaged[source : source + size]


def _cut(damaged: bytearray, rng: np.random.Generator) -> None:
    del damaged[_at(damaged, rng) :]


def _words(damaged: bytearray, rng: np.random.Generator) -> None:
    """Put an odd word in the place of a field."""
    begin = damaged.find(b",", _at(damaged, rng))
    end = min((at for at in (damaged.find(b",", begin + 1), damaged.find(b"\n", begin + 1)) if at > 0), default=-1)
    if 0 <= begin < end:
        damaged[begin + 1 : end] = b" " + _ODD_WORDS[int(rng.integers(len(_ODD_WORDS)))]


def _lines(damaged: bytearray, rng: np.random.Generator) -> None:
    """Repeat a line elsewhere."""
    begin = damaged.find(b"\n", _at(damaged, rng)) + 1
    end = damaged.find(b"\n", begin) + 1
    at = damaged.find(b"\n", _at(damaged, rng)) + 1
    if begin and end and at:
        damaged[at:at] = damaged[begin:end]
