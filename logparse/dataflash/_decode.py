"""Kernels of the DataFlash reader: follow the header chain, and gather fields into columns.

Plain arrays go in and out. `data` is the whole file; `slots` says for each message, in file order, which definition
(FMT row) it follows; `positions` where the messages of each definition are.
"""

from typing import Annotated, Any

import numpy as np
import numpy.typing as npt

from core.compiled import inner, njit
from core.kernel_types import (
    ByteRows,
    Bytes,
    FileBytes,
    Int32Rows,
    Int32s,
    Int64Rows,
    Int64s,
    Uint16s,
    Uint32s,
    Uint64s,
)

#: Number of each message's definition. Files with more than 256 of them are seldom.
Slots = Annotated[npt.NDArray[np.uint8] | npt.NDArray[np.uint16], np.empty(0, np.uint8)]
#: Bytes of messages; those of files above 4 GB in eight bytes each.
Positions = Annotated[npt.NDArray[np.uint32] | npt.NDArray[np.uint64], np.empty(0, np.uint32)]
#: numba tells integer widths apart where the type checker need not.
Int = Any

# Why `follow_chain` came back.
LIMIT = 0
NEW_FORMAT = 1
END_OF_FILE = 2
OUTPUT_FULL = 3

# Indices into `follow_chain`'s state.
POSITION = 0
COUNT = 1
RUNS = 2
BOOTS = 3
LOST = 4
TIME = 5
HAVE_TIME = 6
PENDING = 7
PENDING_TIME = 8
PENDING_FIRST = 9
PENDING_INDEX = 10
PENDING_POSITION = 11
FORMAT_INDEX = 12
FORMAT_POSITION = 13
TIMED_IN_BOOT = 14
BOOT_START = 15
TRUNCATED = 16
LOG_BEGINS = 17
STATE_SIZE = 18

#: A clock may step back by this much, us, and still be the same boot (rows of slow tasks are written late).
BACK_US = 5_000_000
#: A clock may jump ahead by this much, us, from one row to the next without a second look. Less than `BACK_US`, so
#: that after a damaged time stamp the next rows do not seem to be of another boot.
AHEAD_US = 4_000_000
#: Rows after a pause are of one clock when they follow each other within this time, us.
PAUSE_US = 3_600_000_000
#: So many rows in a row must agree on another clock before it is believed.
AGREEING = 5

_BLOCK_BYTES = 256 * 1024


@inner(nogil=True)
def _u16(data: Bytes, p: Int) -> Int:
    return np.uint16(data[p]) | (np.uint16(data[p + np.uint64(1)]) << np.uint16(8))


@inner(nogil=True)
def _u32(data: Bytes, p: Int) -> Int:
    # LLVM makes one load of this.
    return (
        np.uint32(data[p])
        | (np.uint32(data[p + np.uint64(1)]) << np.uint32(8))
        | (np.uint32(data[p + np.uint64(2)]) << np.uint32(16))
        | (np.uint32(data[p + np.uint64(3)]) << np.uint32(24))
    )


@inner(nogil=True)
def _u64(data: Bytes, p: Int) -> Int:
    return np.uint64(_u32(data, p)) | (np.uint64(_u32(data, p + np.uint64(4))) << np.uint64(32))


@inner(nogil=True)
def _time_us(data: Bytes, p: Int, time_width: Int, time_offset: Int) -> Int:
    """Boot clock of the message at `p`, us; -1 where it has none or it cannot be."""
    if time_width == 8:
        t = _u64(data, p + np.uint64(time_offset))
        # Beyond ten thousand years the clock is not a clock.
        return np.int64(t) if t < np.uint64(1 << 58) else np.int64(-1)
    if time_width == 4:
        t = _u32(data, p + np.uint64(time_offset))
        # Milliseconds of the receiver's week, the clock of old firmware, are zero before its first fix.
        return np.int64(t) * np.int64(1000) if t != np.uint32(0) else np.int64(-1)
    return np.int64(-1)


@inner(nogil=True)
def _is_header(data: Bytes, p: Int, n: Int) -> Any:
    """Whether a message may begin at `p`: a header, or as much of one as the file still holds."""
    if p >= n:
        return p == n
    return data[p] == 0xA3 and (p + np.uint64(1) == n or data[p + np.uint64(1)] == 0x95)


@inner(nogil=True)
def _ends_whole(data: Bytes, end: Int, beyond: Int) -> Any:
    """Whether a message is whole that ends where none begins, before the next one `beyond`.

    It is where it is the last, or where half a header follows: the damage is behind it. Otherwise its own id may be
    what is damaged, or its end is missing.
    """
    n = np.uint64(data.size)
    return end <= beyond and (beyond == n or data[end] == 0xA3 or data[end + np.uint64(1)] == 0x95)


