"""Kernels of `tlog`: walk the frames of a MAVLink stream with their checksums verified, and decode them into columns.

A frame is a start byte (0xFE for MAVLink 1, 0xFD for MAVLink 2), a header, up to 255 bytes of payload, a checksum and,
when signed, 13 bytes of signature. The checksum is CRC-16/MCRF4XX over all between start byte and checksum, and one
more byte that each message definition adds (https://mavlink.io/en/guide/serialization.html).

All positions are unsigned: numba then omits its handling of negative indices, which halves the time.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

from core.compiled import inner, njit

# mypy: allow-untyped-decorators

Array = npt.NDArray[Any]
#: Unsigned and signed integers of some width; numba tells them apart, mypy need not.
Int = Any

# Entries of the scan's state.
POSITION = 0  #: where the next record begins
TAIL = 1  #: where the unreadable end of the stream begins; the stream's length when there is none
BAD_CHECKSUMS = 2
STRAY_BYTES = 3
BREAKS = 4  #: spans without an intact frame, the tail not counted
FIRST_BREAK = 5  #: where the first of them begins
VERIFIED = 6  #: behind the checksum of the last frame: a signature, which it does not cover, may be damaged
STATE_SIZE = 7

# Columns of an open clock window (one row per link) and of a closed one (preceded by the link).
FIRST_OFFSET = 0
LAST_OFFSET = 1
FIRST_BOOT = 2
LAST_BOOT = 3
DELAY = 4
SAMPLES = 5
WINDOW_SIZE = 6

#: Slots of what is no known message; `slot_of_id` has the first.
UNKNOWN, NO_FRAME = -1, -2

LINKS = 65536  #: a link is ``system << 8 | component``

# Columns of a clock knot (see `clock`).
KNOT_OFFSET, KNOT_DELAY, KNOT_FIRST, KNOT_NEXT = 0, 1, 2, 3

#: How messages tell the time of their sample.
CLOCK_NONE, CLOCK_BOOT_MS, CLOCK_US32, CLOCK_US64 = 0, 1, 2, 3

#: A new clock window begins when the boot clock steps back by more than this, ms ...
RESTART_MS = 5000
#: ... or logger time less boot time departs by more than this, us.
_DELAY_TOLERANCE_US = 1_000_000
#: A message's own time may differ from the logger's by this much before it is disbelieved, us.
_OWN_TIME_TOLERANCE_US = 10_000_000

#: So many frames of unknown messages in a row are believed.
_MOST_UNKNOWN_RUN = 8
_BLOCK_ROWS = 1024
_MARK_V1 = np.uint8(0xFE)
_MARK_V2 = np.uint8(0xFD)
_U = np.uint64


def checksum_tables() -> npt.NDArray[np.uint16]:
    """Tables of CRC-16/MCRF4XX for sixteen bytes at a time ("slicing", Kounavis and Berry 2005), shape (16 * 256,).

    Entry ``256 k + b`` is the register after byte b and k zero bytes.
    """
    tables = np.zeros((16, 256), np.uint16)
    register = np.arange(256, dtype=np.uint16)
    for _ in range(8):
        register = np.where(register & 1, (register >> 1) ^ 0x8408, register >> 1).astype(np.uint16)
    tables[0] = register
    for k in range(1, 16):
        tables[k] = (tables[k - 1] >> 8) ^ tables[0][tables[k - 1] & 0xFF]
    return tables.ravel()


@inner()
def _u16(data: Array, p: Int) -> Int:
    return np.uint16(data[p]) | (np.uint16(data[p + _U(1)]) << np.uint16(8))


@inner()
def _u32(data: Array, p: Int) -> Int:
    # LLVM makes one load of this.
    return (
        np.uint32(data[p])
        | (np.uint32(data[p + _U(1)]) << np.uint32(8))
        | (np.uint32(data[p + _U(2)]) << np.uint32(16))
        | (np.uint32(data[p + _U(3)]) << np.uint32(24))
    )


@inner()
def _u64(data: Array, p: Int) -> Int:
    return np.uint64(_u32(data, p)) | (np.uint64(_u32(data, p + _U(4))) << _U(32))


@inner()
def _stamp(data: Array, mark: Int) -> Int:
    """Logger time before the frame at `mark`, us: eight bytes, the highest first."""
    stamp = _u64(data, mark - _U(8))
    # LLVM makes one instruction of this.
    stamp = ((stamp & _U(0x00FF00FF00FF00FF)) << _U(8)) | ((stamp >> _U(8)) & _U(0x00FF00FF00FF00FF))
    stamp = ((stamp & _U(0x0000FFFF0000FFFF)) << _U(16)) | ((stamp >> _U(16)) & _U(0x0000FFFF0000FFFF))
    return np.int64((stamp << _U(32)) | (stamp >> _U(32)))


@inner()
def _cut_u32(data: Array, p: Int, present: Int) -> Int:
    """Little-endian integer of four bytes of which only `present` were sent; the rest are zero."""
    return _u32(data, p) if present >= 4 else np.uint32(_cut_uint(data, p, present, 4))


@inner(nogil=True)
def _cut_uint(data: Array, p: Int, present: Int, width: Int) -> Int:
    """Little-endian integer of `width` bytes of which only `present` were sent; the rest are zero."""
    value = _U(0)
    for k in range(min(present, width)):
        value |= np.uint64(data[p + _U(k)]) << _U(8 * k)
    return value


@inner()
def _eight_bytes(tables: Array, zeros: Int, word: Int) -> Int:
    """Register after eight bytes, combined with the register before them, and `zeros` / 256 zero bytes."""
    return np.uint64(
        tables[zeros + _U(0x700) + (word & _U(0xFF))]
        ^ tables[zeros + _U(0x600) + ((word >> _U(8)) & _U(0xFF))]
        ^ tables[zeros + _U(0x500) + ((word >> _U(16)) & _U(0xFF))]
        ^ tables[zeros + _U(0x400) + ((word >> _U(24)) & _U(0xFF))]
        ^ tables[zeros + _U(0x300) + ((word >> _U(32)) & _U(0xFF))]
        ^ tables[zeros + _U(0x200) + ((word >> _U(40)) & _U(0xFF))]
        ^ tables[zeros + _U(0x100) + ((word >> _U(48)) & _U(0xFF))]
        ^ tables[zeros + (word >> _U(56))]
    )


@inner()
def _checksum(data: Array, start: Int, size: Int, extra: Int, tables: Array) -> Int:
    """Checksum of `size` bytes from `start`, and the definition's extra byte.

    Zeros before a message leave a zero register at zero, and the register's initial value 0xFFFF does the same as
    inverting the first two bytes. So the message is filled up in front to a multiple of eight, and needs no
    byte-by-byte end; the bytes that really stand before it are shifted out.
    """
    pad = (_U(0) - size) & _U(7)
    # At the very beginning of a stream there are fewer bytes to be shifted out.
    before = min(pad, start)
    word = (_u64(data, start - before) >> (before << _U(3))) << (pad << _U(3))
    word ^= _U(0xFFFF) << (pad << _U(3))
    p = start + _U(8) - pad
    end = start + size
    # The second inverted byte may already be in the next eight.
    inverted = _U(0xFF) if pad == _U(7) else _U(0)
    if (end - p) & _U(8):
        # An odd number of eights remains: take the first two together, then all others in pairs.
        register = _eight_bytes(tables, _U(0x800), word) ^ _eight_bytes(tables, _U(0), _u64(data, p) ^ inverted)
        p += _U(8)
    else:
        register = _eight_bytes(tables, _U(0), word) ^ inverted
    while p < end:
        register = _eight_bytes(tables, _U(0x800), _u64(data, p) ^ register) ^ _eight_bytes(
            tables, _U(0), _u64(data, p + _U(8))
        )
        p += _U(16)
    return np.uint64(tables[(register ^ np.uint64(extra)) & _U(0xFF)]) ^ (register >> _U(8))


@inner()
def _frame(data: Array, mark: Int, size: Int, slot_of_id: Array) -> tuple[Int, Int, Int]:
    """Header of the frame at `mark`: its message's slot, checksummed bytes and end."""
    if mark + _U(8) > size:
        return NO_FRAME, _U(0), _U(0)
    length = np.uint64(data[mark + _U(1)])
    if data[mark] == _MARK_V1:
        number = np.uint64(data[mark + _U(5)])
        body = length + _U(5)
        end = mark + length + _U(8)
    elif data[mark] == _MARK_V2 and mark + _U(12) <= size:
        number = (
            np.uint64(data[mark + _U(7)])
            | (np.uint64(data[mark + _U(8)]) << _U(8))
            | (np.uint64(data[mark + _U(9)]) << _U(16))
        )
        body = length + _U(9)
        end = mark + length + _U(12)
        if data[mark + _U(2)] & np.uint8(1):
            end += _U(13)
    else:
        return NO_FRAME, _U(0), _U(0)
    if end > size:
        return NO_FRAME, _U(0), _U(0)
    slot = np.int64(slot_of_id[number]) if number < np.uint64(slot_of_id.size) else UNKNOWN
    return slot, body, end


