"""Follow the chain of message headers through a PX4 log, and cut out what is no message.

A message says how long it is, and so where the next one begins. Behind a damaged length pyulog goes astray until a
sync message (46 to 203 messages of a real log were lost so), or to the end where there are none: up to nine in ten.
"""

import struct

import numpy as np
import numpy.typing as npt

from core.compiled import inner, njit
from logparse.containers import Buffer

_FILE_HEADER = 16
#: Place of the offsets of appended data in the file and their number: they stand in the first message.
_APPENDED, _MOST_APPENDED = _FILE_HEADER + 3 + 16, 3

#: Bytes of a message of each kind with its header: at least, or (negative) always; 0 where the kind is not known.
_KNOWN = np.zeros(256, np.int32)
_KNOWN[list(b"BFIMPQADLC")] = [43, 5, 6, 7, 6, 7, 7, 13, 12, 14]
_KNOWN[list(b"RSO")] = [-5, -11, -5]
_DATA, _SUBSCRIPTION = ord("D"), ord("A")
#: Kinds that begin with a name: information, of several parts, format, parameter, its default.
_INFORMATION, _PARTS, _FORMAT, _PARAMETER, _DEFAULT = (ord(kind) for kind in "IMFPQ")
#: Bytes that a message which is no data has at most, where nothing else says that its length is right.
_MOST_OTHER = 1024

Bytes = npt.NDArray[np.uint8]
Int32s = npt.NDArray[np.int32]


def whole_messages(buffer: Buffer) -> tuple[Buffer, int]:
    """Return a log without what is no message, and the bytes that were left out; the same buffer where all are sound.

    A last message that the file's end cuts short is left out too, and not counted.
    """
    data = np.frombuffer(buffer, np.uint8)
    # Of each topic: how long its messages are, how often they were, and whether it was subscribed to.
    lengths = np.zeros((3, 1 << 16), np.int32)
    _gaps(data, lengths, certain=False)
    gaps = _gaps(data, lengths, certain=True)
    if not gaps:
        return buffer, 0
    skipped = sum(stop - start for start, stop in gaps)
    start, stop = gaps[-1]
    if stop == len(data) and stop - start >= 3 and _KNOWN[data[start + 2]]:
        length = 3 + int(data[start]) + 256 * int(data[start + 1])
        skipped -= stop - start if start + length > stop else 0
    edges = [0, *(edge for gap in gaps for edge in gap), len(data)]
    kept = bytearray().join(data[a:b].tobytes() for a, b in zip(edges[::2], edges[1::2], strict=True))
    for at in range(_APPENDED, min(_APPENDED + 8 * _MOST_APPENDED, len(kept) - 7), 8):
        (offset,) = struct.unpack_from("<Q", kept, at)
        if kept[_FILE_HEADER + 2] == ord("B") and offset:
            before = sum(min(stop, offset) - start for start, stop in gaps if start < offset)
            struct.pack_into("<Q", kept, at, offset - before)
    return bytes(kept), skipped


def _gaps(data: Bytes, lengths: Int32s, *, certain: bool) -> list[tuple[int, int]]:
    """Return where something lies between messages; count lengths, or (`certain`) believe those that were counted."""
    gaps: list[tuple[int, int]] = []
    at = _FILE_HEADER
    while (at := _follow(data, at, lengths, _KNOWN, certain)) < len(data):
        following = _find(data, at + 1, lengths, _KNOWN, certain)
        if at + 3 <= len(data) and (stop := at + 3 + int(data[at]) + 256 * int(data[at + 1])) <= following:
            # Nothing else begins within it: a long message, one of a newer kind, or a sound one before a damaged one.
            least = int(_KNOWN[data[at + 2]])
            # pyulog reads no further behind a kind of zero.
            if stop == following and data[at + 2] and (least >= 0 or stop - at == -least):
                at = stop
                continue
            if stop - at == -least or (0 < least <= stop - at <= _MOST_OTHER and data[at + 2] != _DATA):
                at = stop
                following = _find(data, at, lengths, _KNOWN, certain)
        gaps.append((at, following))
        at = following
    return gaps


@inner()
def _length(data: Bytes, at: int) -> int:
    return 3 + np.int64(data[at]) + 256 * np.int64(data[at + 1])  # type: ignore[return-value]


@inner()
def _topic(data: Bytes, at: int) -> int:
    return np.int64(data[at + 3]) + 256 * np.int64(data[at + 4])  # type: ignore[return-value]


@inner()
def _fits(data: Bytes, at: int, known: Int32s) -> bool:
    """Return whether a header's kind is known and may have its length."""
    asked, length = known[data[at + 2]], _length(data, at)
    return bool(length >= asked if asked > 0 else asked != 0 and length == -asked)


@inner()
def _sound(data: Bytes, at: int, lengths: Int32s, known: Int32s, certain: bool) -> bool:
    """Return whether what stands here may be the header of a message."""
    if at + 3 > len(data) or not _fits(data, at, known) or at + _length(data, at) > len(data):
        return False
    if data[at + 2] != _DATA:
        return True
    length = _length(data, at)
    topic = _topic(data, at)
    return not certain or (lengths[0, topic] == length and lengths[2, topic] > 0)


@njit(cache=True)
def _follow(data: Bytes, at: int, lengths: Int32s, known: Int32s, certain: bool) -> int:
    """Return where the chain breaks that begins here, or the file's end."""
    while at + 3 <= len(data) and _fits(data, at, known):
        length = _length(data, at)
        stop = at + length
        is_data = data[at + 2] == _DATA
        if stop > len(data):
            return at
        topic = _topic(data, at) if is_data else 0
        other = is_data and lengths[0, topic] != length
        if other and (certain or lengths[1, topic] > 1):
            return at
        follows = stop == len(data) or _sound(data, stop, lengths, known, certain)
        kind = data[at + 2]
        named = kind in (_INFORMATION, _PARTS, _FORMAT, _PARAMETER, _DEFAULT)
        if named or (length > _MOST_OTHER and not is_data):
            # A damaged header reads as one of these by chance; and other long messages are rare, which hold text too.
            for place in range(at + 5, min(at + 9, stop)):
                follows = follows and 32 <= data[place] < 127
        if follows:
            if is_data and not certain:
                lengths[0, topic] = length
                lengths[1, topic] = 1 if other else lengths[1, topic] + 1
            if data[at + 2] == _SUBSCRIPTION and length > 6:
                lengths[2, _topic(data, at + 1)] = 1  # behind the number of its instance
        elif not certain or not is_data or other:
            return at
        at = stop
    return at


@njit(cache=True)
def _find(data: Bytes, at: int, lengths: Int32s, known: Int32s, certain: bool) -> int:
    """Return where the next message begins that others follow, or the file's end."""
    for start in range(at, len(data) - 2):
        if known[data[start + 2]] == 0 or not _sound(data, start, lengths, known, certain):
            continue
        second = start + _length(data, start)
        if second == len(data):
            return start
        if not _sound(data, second, lengths, known, certain):
            if certain and data[start + 2] == _DATA:
                return start
            continue
        third = second + _length(data, second)
        if third == len(data) or _sound(data, third, lengths, known, certain) or (certain and data[start + 2] == _DATA):
            return start
    return len(data)