@njit(cache=True, nogil=True)
def find_chained(data: Bytes, start: Int, candidates: Int32s, length: Int32s) -> Int:
    """Find the first position from `start` where a known message begins whose end is another header or the file's."""
    n = np.uint64(data.size)
    p = np.uint64(start)
    while p + np.uint64(2) < n:
        if data[p] == 0xA3 and data[p + np.uint64(1)] == 0x95:
            for k in range(candidates.shape[1]):
                slot = candidates[data[p + np.uint64(2)], k]
                if slot < 0:
                    break
                end = p + np.uint64(length[slot])
                # At the very end of the file a fragment of a header proves nothing.
                if end == n or (end + np.uint64(1) < n and data[end] == 0xA3 and data[end + np.uint64(1)] == 0x95):
                    return np.int64(p)
        p += np.uint64(1)
    return np.int64(n)


@njit(cache=True, nogil=True)
def follow_chain(
    data: FileBytes, limit: int, candidates: Int32Rows, length: Int32s, time_width: Int32s, time_offset: Int32s,
    fmt_rows: ByteRows, slots: Slots, run_index: Int64s, run_position: Int64s, gap_start: Int64s,
    gap_stop: Int64s, boots: Int64Rows, unknown: Int64s, state: Int64s,
) -> int:  # fmt: skip
    """Follow the headers from the state's position up to `limit`; note definitions, breaks and boots on the way.

    Parameters
    ----------
    candidates : int32 array, shape (256, k)
        Definitions to try for each id, in this order, then -1.
    fmt_rows : uint8 array, shape (256, 86)
        Payload of the FMT row in force for each id; another one makes the kernel return `NEW_FORMAT`.
    boots : int64 array, shape (k, 4)
        Output: first message, its byte, first and last time [us] of each boot that ended.
    unknown : int64 array, shape (256,)
        Output: headers of ids without a definition, where the chain met one.
    state : int64 array, shape (STATE_SIZE,)
        Where to go on; carried from call to call.

    Returns
    -------
    int
        LIMIT, NEW_FORMAT, END_OF_FILE or OUTPUT_FULL.
    """
    n = np.uint64(data.size)
    p = np.uint64(state[POSITION])
    count = state[COUNT]
    runs = state[RUNS]
    result = LIMIT
    clock = state[TIME]
    timed = state[TIMED_IN_BOOT]
    quiet = state[HAVE_TIME] != 0 and state[PENDING] == 0 and state[FORMAT_INDEX] < 0
    # By id, for the usual message: the definition to try first. FMT rows are never usual.
    slot_of_id = np.zeros(256, slots.dtype)
    length_of_id = np.zeros(256, np.uint64)
    clock_of_id = np.zeros(256, np.uint64)
    for k in range(256):
        slot = candidates[k, 0]
        if slot >= 0 and k != 128 and time_width[slot] != 4:
            slot_of_id[k] = slot
            length_of_id[k] = length[slot]
            clock_of_id[k] = time_offset[slot] if time_width[slot] == 8 else 0
    # The longest message and a header behind it lie before the end of the file.
    usual_end = np.uint64(max(0, min(limit, data.size - 258)))
    room = np.uint64(max(0, slots.size - 2))
    while p < np.uint64(limit):
        if quiet and p < usual_end and data[p] == 0xA3 and data[p + np.uint64(1)] == 0x95:
            free = np.uint64(count)
            before = free
            while p < usual_end and free < room:
                message_id = data[p + np.uint64(2)]
                end = p + length_of_id[message_id]
                # An unusual id has length 0 here, and what follows is then this very header.
                if end == p or data[end] != 0xA3 or data[end + np.uint64(1)] != 0x95:
                    break
                place = clock_of_id[message_id]
                if place != 0:
                    t = np.int64(_u64(data, p + place))
                    step = t - clock
                    if step < -BACK_US or step > AHEAD_US:
                        break
                    clock = max(clock, t)
                    timed += 1
                slots[free] = slot_of_id[message_id]
                free += np.uint64(1)
                p = end
            count += np.int64(free - before)
            if p >= np.uint64(limit):
                break
        if count + 1 >= slots.size or runs + 1 >= run_index.size or state[BOOTS] + 1 >= boots.shape[0]:
            result = OUTPUT_FULL
            break
        skip_to = np.int64(-1)
        chosen = np.int32(-1)
        if p + np.uint64(3) > n:
            skip_to = np.int64(n)
            state[TRUNCATED] = np.int64(p)
        elif data[p] != 0xA3 or data[p + np.uint64(1)] != 0x95:
            skip_to = find_chained(data, p, candidates, length)
        else:
            message_id = data[p + np.uint64(2)]
            first = candidates[message_id, 0]
            fits = False
            for k in range(candidates.shape[1]):
                slot = candidates[message_id, k]
                if slot < 0:
                    break
                end = p + np.uint64(length[slot])
                if end <= n:
                    fits = True
                    if _is_header(data, end, n):
                        chosen = slot
                        break
            if chosen < 0:
                # The chain breaks here: either this message is cut short or grown, or what follows it is damaged.
                if first < 0:
                    unknown[data[p + np.uint64(2)]] += 1
                elif not fits:
                    state[TRUNCATED] = np.int64(p)
                skip_to = find_chained(data, p + np.uint64(1), candidates, length)
                if fits and _ends_whole(data, p + np.uint64(length[first]), np.uint64(skip_to)):
                    chosen = first
        if chosen >= 0:
            if data[p + np.uint64(2)] == 128:
                same = True
                for k in range(86):
                    if fmt_rows[data[p + np.uint64(3)], k] != data[p + np.uint64(3 + k)]:
                        same = False
                        break
                if not same:
                    result = NEW_FORMAT
                    break
                if state[FORMAT_INDEX] < 0:
                    state[FORMAT_INDEX] = count
                    state[FORMAT_POSITION] = np.int64(p)
                    quiet = False
                if data[p + np.uint64(3)] == 128:
                    state[LOG_BEGINS] = 1
            width = time_width[chosen]
            if width != 0:
                t = _time_us(data, p, width, time_offset[chosen])
                step = t - clock
                if t >= 0 and -BACK_US <= step <= AHEAD_US and quiet:
                    # The usual row; what `_advance_clock` would do, without its arrays.
                    clock = max(clock, t)
                    timed += 1
                elif t >= 0:
                    state[TIME] = clock
                    state[TIMED_IN_BOOT] = timed
                    _advance_clock(t, count, np.int64(p), boots, state)
                    clock = state[TIME]
                    timed = state[TIMED_IN_BOOT]
                    quiet = state[HAVE_TIME] != 0 and state[PENDING] == 0 and state[FORMAT_INDEX] < 0
            slots[count] = chosen
            count += 1
            p += np.uint64(length[chosen])
        if skip_to >= 0:
            if np.uint64(skip_to) > p:
                gap_start[runs] = np.int64(p)
                gap_stop[runs] = skip_to
                run_index[runs] = count
                run_position[runs] = skip_to
                runs += 1
            p = np.uint64(skip_to)
    if p >= n and result == LIMIT:
        result = END_OF_FILE
    state[TIME] = clock
    state[TIMED_IN_BOOT] = timed
    state[POSITION] = np.int64(p)
    state[COUNT] = count
    state[RUNS] = runs
    return result