@inner()
def _intact(data: Array, mark: Int, slot: Int, body: Int, crc_extra: Array, tables: Array) -> Any:
    checksum = _checksum(data, mark + _U(1), body, crc_extra[_U(slot)], tables)
    return checksum == np.uint64(_u16(data, mark + _U(1) + body))


@njit(cache=True, nogil=True)
def find_frame(data: Array, start: Int, stop: Int, slot_of_id: Array, crc_extra: Array, tables: Array) -> Int:
    """Find where the first intact frame of a known message between `start` and `stop` begins; the end if none does."""
    size = np.uint64(data.size)
    mark = np.uint64(start)
    while mark < np.uint64(stop):
        if data[mark] == _MARK_V1 or data[mark] == _MARK_V2:
            slot, body, _ = _frame(data, mark, size, slot_of_id)
            if slot >= 0 and _intact(data, mark, slot, body, crc_extra, tables):
                return mark
        mark += _U(1)
    return size


@inner(nogil=True)
def _is_unknown_frame(
    data: Array, mark: Int, end: Int, prefix: Int, slot_of_id: Array, crc_extra: Array, tables: Array
) -> Any:
    """Whether what looks like the frame of an unknown message at `mark` is one.

    It hides no intact frame, and behind it, perhaps behind others of its kind, comes an intact frame or the end.
    """
    size = np.uint64(data.size)
    for _ in range(_MOST_UNKNOWN_RUN):
        if find_frame(data, mark + _U(1), end, slot_of_id, crc_extra, tables) < size:
            return False
        mark = end + prefix
        slot, body, end = _frame(data, mark, size, slot_of_id)
        if slot >= 0:
            return _intact(data, mark, slot, body, crc_extra, tables)
        if slot == NO_FRAME:
            return mark + _U(8) > size
    return True


