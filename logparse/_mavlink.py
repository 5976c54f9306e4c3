"""Kernels of `tlog`: walk the frames of a MAVLink stream with their checksums verified, and decode them into columns.

A frame is a start byte (0xFE for MAVLink 1, 0xFD for MAVLink 2), a header, up to 255 bytes of payload, a checksum and,
when signed, 13 bytes of signature. The checksum is CRC-16/MCRF4XX over all between start byte and checksum, and one
more byte that each message definition adds (https://mavlink.io/en/guide/serialization.html).

All positions are unsigned: numba then omits its handling of negative indices, which halves the time.
"""

from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit

# mypy: allow-untyped-decorators

Array = npt.NDArray[Any]
#: Unsigned and signed integers of some width; numba tells them apart, mypy need not.
Int = Any

# Entries of the scan's state.
POSITION = 0  #: where the next record begins
TAIL = 1  #: where the unreadable end of the stream begins; the stream's length when there is none
BAD_CHECKSUMS = 2
STRAY_BYTES = 3
BREAKS = 4
FRAMES_V1 = 5
FRAMES_V2 = 6
SIGNED = 7
STATE_SIZE = 8

# Columns of an open clock window (one row per link) and of a closed one (preceded by the link).
FIRST_OFFSET = 0
LAST_OFFSET = 1
FIRST_BOOT = 2
LAST_BOOT = 3
DELAY = 4
SAMPLES = 5
WINDOW_SIZE = 6

LINKS = 65536  #: a link is ``system << 8 | component``

# Columns of a clock knot (see `tlog_clock`).
KNOT_OFFSET, KNOT_DELAY, KNOT_FIRST, KNOT_NEXT = 0, 1, 2, 3

#: How messages tell the time of their sample.
CLOCK_NONE, CLOCK_BOOT_MS, CLOCK_US32, CLOCK_US64 = 0, 1, 2, 3

#: A new clock window begins when the boot clock steps back by more than this, ms ...
RESTART_MS = 5000
#: ... or logger time less boot time departs by more than this, us.
_DELAY_TOLERANCE_US = 1_000_000
#: A message's own time may differ from the logger's by this much before it is disbelieved, us.
_OWN_TIME_TOLERANCE_US = 10_000_000

_BLOCK_ROWS = 1024
_MARK_V1 = np.uint8(0xFE)
_MARK_V2 = np.uint8(0xFD)
_U = np.uint64


def checksum_tables() -> npt.NDArray[np.uint16]:
    """Tables of CRC-16/MCRF4XX for eight bytes at a time ("slicing by 8", Kounavis and Berry 2005), shape (8 * 256,).

    Entry ``256 k + b`` is the register after byte b and k zero bytes.
    """
    tables = np.zeros((8, 256), np.uint16)
    register = np.arange(256, dtype=np.uint16)
    for _ in range(8):
        register = np.where(register & 1, (register >> 1) ^ 0x8408, register >> 1).astype(np.uint16)
    tables[0] = register
    for k in range(1, 8):
        tables[k] = (tables[k - 1] >> 8) ^ tables[0][tables[k - 1] & 0xFF]
    return tables.ravel()


@njit(inline="always")
def _u16(data: Array, p: Int) -> Int:
    return np.uint16(data[p]) | (np.uint16(data[p + _U(1)]) << np.uint16(8))


@njit(inline="always")
def _u32(data: Array, p: Int) -> Int:
    # LLVM makes one load of this.
    return (
        np.uint32(data[p])
        | (np.uint32(data[p + _U(1)]) << np.uint32(8))
        | (np.uint32(data[p + _U(2)]) << np.uint32(16))
        | (np.uint32(data[p + _U(3)]) << np.uint32(24))
    )


@njit(inline="always")
def _u64(data: Array, p: Int) -> Int:
    return np.uint64(_u32(data, p)) | (np.uint64(_u32(data, p + _U(4))) << _U(32))


@njit(inline="always")
def _stamp(data: Array, mark: Int) -> Int:
    """Logger time before the frame at `mark`, us: eight bytes, the highest first."""
    stamp = _U(0)
    for k in range(8):
        stamp = (stamp << _U(8)) | np.uint64(data[mark - _U(8) + _U(k)])
    return np.int64(stamp)


@njit(inline="always")
def _cut_uint(data: Array, p: Int, present: Int, width: Int) -> Int:
    """Little-endian integer of `width` bytes of which only `present` were sent; the rest are zero."""
    value = _U(0)
    for k in range(min(present, width)):
        value |= np.uint64(data[p + _U(k)]) << _U(8 * k)
    return value