@inner(nogil=True)
def _advance_clock(t: Int, index: Int, position: Int, boots: Int64s, state: Int64s) -> None:
    """Follow the boot clock; a lasting step back is a new boot, a lone odd time stamp is not.

    Nor is a pause, but where a log begins anew with the FMT row of FMT.
    """
    if state[HAVE_TIME] == 0:
        state[HAVE_TIME] = 1
        state[TIME] = t
        state[BOOT_START] = t
        state[TIMED_IN_BOOT] = 1
        state[PENDING] = 0
        state[FORMAT_INDEX] = -1
        state[LOG_BEGINS] = 0
        return
    step = t - state[TIME]
    if -BACK_US <= step <= AHEAD_US:
        if step > 0:
            state[TIME] = t
        state[TIMED_IN_BOOT] += 1
        state[PENDING] = 0
        state[FORMAT_INDEX] = -1
        state[LOG_BEGINS] = 0
        return
    if state[PENDING] > 0 and -BACK_US <= t - state[PENDING_TIME] <= PAUSE_US:
        state[PENDING] += 1
        if t > state[PENDING_TIME]:
            state[PENDING_TIME] = t
    else:
        state[PENDING] = 1
        state[PENDING_TIME] = t
        state[PENDING_FIRST] = t
        # The FMT rows with which a new log begins carry no time but belong to the new boot.
        if state[FORMAT_INDEX] >= 0:
            state[PENDING_INDEX] = state[FORMAT_INDEX]
            state[PENDING_POSITION] = state[FORMAT_POSITION]
        else:
            state[PENDING_INDEX] = index
            state[PENDING_POSITION] = position
    if state[PENDING] < AGREEING:
        return
    if state[PENDING_FIRST] < state[TIME] - BACK_US or state[LOG_BEGINS] != 0:
        if state[TIMED_IN_BOOT] >= AGREEING:
            k = state[BOOTS]
            boots[k, 2] = state[BOOT_START]
            boots[k, 3] = state[TIME]
            boots[k + 1, 0] = state[PENDING_INDEX]
            boots[k + 1, 1] = state[PENDING_POSITION]
            state[BOOTS] = k + 1
        # Otherwise the few rows so far were the odd ones.
        state[BOOT_START] = state[PENDING_FIRST]
        state[TIMED_IN_BOOT] = 0
    state[TIME] = state[PENDING_TIME]
    state[TIMED_IN_BOOT] += state[PENDING]
    state[PENDING] = 0
    state[FORMAT_INDEX] = -1
    state[LOG_BEGINS] = 0