@inner(nogil=True)
def _count_damaged(data: Array, position: Int, prefix: Int, next_mark: Int, slot_of_id: Array, bad: Array) -> Int:
    """Count the frames with wrong checksums between two intact ones, as far as each begins where the last one ends."""
    size = np.uint64(data.size)
    count = 0
    while position + prefix < next_mark:
        slot, _, end = _frame(data, position + prefix, size, slot_of_id)
        if slot < 0 or end + prefix > next_mark:
            break
        bad[slot] += 1
        count += 1
        position = end
    return count


@inner(nogil=True)
def _count_unknown(data: Array, mark: Int, unknown: Array) -> None:
    number = np.int64(data[mark + _U(5)])
    if data[mark] == _MARK_V2:
        number = np.int64(_u32(data, mark + _U(7)) & np.uint32(0xFFFFFF))
    row = 0
    while row < unknown.shape[0] - 1 and unknown[row, 1] > 0 and unknown[row, 0] != number:
        row += 1
    unknown[row, 0] = number
    unknown[row, 1] += 1


@njit(cache=True, nogil=True)
def scan(
    data: Array, stamp_bytes: Int, slot_of_id: Array, crc_extra: Array, tables: Array, boot_field: Array,
    heartbeat: Int, window_ms: Int, state: Array, offsets: Array, slots: Array, unknown: Array,
    bad_by_slot: Array, next_seq: Array, link_frames: Array, link_lost: Array, link_votes: Array,
    open_windows: Array, windows: Array,
) -> tuple[Int, Int]:  # fmt: skip
    """Walk the stream from the state's position until `offsets` or `windows` is full or the stream ends.

    Parameters
    ----------
    crc_extra : uint16 array, shape (n_slots,)
    boot_field : int64 array, shape (n_slots,)
        Where ``time_boot_ms`` begins in the payload; -1 where there is none.
    state : int64 array, shape (STATE_SIZE,)
        In and out.
    unknown : int64 array, shape (n, 2)
        Out: ids without a definition, and how many of each; the last row collects all further ids.
    windows : int64 array, shape (n, 1 + WINDOW_SIZE)
        Out: closed clock windows.

    Returns
    -------
    n_frames, n_windows : int
    """
    size = np.uint64(data.size)
    prefix = np.uint64(stamp_bytes)
    position = np.uint64(state[POSITION])
    verified = np.uint64(state[VERIFIED])
    n = _U(0)
    n_windows = 0
    while position < size and n < _U(offsets.size) and n_windows < windows.shape[0]:
        mark = position + prefix
        slot, body, end = _frame(data, mark, size, slot_of_id)
        has_stamp = stamp_bytes == 8
        if slot < 0 or not _intact(data, mark, slot, body, crc_extra, tables):
            if slot == UNKNOWN and _is_unknown_frame(data, mark, end, prefix, slot_of_id, crc_extra, tables):
                _count_unknown(data, mark, unknown)
                position = end
                verified = end
                continue
            mark = find_frame(data, verified, size, slot_of_id, crc_extra, tables)
            if mark == size:
                state[TAIL] = np.int64(position)
                position = size
                break
            state[BAD_CHECKSUMS] += _count_damaged(data, position, prefix, mark, slot_of_id, bad_by_slot)
            has_stamp &= mark >= position + prefix
            begin = mark - prefix if mark >= position + prefix else position
            if state[BREAKS] == 0:
                state[FIRST_BREAK] = np.int64(position)
            state[BREAKS] += 1
            state[STRAY_BYTES] += np.int64(begin - position)
            slot, body, end = _frame(data, mark, size, slot_of_id)

        offsets[n] = mark
        slots[n] = slot
        n += _U(1)
        verified = mark + _U(3) + body
        position = end
        length = np.int64(data[mark + _U(1)])
        if data[mark] == _MARK_V1:
            who = mark + _U(2)
            payload = mark + _U(6)
        else:
            who = mark + _U(4)
            payload = mark + _U(10)
        link = (np.uint64(data[who + _U(1)]) << _U(8)) | np.uint64(data[who + _U(2)])
        seq = np.int64(data[who])
        expected = np.int64(next_seq[link])
        link_lost[link] += (seq - expected) & 0xFF if expected >= 0 else 0
        link_frames[link] += 1
        next_seq[link] = (seq + 1) & 0xFF
        # Neither a ground station (MAV_TYPE 6) nor something without an autopilot (MAV_AUTOPILOT 8).
        if slot == heartbeat and length >= 6 and data[payload + _U(4)] != 6 and data[payload + _U(5)] != 8:
            link_votes[link] += 1

        at = boot_field[_U(slot)]
        if at < 0 or not (has_stamp or stamp_bytes == 0):
            continue
        boot = np.int64(_cut_u32(data, payload + _U(at), length - at))
        delay = _stamp(data, mark) - boot * 1000 if stamp_bytes == 8 else 0
        if boot == 0:
            continue
        if open_windows[link, SAMPLES] > 0:
            if (
                boot < open_windows[link, FIRST_BOOT] + window_ms
                and boot > open_windows[link, LAST_BOOT] - RESTART_MS
                and abs(delay - open_windows[link, DELAY]) < _DELAY_TOLERANCE_US
            ):
                open_windows[link, LAST_OFFSET] = np.int64(mark)
                open_windows[link, LAST_BOOT] = max(open_windows[link, LAST_BOOT], boot)
                open_windows[link, DELAY] = min(open_windows[link, DELAY], delay)
                open_windows[link, SAMPLES] += 1
                continue
            windows[n_windows, 0] = np.int64(link)
            for k in range(WINDOW_SIZE):
                windows[n_windows, 1 + k] = open_windows[link, k]
            n_windows += 1
        open_windows[link, FIRST_OFFSET] = np.int64(mark)
        open_windows[link, LAST_OFFSET] = np.int64(mark)
        open_windows[link, FIRST_BOOT] = boot
        open_windows[link, LAST_BOOT] = boot
        open_windows[link, DELAY] = delay
        open_windows[link, SAMPLES] = 1
    state[POSITION] = np.int64(position)
    state[VERIFIED] = np.int64(verified)
    return np.int64(n), n_windows