@njit(inline="always")
def _eight_bytes(tables: Array, word: Int) -> Int:
    """Register after eight bytes that have been combined with the register before them."""
    return (
        tables[_U(0x700) | (word & _U(0xFF))]
        ^ tables[_U(0x600) | ((word >> _U(8)) & _U(0xFF))]
        ^ tables[_U(0x500) | ((word >> _U(16)) & _U(0xFF))]
        ^ tables[_U(0x400) | ((word >> _U(24)) & _U(0xFF))]
        ^ tables[_U(0x300) | ((word >> _U(32)) & _U(0xFF))]
        ^ tables[_U(0x200) | ((word >> _U(40)) & _U(0xFF))]
        ^ tables[_U(0x100) | ((word >> _U(48)) & _U(0xFF))]
        ^ tables[word >> _U(56)]
    )


@njit(inline="always")
def _checksum(data: Array, start: Int, size: Int, extra: Int, tables: Array) -> Int:
    """Checksum of `size` bytes from `start`, and the definition's extra byte.

    Zeros before a message leave a zero register at zero, and the register's initial value 0xFFFF does the same as
    inverting the first two bytes. So the message is filled up in front to a multiple of eight, and needs no
    byte-by-byte end; the bytes that really stand before it are shifted out.
    """
    pad = (_U(0) - size) & _U(7)
    p = start - pad
    if start < pad:
        register = np.uint16(0xFFFF)
        for k in range(size):
            register = tables[_U((register ^ np.uint16(data[start + _U(k)])) & np.uint16(0xFF))] ^ (
                register >> np.uint16(8)
            )
    else:
        bits = pad << _U(3)
        word = ((_u64(data, p) >> bits) << bits) ^ (_U(0xFFFF) << bits)
        register = _eight_bytes(tables, word)
        if pad == _U(7):
            # The second inverted byte is already in the next eight.
            register ^= np.uint16(0xFF)
        p += _U(8)
        end = start + size
        while p < end:
            register = _eight_bytes(tables, _u64(data, p) ^ np.uint64(register))
            p += _U(8)
    return tables[_U((register ^ np.uint16(extra)) & np.uint16(0xFF))] ^ (register >> np.uint16(8))


@njit(inline="always")
def _frame(data: Array, mark: Int, size: Int, slot_of_id: Array) -> tuple[Int, Int, Int]:
    """Header of the frame at `mark`: its message's slot (-1 unknown, -2 no frame), checksummed bytes and end."""
    if mark + _U(8) > size:
        return -2, _U(0), _U(0)
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
        return -2, _U(0), _U(0)
    if end > size:
        return -2, _U(0), _U(0)
    slot = np.int64(slot_of_id[number]) if number < np.uint64(slot_of_id.size) else -1
    return slot, body, end


@njit(inline="always")
def _intact(data: Array, mark: Int, slot: Int, body: Int, crc_extra: Array, tables: Array) -> Any:
    checksum = _checksum(data, mark + _U(1), body, crc_extra[slot], tables)
    return checksum == _u16(data, mark + _U(1) + body)


@njit(cache=True, nogil=True)
def find_frame(data: Array, start: Int, slot_of_id: Array, crc_extra: Array, tables: Array) -> Int:
    """Find where the first intact frame of a known message from `start` on begins; the end if there is none."""
    size = np.uint64(data.size)
    mark = np.uint64(start)
    while mark < size:
        if data[mark] == _MARK_V1 or data[mark] == _MARK_V2:
            slot, body, _ = _frame(data, mark, size, slot_of_id)
            if slot >= 0 and _intact(data, mark, slot, body, crc_extra, tables):
                return mark
        mark += _U(1)
    return size