@njit(cache=True, nogil=True)
def index_messages(
    slots: Slots, length: Int32s, run_index: Int64s, run_position: Int64s, first: Int64s, positions: Positions
) -> None:
    """Write the byte of every message, definition by definition.

    Parameters
    ----------
    run_index, run_position : int64 arrays
        Messages behind a break of the chain, and their bytes.
    first : int64 array, shape (definitions + 1,)
        Output: the messages of definition k are ``first[k]`` to ``first[k + 1] - 1`` of `positions`.
    """
    for k in range(slots.size):
        first[slots[k] + 1] += 1
    for k in range(1, first.size):
        first[k] += first[k - 1]
    fill = first.copy()
    position = np.int64(0)
    run = 0
    for index in range(slots.size):
        while run < run_index.size and run_index[run] == index:
            position = run_position[run]
            run += 1
        slot = slots[index]
        positions[fill[slot]] = position
        fill[slot] += 1
        position += length[slot]


@njit(cache=True, nogil=True)
def gather(
    data: FileBytes, positions: Positions, stop: int, row: Int64s, last: Int64s, first_field: Int64s, offset: Int64s,
    size: Int64s, target: Int64s, bytes_out: Bytes, out_2: Uint16s, out_4: Uint32s, out_8: Uint64s,
) -> None:  # fmt: skip
    """Copy the fields of messages before byte `stop` into columns, block by block so that a block stays in the cache.

    Parameters
    ----------
    row, last : int64 arrays, shape (tables,)
        Table k has the messages at ``positions[row[k]:last[k]]``; `row` is moved on to the first that is left.
    first_field : int64 array, shape (tables + 1,)
        The fields of table k are ``first_field[k]`` to ``first_field[k + 1] - 1`` of `offset` (in the message), `size`
        and `target`.
    target : int64 array, shape (fields,)
        Byte of `bytes_out`, which the other outputs show as wider numbers, for the next value of a field; moved on.
    """
    while True:
        block = np.int64(stop)
        for table in range(row.size):
            if row[table] < last[table]:
                block = min(block, np.int64(positions[row[table]]))
        if block == stop:
            return
        end = min(block + _BLOCK_BYTES, stop)
        for table in range(row.size):
            # Unsigned all over: numba checks signed indices for being negative.
            a = np.uint64(row[table])
            b = a
            while b < np.uint64(last[table]) and positions[b] < end:
                b += np.uint64(1)
            if b == a:
                continue
            m = b - a
            for f in range(first_field[table], first_field[table + 1]):
                o = np.uint64(offset[f])
                begin = np.uint64(target[f])
                width = np.uint64(size[f])
                if width == 4:
                    to = begin // np.uint64(4)
                    for k in range(m):
                        out_4[to + k] = _u32(data, np.uint64(positions[a + k]) + o)
                elif width == 8:
                    to = begin // np.uint64(8)
                    for k in range(m):
                        out_8[to + k] = _u64(data, np.uint64(positions[a + k]) + o)
                elif width == 2:
                    to = begin // np.uint64(2)
                    for k in range(m):
                        out_2[to + k] = _u16(data, np.uint64(positions[a + k]) + o)
                elif width == 1:
                    for k in range(m):
                        bytes_out[begin + k] = data[np.uint64(positions[a + k]) + o]
                else:
                    for k in range(m):
                        for c in range(width):
                            bytes_out[begin + k * width + c] = data[np.uint64(positions[a + k]) + o + c]
                target[f] += np.int64(m * width)
            row[table] = np.int64(b)