@njit(cache=True, nogil=True)
def sort_by_slot(offsets: Array, slots: Array, n_slots: Int) -> tuple[Array, Array]:
    """Sort a chunk of frames by message, keeping the order of the stream within each."""
    starts = np.zeros(n_slots + 1, np.int32)
    for k in range(offsets.size):
        starts[_U(slots[k]) + _U(1)] += 1
    for k in range(n_slots):
        starts[k + 1] += starts[k]
    place = starts[:-1].copy()
    ordered = np.empty_like(offsets)
    for k in range(offsets.size):
        slot = _U(slots[k])
        ordered[_U(place[slot])] = offsets[k]
        place[slot] += 1
    return ordered, starts


@inner()
def _knot_at(knots: Array, mark: Int) -> Int:
    """Last knot that begins at or before `mark`; the first where there is none."""
    low, high = 0, knots.shape[0]
    while high - low > 1:
        middle = (low + high) // 2
        if knots[middle, KNOT_OFFSET] <= mark:
            low = middle
        else:
            high = middle
    return low


@inner(nogil=True)
def _locate(data: Array, marks: Array, payload: Array, present: Array, senders: Array) -> Int:
    """Where payloads begin, how many bytes of each were sent, and who sent it; returns the least number of bytes."""
    shortest: Any = np.int64(255)
    for k in range(_U(marks.size)):
        mark = np.uint64(marks[k])
        length = np.int64(data[mark + _U(1)])
        is_v1 = data[mark] == _MARK_V1
        payload[k] = mark + (_U(6) if is_v1 else _U(10))
        present[k] = length
        senders[k] = _u16(data, mark + (_U(3) if is_v1 else _U(5)))
        shortest = min(shortest, length)
    return shortest