@njit(cache=True, nogil=True)
def scan(
    data: Array, stamp_bytes: Int, slot_of_id: Array, crc_extra: Array, tables: Array, boot_field: Array,
    heartbeat: Int, window_ms: Int, state: Array, offsets: Array, slots: Array, breaks: Array, unknown: Array,
    bad_by_slot: Array, last_seq: Array, link_frames: Array, link_lost: Array, link_votes: Array,
    open_windows: Array, windows: Array,
) -> tuple[int, int]:  # fmt: skip
    """Walk the stream from the state's position until `offsets` or `windows` is full or the stream ends.

    Parameters
    ----------
    data : uint8 array
    stamp_bytes : int
        Bytes of logger time before each frame: 8, or 0 in a raw stream.
    slot_of_id : int16 array
        Slot of each message id, -1 where there is none.
    crc_extra : uint16 array, shape (n_slots,)
    tables : uint16 array
        See `checksum_tables`.
    boot_field : int64 array, shape (n_slots,)
        Where ``time_boot_ms`` begins in the payload; -1 where there is none.
    heartbeat : int
        Slot of HEARTBEAT.
    window_ms : int
        Length of a clock window on the boot clock, ms.
    state : int64 array, shape (STATE_SIZE,)
        In and out.
    offsets : unsigned array
        Out: position of the start byte of each intact frame.
    slots : uint16 array, like `offsets`
        Out: its message.
    breaks : int64 array, shape (n, 2)
        Out: the first n spans without an intact frame.
    unknown : int64 array, shape (n, 2)
        Out: ids without a definition, and how many of each; the last row collects all further ids.
    bad_by_slot, last_seq, link_frames, link_lost, link_votes, open_windows
        In and out: frames with a wrong checksum by message; by link the last sequence number (-1: none yet), intact
        frames, frames lost, heartbeats of an autopilot, clock window.
    windows : int64 array, shape (n, 1 + WINDOW_SIZE)
        Out: closed clock windows.

    Returns
    -------
    n_frames, n_windows : int
    """
    size = np.uint64(data.size)
    prefix = np.uint64(stamp_bytes)
    position = np.uint64(state[POSITION])
    n = 0
    n_windows = 0
    while position < size and n < offsets.size and n_windows < windows.shape[0]:
        mark = position + prefix
        slot, body, end = _frame(data, mark, size, slot_of_id)
        stamped = stamp_bytes == 8
        good = slot >= 0 and _intact(data, mark, slot, body, crc_extra, tables)
        if slot == -1:
            # Without its definition the checksum cannot be verified: what follows must look right.
            next_slot, next_body, _ = _frame(data, end + prefix, size, slot_of_id)
            if (
                end + prefix + _U(8) > size
                or next_slot == -1
                or (next_slot >= 0 and _intact(data, end + prefix, next_slot, next_body, crc_extra, tables))
            ):
                number = np.int64(data[mark + _U(5)])
                if data[mark] == _MARK_V2:
                    number = np.int64(_u32(data, mark + _U(7)) & np.uint32(0xFFFFFF))
                row = 0
                while row < unknown.shape[0] - 1 and unknown[row, 1] > 0 and unknown[row, 0] != number:
                    row += 1
                unknown[row, 0] = number
                unknown[row, 1] += 1
                position = end
                continue
        if not good:
            mark = find_frame(data, position, slot_of_id, crc_extra, tables)
            if mark == size:
                state[TAIL] = np.int64(position)
                position = size
                break
            if slot >= 0 and mark + _U(1) > end + prefix:
                # The next frame begins where this one says, so it was a frame.
                state[BAD_CHECKSUMS] += 1
                bad_by_slot[slot] += 1
            begin = mark - prefix
            if mark < position + prefix:
                begin = position
                stamped = False
            if state[BREAKS] < breaks.shape[0]:
                breaks[state[BREAKS], 0] = np.int64(position)
                breaks[state[BREAKS], 1] = np.int64(begin)
            state[BREAKS] += 1
            state[STRAY_BYTES] += np.int64(begin - position)
            slot, body, end = _frame(data, mark, size, slot_of_id)

        offsets[n] = mark
        slots[n] = slot
        n += 1
        position = end
        if data[mark] == _MARK_V1:
            state[FRAMES_V1] += 1
            who = mark + _U(2)
            payload = mark + _U(6)
        else:
            state[FRAMES_V2] += 1
            state[SIGNED] += np.int64(data[mark + _U(2)] & np.uint8(1))
            who = mark + _U(4)
            payload = mark + _U(10)
        link = (np.uint64(data[who + _U(1)]) << _U(8)) | np.uint64(data[who + _U(2)])
        seq = np.int64(data[who])
        link_frames[link] += 1
        if last_seq[link] >= 0:
            link_lost[link] += (seq - last_seq[link] - 1) & 0xFF
        last_seq[link] = seq
        # Neither a ground station (MAV_TYPE 6) nor something without an autopilot (MAV_AUTOPILOT 8).
        whole = slot == heartbeat and data[mark + _U(1)] >= 6
        if whole and data[payload + _U(4)] != 6 and data[payload + _U(5)] != 8:
            link_votes[link] += 1

        if boot_field[slot] < 0:
            continue
        present = np.int64(data[mark + _U(1)]) - boot_field[slot]
        boot = np.int64(_cut_uint(data, payload + _U(boot_field[slot]), present, 4))
        if boot == 0:
            continue
        stamp = boot * 1000
        if stamp_bytes == 8:
            if not stamped:
                continue
            stamp = _stamp(data, mark)
        delay = stamp - boot * 1000
        window = open_windows[link]
        if window[SAMPLES] > 0:
            if (
                boot < window[FIRST_BOOT] + window_ms
                and boot > window[LAST_BOOT] - RESTART_MS
                and abs(delay - window[DELAY]) < _DELAY_TOLERANCE_US
            ):
                window[LAST_OFFSET] = np.int64(mark)
                window[LAST_BOOT] = max(window[LAST_BOOT], boot)
                window[DELAY] = min(window[DELAY], delay)
                window[SAMPLES] += 1
                continue
            windows[n_windows, 0] = np.int64(link)
            for k in range(WINDOW_SIZE):
                windows[n_windows, 1 + k] = window[k]
            n_windows += 1
        window[FIRST_OFFSET] = np.int64(mark)
        window[LAST_OFFSET] = np.int64(mark)
        window[FIRST_BOOT] = boot
        window[LAST_BOOT] = boot
        window[DELAY] = delay
        window[SAMPLES] = 1
    state[POSITION] = np.int64(position)
    return n, n_windows