@inner(nogil=True)
def _tell_times(
    data: Array, marks: Array, payload: Array, present: Array, senders: Array, stamped: Int, knots: Array,
    autopilot: Int, kind: Int, offset: Int, t: Array,
) -> None:  # fmt: skip
    """Boot time of each frame, s: its own where the autopilot tells one that can be, else by the stream."""
    n_knots = knots.shape[0]
    knot = _knot_at(knots, np.int64(marks[0])) - 1
    end = np.int64(0)
    begin, delay, first, after = end, end, end, end
    for k in range(_U(marks.size)):
        mark = np.uint64(marks[k])
        while np.int64(mark) >= end:
            knot += 1
            begin, delay = knots[knot, KNOT_OFFSET], knots[knot, KNOT_DELAY]
            first, after = knots[knot, KNOT_FIRST], knots[knot, KNOT_NEXT]
            end = knots[knot + 1, KNOT_OFFSET] if knot + 1 < n_knots else np.int64(data.size)
        p, sent = payload[k] + _U(offset), present[k] - offset
        has_own = kind != CLOCK_NONE and senders[k] == autopilot
        if has_own and kind == CLOCK_BOOT_MS:
            own = np.int64(_cut_u32(data, p, sent)) * 1000
            if own != 0 and first - _OWN_TIME_TOLERANCE_US < own < after + _OWN_TIME_TOLERANCE_US:
                t[k] = own / 1e6
                continue
        if not stamped:
            time = first + np.int64((after - first) * ((np.int64(mark) - begin) / (end - begin)))
        elif mark < _U(8):
            time = first
        else:
            # A damaged stamp does no more harm than one clock window.
            time = min(max(_stamp(data, mark) - delay, first), after)
        if has_own and kind != CLOCK_BOOT_MS:
            if kind == CLOCK_US64:
                own = np.int64(_u64(data, p)) if sent >= 8 else np.int64(_cut_uint(data, p, sent, 8))
            else:
                # 32 bits of microseconds come round every 72 minutes.
                own = np.int64(_cut_u32(data, p, sent))
                own += ((time - own + (1 << 31)) >> 32) << 32 if own != 0 else 0
            if own != 0 and first - _OWN_TIME_TOLERANCE_US < own < after + _OWN_TIME_TOLERANCE_US:
                time = own
        t[k] = time / 1e6


@inner(nogil=True)
def _copy_text(data: Array, payload: Array, present: Array, offset: Int, width: Int, out: Int, arena8: Array) -> None:
    """Copy a ``char`` array of each frame up to its first zero, and fill up with zeros."""
    for k in range(payload.size):
        start = payload[k] + _U(offset)
        sent = min(width, present[k] - offset)
        ended = False
        for j in range(width):
            byte = data[start + _U(j)] if j < sent and not ended else np.uint8(0)
            ended |= byte == 0
            arena8[_U(out + k * width + j)] = byte