@njit(cache=True, nogil=True)
def sort_by_slot(offsets: Array, slots: Array, n_slots: Int) -> tuple[Array, Array]:
    """Sort a chunk of frames by message, keeping the order of the stream within each.

    Returns
    -------
    ordered : like `offsets`
    starts : int32 array, shape (n_slots + 1,)
        Where each message's frames begin in `ordered`.
    """
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


@njit(inline="always")
def _logger_time(data: Array, mark: Int, stamped: Int, knots: Array, knot: Int) -> Int:
    """Boot time of the frame at `mark` by the stream alone, us."""
    first, after = knots[knot, KNOT_FIRST], knots[knot, KNOT_NEXT]
    if not stamped:
        begin = knots[knot, KNOT_OFFSET]
        stretch = (knots[knot + 1, KNOT_OFFSET] if knot + 1 < knots.shape[0] else np.int64(data.size)) - begin
        return first + np.int64((after - first) * ((np.int64(mark) - begin) / max(stretch, 1)))
    if mark < _U(8):
        return first
    # A damaged stamp does no more harm than one clock window.
    return min(max(_stamp(data, mark) - knots[knot, KNOT_DELAY], first), after)


@njit(inline="always")
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


@njit(cache=True, nogil=True)
def decode(
    data: Array, ordered: Array, starts: Array, first_mark: Int, last_mark: Int, stamped: Int, autopilot: Int,
    knots: Array, slots: Array, clock_kind: Array, clock_offset: Array, first_field: Array, field_offset: Array,
    field_width: Array, column: Array, t_column: Array, sender_column: Array, row: Array,
    arena8: Array, arena16: Array, arena32: Array, arena64: Array, arena_f64: Array,
) -> None:  # fmt: skip
    """Decode the frames of some messages in one chunk of the stream into columns.

    Parameters
    ----------
    data : uint8 array
    ordered, starts
        The chunk's frames (see `sort_by_slot`).
    first_mark, last_mark : int
        Only frames that begin at or after the first and before the last.
    stamped : bool
        Whether logger time stands before each frame.
    autopilot : int
        The link whose own times are on the boot clock.
    knots : int64 array, shape (n_knots, 4)
        See `tlog_clock`.
    slots : int64 array, shape (n_messages,)
        Messages wanted.
    clock_kind, clock_offset : int64 arrays, shape (n_messages,)
        How and where in the payload each message tells its own time.
    first_field : int64 array, shape (n_messages + 1,)
        Where each message's fields begin in the arrays that follow.
    field_offset, field_width : int64 arrays
        Where each column's element stands in an untruncated payload, and its bytes (1, 2, 4 or 8).
    column : int64 array
        Where each column begins in the arena, in elements of its width.
    t_column, sender_column : int64 arrays, shape (n_messages,)
        Likewise for the boot time [s, float64], and for the system [uint8]; the component is in the column after it.
    row : int64 array, shape (n_messages, 2)
        In and out: rows of each message written so far; and in: rows that there are in all.
    arena8, arena16, arena32, arena64, arena_f64
        One piece of memory seen as numbers of each width; out.
    """
    payload: Any = np.empty(_BLOCK_ROWS, np.uint64)
    present: Any = np.empty(_BLOCK_ROWS, np.int64)
    shortest: Any
    n_knots = knots.shape[0]
    for m in range(slots.size):
        begin, stop = np.int64(starts[slots[m]]), np.int64(starts[slots[m] + 1])
        while begin < stop and np.int64(ordered[begin]) < first_mark:
            begin += 1
        while begin < stop and np.int64(ordered[stop - 1]) >= last_mark:
            stop -= 1
        if begin == stop:
            continue
        knot = _knot_at(knots, np.int64(ordered[begin]))
        for low in range(begin, stop, _BLOCK_ROWS):
            rows: Any = min(stop - low, _BLOCK_ROWS)
            target = row[m, 0]
            row[m, 0] += rows
            shortest = np.int64(255)
            for k in range(rows):
                mark = np.uint64(ordered[low + k])
                length = np.int64(data[mark + _U(1)])
                who = mark + (_U(3) if data[mark] == _MARK_V1 else _U(5))
                start = mark + (_U(6) if data[mark] == _MARK_V1 else _U(10))
                payload[k] = start
                present[k] = length
                shortest = min(shortest, length)
                sender = _U(sender_column[m] + target + k)
                arena8[sender] = data[who]
                arena8[sender + _U(row[m, 1])] = data[who + _U(1)]
                while knot + 1 < n_knots and np.uint64(knots[knot + 1, KNOT_OFFSET]) <= mark:
                    knot += 1
                time = _logger_time(data, mark, stamped, knots, knot)
                link = (np.int64(data[who]) << 8) | np.int64(data[who + _U(1)])
                if clock_kind[m] != CLOCK_NONE and link == autopilot:
                    width = 8 if clock_kind[m] == CLOCK_US64 else 4
                    own = np.int64(_cut_uint(data, start + _U(clock_offset[m]), length - clock_offset[m], width))
                    given = own != 0
                    if clock_kind[m] == CLOCK_BOOT_MS:
                        own *= 1000
                    elif clock_kind[m] == CLOCK_US32:
                        # 32 bits of microseconds come round every 72 minutes.
                        own += ((time - own + (1 << 31)) >> 32) << 32
                    low_limit = knots[knot, KNOT_FIRST] - _OWN_TIME_TOLERANCE_US
                    if given and low_limit < own < knots[knot, KNOT_NEXT] + _OWN_TIME_TOLERANCE_US:
                        time = own
                arena_f64[_U(t_column[m] + target + k)] = time / 1e6

            for f in range(first_field[m], first_field[m + 1]):
                offset = _U(field_offset[f])
                out = _U(column[f] + target)
                width = field_width[f]
                whole = field_offset[f] + width <= shortest
                # MAVLink 2 omits zeros at the end of a payload.
                if width == 1:
                    for k in range(rows):
                        sent = present[k] - field_offset[f]
                        arena8[out + _U(k)] = data[payload[k] + offset] if sent >= 1 else np.uint8(0)
                elif width == 2:
                    if whole:
                        for k in range(rows):
                            arena16[out + _U(k)] = _u16(data, payload[k] + offset)
                    else:
                        for k in range(rows):
                            sent = present[k] - field_offset[f]
                            arena16[out + _U(k)] = _cut_uint(data, payload[k] + offset, sent, 2)
                elif width == 4:
                    if whole:
                        for k in range(rows):
                            arena32[out + _U(k)] = _u32(data, payload[k] + offset)
                    else:
                        for k in range(rows):
                            sent = present[k] - field_offset[f]
                            p = payload[k] + offset
                            arena32[out + _U(k)] = (
                                _u32(data, p) if sent >= 4 else np.uint32(_cut_uint(data, p, sent, 4))
                            )
                elif whole:
                    for k in range(rows):
                        arena64[out + _U(k)] = _u64(data, payload[k] + offset)
                else:
                    for k in range(rows):
                        sent = present[k] - field_offset[f]
                        arena64[out + _U(k)] = _cut_uint(data, payload[k] + offset, sent, 8)


@njit(cache=True, nogil=True)
def copy_text(data: Array, marks: Array, offset: Int, out: Array) -> None:
    """Copy a ``char`` array of each frame into the zeroed rows of `out`, shape (n, width), up to its first zero."""
    width = out.shape[1]
    for k in range(marks.size):
        mark = np.uint64(marks[k])
        start = mark + (_U(6) if data[mark] == _MARK_V1 else _U(10)) + _U(offset)
        for j in range(min(width, np.int64(data[mark + _U(1)]) - offset)):
            byte = data[start + _U(j)]
            if byte == 0:
                break
            out[k, j] = byte