@inner(nogil=True)
def _fields(
    data: Array, payload: Array, present: Array, shortest: Int, field_offset: Array, field_width: Array, column: Array,
    target: Int, arena8: Array, arena16: Array, arena32: Array, arena64: Array,
) -> None:  # fmt: skip
    """Copy the fields of some frames into their columns, from row `target` on."""
    n = _U(payload.size)
    for f in range(field_offset.size):
        offset = _U(field_offset[f])
        width = field_width[f]
        if width < 0:
            _copy_text(data, payload, present, field_offset[f], -width, column[f] + target * -width, arena8)
            continue
        out = _U(column[f] + target)
        if field_offset[f] + width <= shortest:
            if width == 1:
                for k in range(n):
                    arena8[out + k] = data[payload[k] + offset]
            elif width == 2:
                for k in range(n):
                    arena16[out + k] = _u16(data, payload[k] + offset)
            elif width == 4:
                for k in range(n):
                    arena32[out + k] = _u32(data, payload[k] + offset)
            else:
                for k in range(n):
                    arena64[out + k] = _u64(data, payload[k] + offset)
            continue
        # MAVLink 2 omits zeros at the end of a payload.
        for k in range(n):
            p, sent = payload[k] + offset, present[k] - field_offset[f]
            if width == 1:
                arena8[out + k] = data[p] if sent >= 1 else np.uint8(0)
            elif width == 2:
                arena16[out + k] = _u16(data, p) if sent >= 2 else np.uint16(_cut_uint(data, p, sent, 2))
            elif width == 4:
                arena32[out + k] = _cut_u32(data, p, sent)
            else:
                arena64[out + k] = _u64(data, p) if sent >= 8 else _cut_uint(data, p, sent, 8)


@inner(nogil=True)
def _fetch(data: Array, start: Int, stop: Int) -> Int:
    """Read a chunk of the stream in one go: frames of one message after the other are too far apart to be foreseen."""
    p = np.uint64(start)
    read = np.uint8(0)
    while p < np.uint64(stop):
        read ^= data[p]
        p += _U(64)
    return read


@njit(cache=True, nogil=True)
def decode(
    data: Array, chunk_start: Int, chunk_stop: Int, ordered: Array, starts: Array, first_mark: Int, last_mark: Int,
    stamped: Int, autopilot: Int, knots: Array, slots: Array, clock_kind: Array, clock_offset: Array,
    first_field: Array, field_offset: Array, field_width: Array, column: Array, t_column: Array, sender_column: Array,
    row: Array, arena8: Array, arena16: Array, arena32: Array, arena64: Array, arena_f64: Array,
) -> Int:  # fmt: skip
    """Decode the frames of some messages in one chunk of the stream into columns; returns nothing of use.

    Parameters
    ----------
    knots : int64 array, shape (n_knots, 4)
        See `clock`.
    slots : int64 array, shape (n_messages,)
        Messages wanted.
    clock_kind, clock_offset : int64 arrays, shape (n_messages,)
        How and where in the payload each message tells its own time.
    first_field : int64 array, shape (n_messages + 1,)
        Where each message's fields begin in the arrays that follow.
    t_column, sender_column : int64 arrays, shape (n_messages,)
        Likewise for the boot time [s, float64] and for the sender [uint16, ``component << 8 | system``].
    row : int64 array, shape (n_messages,)
        In and out: rows of each message written so far.
    """
    payload = np.empty(_BLOCK_ROWS, np.uint64)
    present = np.empty(_BLOCK_ROWS, np.int64)
    wanted = 0
    for slot in slots:
        wanted += starts[slot + 1] - starts[slot]
    # The result goes out, else the reading would be left out.
    read = _fetch(data, chunk_start, chunk_stop) if wanted * 4 > ordered.size else np.uint8(0)
    for m in range(slots.size):
        begin, stop = np.int64(starts[slots[m]]), np.int64(starts[slots[m] + 1])
        while begin < stop and np.int64(ordered[begin]) < first_mark:
            begin += 1
        while begin < stop and np.int64(ordered[stop - 1]) >= last_mark:
            stop -= 1
        fields = slice(first_field[m], first_field[m + 1])
        for low in range(begin, stop, _BLOCK_ROWS):
            n: Any = min(stop - low, _BLOCK_ROWS)
            marks = ordered[low : low + n]
            senders = arena16[sender_column[m] + row[m] : sender_column[m] + row[m] + n]
            shortest = _locate(data, marks, payload[:n], present[:n], senders)
            t = arena_f64[t_column[m] + row[m] : t_column[m] + row[m] + n]
            _tell_times(
                data, marks, payload[:n], present[:n], senders, stamped, knots, autopilot, clock_kind[m],
                clock_offset[m], t,
            )  # fmt: skip
            _fields(
                data, payload[:n], present[:n], shortest, field_offset[fields], field_width[fields], column[fields],
                row[m], arena8, arena16, arena32, arena64,
            )  # fmt: skip
            row[m] += n
    return read
