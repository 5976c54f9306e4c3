"""Follow the chain of message headers through a DataFlash log.

A message is as long as its definition (FMT row) says, so that one header leads to the next. Where it does not, the file
is damaged, and the chain goes on at the next position where a known header is followed, one message on, by another
header: payloads can hold bytes that look like one header, hardly two at the right distance.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from logparse.containers import Buffer, MappedPages
from logparse.dataflash import _decode
from logparse.dataflash.format import FMT, FMT_ID, FMT_LENGTH, Definition, Field, UnitTable, boot_clock
from logparse.source import Boot

#: A last row on its own is of this boot when it is at most so much later than the one before, us.
_LAST_PAUSE_US = 60_000_000


def boots_of(rows: npt.NDArray[np.int64], state: npt.NDArray[np.int64], size: int) -> tuple[Boot, ...]:
    """Return the boots of a file of `size` bytes."""
    n = int(state[_decode.BOOTS])
    rows = rows[: n + 1].copy()
    rows[n, 2:] = state[_decode.BOOT_START], state[_decode.TIME]
    ahead = int(state[_decode.PENDING_TIME] - state[_decode.TIME])
    if 0 < ahead <= (_decode.PAUSE_US if state[_decode.PENDING] > 1 else _LAST_PAUSE_US) and state[_decode.PENDING] > 0:
        # The last rows came after a pause and were too few to be sure of; nothing speaks against them.
        rows[n, 3] = state[_decode.PENDING_TIME]
    stops = [*rows[1:, 1].tolist(), size]
    return tuple(
        Boot(position, stop, start * 1e-6, end * 1e-6)
        for (_, position, start, end), stop in zip(rows.tolist(), stops, strict=True)
    )


_CHUNK = 1 << 22
#: Definitions that are told apart; ArduPilot has some 250, and only a made-up file has more than a few times that.
_MOST_SLOTS = 4096
#: Seconds that hold different rows where the blocks of one power-up meet in another order than they were written.
_MEETING = 3
#: Definitions of one id that are tried in turn: after a redefinition the one before may still be meant.
_CANDIDATES = 4

_KINDS = {"i": int, "u": int, "f": float, "S": bytes}

Int64s = npt.NDArray[np.int64]


@dataclass
class Slot:
    """One definition in force somewhere in the file."""

    definition: Definition
    length: int  #: Bytes of its messages with their header.
    since: int  #: Byte from which on it holds.
    #: One-letter ids of its FMTU row.
    units: str = ""
    multipliers: str = ""
    fields: tuple[Field, ...] = field(init=False)
    time: Field | None = field(init=False)  #: The one with the boot clock, which counts `time_scale` times a second.
    time_scale: int = field(init=False)

    def __post_init__(self) -> None:
        self.fields = self.definition.fields(self.length)
        self.time, self.time_scale = boot_clock(self.name, self.fields)

    @property
    def name(self) -> str:
        """Name of the message."""
        return self.definition.name or f"ID{self.definition.id}"

    @property
    def is_receivers_clock(self) -> bool:
        """Whether the clock is the week of the GPS receiver, in firmware that logs no other."""
        return self.time is not None and self.time.name == "Time"

    def scales(self, table: UnitTable) -> list[tuple[float, float]]:
        """Factor and divisor of each field."""
        ids = self.multipliers.ljust(len(self.fields), "-")
        return [table.scale(item, multiplier, self.time) for item, multiplier in zip(self.fields, ids, strict=False)]

    def unit_labels(self, table: UnitTable) -> dict[str, str]:
        """Name the unit of each field that has one."""
        return table.units(self.fields, self.units, self.time, self.time_scale)


class Chain:
    """All messages of a log: which definition each follows and where it is.

    Parameters
    ----------
    buffer : bytes or mmap
        The whole file.

    Attributes
    ----------
    data : ndarray of uint8
        The whole file.
    slots : list of Slot
        Definitions; a message names its own by its number here.
    positions : ndarray of uint32 or uint64, shape (messages,)
        Byte of every message, definition by definition.
    length, time_width, time_offset : ndarrays of int32
        By definition: bytes of a message, bytes and place of its boot clock (0: none).
    gap_start, gap_stop : ndarrays of int64
        Stretches of the file that hold no message.
    truncated_at : int
        Where a message begins that the end of the file cuts short; -1 where none does.
    unknown_ids : ndarray of int64, shape (256,)
        Headers met of each id that no FMT row explains.
    boots : tuple of Boot
        Power-ups in the file.
    shuffled : set of Boot
        Those whose blocks lie in the file in another order than they were written, or twice.
    contradictory : set of int
        Definitions whose length and format disagree.
    crowded : set of str
        Names of definitions that were too many to be told apart.
    """

    def __init__(self, buffer: Buffer):
        self.data = np.frombuffer(buffer, np.uint8)
        self.pages = MappedPages(buffer)
        self._scan(())
        # Messages may come before the FMT row that explains them where rows were lost: read again, knowing them.
        first_break = self.gap_stop[0] if len(self.gap_stop) else len(self.data)
        late = {slot.definition.id: slot for slot in reversed(self.slots) if slot.since >= first_break}
        if late:
            self._scan([(slot.definition, slot.length) for slot in late.values()])
        self.pages.release()

    def _scan(self, known: Sequence[tuple[Definition, int]], number: type[np.unsignedinteger[Any]] = np.uint8) -> None:
        """Follow the header chain through the whole file."""
        self.pages.start_at(0)
        self.crowded: set[str] = set()
        self.slots: list[Slot] = []
        self._most_slots = 256 if number is np.uint8 else _MOST_SLOTS
        self._candidates = np.full((256, _CANDIDATES), -1, np.int32)
        self.length = np.zeros(256, np.int32)
        self.time_width = np.zeros(256, np.int32)
        self.time_offset = np.zeros(256, np.int32)
        self._slot_keys: dict[tuple[Definition, int], int] = {}
        self.contradictory: set[int] = set()
        fmt_rows = np.zeros((256, FMT_LENGTH - 3), np.uint8)
        self._add_slot(FMT, FMT_LENGTH, 0)
        self._candidates[FMT_ID, 0] = 0
        for definition, length in known:
            self._add_candidate(definition.id, self._add_slot(definition, length, 0))

        state = np.zeros(_decode.STATE_SIZE, np.int64)
        state[_decode.FORMAT_INDEX] = -1
        state[_decode.TRUNCATED] = -1
        unknown = np.zeros(256, np.int64)
        runs = [np.zeros(1024, np.int64) for _ in range(4)]
        boots = np.zeros((64, 4), np.int64)
        # Grown in place: a copy of it would count in the memory that a large log needs.
        sequence = np.empty(len(self.data) // 64 + _CHUNK // 3 + 2, number)
        while True:
            if len(sequence) - int(state[_decode.COUNT]) < _CHUNK // 3 + 2:
                sequence.resize(len(sequence) + len(sequence) // 4 + _CHUNK // 3 + 2, refcheck=False)
            limit = min(int(state[_decode.POSITION]) + _CHUNK, len(self.data))
            result = _decode.follow_chain(
                self.data, limit, self._candidates, self.length, self.time_width, self.time_offset, fmt_rows,
                sequence, runs[0], runs[1], runs[2], runs[3], boots, unknown, state,
            )  # fmt: skip
            position = int(state[_decode.POSITION])
            if result == _decode.NEW_FORMAT:
                row = self.data[position : position + FMT_LENGTH].tobytes()
                fmt_rows[row[3]] = np.frombuffer(row, np.uint8)[3:]
                self._define(Definition.unpack(row), position)
                if len(self.slots) >= self._most_slots and number is np.uint8:
                    self._scan(known, np.uint16)
                    return
            elif result == _decode.OUTPUT_FULL:
                if int(state[_decode.RUNS]) + 1 >= len(runs[0]):
                    runs = [np.concatenate((array, np.zeros_like(array))) for array in runs]
                if int(state[_decode.BOOTS]) + 1 >= len(boots):
                    boots = np.concatenate((boots, np.zeros_like(boots)))
            elif result == _decode.END_OF_FILE:
                break
            self.pages.release_up_to(position)
        messages = int(state[_decode.COUNT])
        run_index, run_position, self.gap_start, self.gap_stop = (array[: int(state[_decode.RUNS])] for array in runs)
        self._first = np.zeros(len(self.slots) + 1, np.int64)
        self.positions: _decode.Positions = (
            np.empty(messages, np.uint32) if len(self.data) < 1 << 32 else np.empty(messages, np.uint64)
        )
        _decode.index_messages(sequence[:messages], self.length, run_index, run_position, self._first, self.positions)
        self.truncated_at = int(state[_decode.TRUNCATED])
        self.unknown_ids = unknown
        self.boots = self._put_together(boots_of(boots, state, len(self.data)))

    def _put_together(self, boots: Sequence[Boot]) -> tuple[Boot, ...]:
        """Join what misplaced blocks of one power-up seem to be: a clock that goes back without new FMT rows."""
        self.shuffled: set[Boot] = set()
        joined: list[Boot] = []
        for boot in boots:
            last = joined[-1] if joined else boot
            if last is boot or self.data[boot.start + 2] == FMT_ID or not self._belong_together(last, boot):
                joined.append(boot)
            else:
                joined[-1] = Boot(last.start, boot.stop, min(last.t_start, boot.t_start), max(last.t_end, boot.t_end))
                self.shuffled = self.shuffled - {last} | {joined[-1]}
        return tuple(joined)

    def _belong_together(self, first: Boot, second: Boot) -> bool:
        """Return whether two stretches tell no second in different rows, but for those in which blocks meet."""
        if not first.t_start <= second.t_start <= first.t_end:
            return False
        slot = int(np.argmax(self.totals * (self.time_width[: len(self.slots)] > 0)))
        places = self.placed(slot)
        begin, middle, end = np.searchsorted(places, np.array((first.start, second.start, second.stop), places.dtype))
        known, others = self._clock(slot, places[begin:middle]), self._clock(slot, places[middle:end])
        differing = others[~np.isin(others, known)]
        return len(np.intersect1d(differing // 1_000_000, known // 1_000_000)) <= _MEETING

    def _define(self, definition: Definition, position: int) -> None:
        """Account for the FMT row at a byte."""
        if definition.id == FMT_ID:
            return  # The layout of FMT rows is fixed; some firmwares describe it wrongly.
        asked = definition.format_length
        if definition.length >= 3 and asked in (None, definition.length):
            self._add_candidate(definition.id, self._add_slot(definition, definition.length, position))
            return
        # A row that contradicts itself is believed only where nothing better is known, and either way round.
        for length in (definition.length, asked):
            if length is not None and 3 <= length <= 255:
                slot = self._add_slot(definition, length, position)
                self.contradictory.add(slot)
                self._add_candidate(definition.id, slot, last=True)

    def _add_slot(self, definition: Definition, length: int, since: int) -> int:
        key = (definition, length)
        slot = self._slot_keys.get(key)
        if slot is not None:
            return slot
        if len(self.slots) >= self._most_slots:
            self.crowded.add(definition.name)
            return -1
        slot = len(self.slots)
        if slot >= len(self.length):
            self.length, self.time_width, self.time_offset = (
                np.concatenate((array, np.zeros_like(array)))
                for array in (self.length, self.time_width, self.time_offset)
            )
        made = Slot(definition, length, since)
        self.slots.append(made)
        self._slot_keys[key] = slot
        self.length[slot] = length
        if made.time is not None:
            self.time_width[slot] = made.time.type.size
            self.time_offset[slot] = made.time.offset
        return slot

    def _add_candidate(self, message_id: int, slot: int, last: bool = False) -> None:
        if slot < 0:
            return
        others = [int(k) for k in self._candidates[message_id] if k >= 0 and k != slot]
        if last:
            # Consistent definitions first, then the newest of the others.
            sound = [k for k in others if k not in self.contradictory]
            rest = [k for k in others if k in self.contradictory]
            order = [*sound, *rest, slot]
        else:
            order = [slot, *others]
        row = np.full(_CANDIDATES, -1, np.int32)
        row[: min(len(order), _CANDIDATES)] = order[:_CANDIDATES]
        self._candidates[message_id] = row

    @cached_property
    def _edges(self) -> Int64s:
        """Places in `positions` of the first message of each boot and behind the last, by definition."""
        bounds = np.array([*(boot.start for boot in self.boots), len(self.data)]).astype(self.positions.dtype)
        of_each = np.split(self.positions, self._first[1:-1])
        edges: Int64s = self._first[:-1, None] + np.array([np.searchsorted(places, bounds) for places in of_each])
        return edges

    def rows(self, boot: Boot) -> tuple[Int64s, Int64s]:
        """Where among all positions those of each definition's messages in a boot begin and end."""
        number = self.boots.index(boot)
        return self._edges[:, number], self._edges[:, number + 1]

    def placed(self, slot: int, boot: Boot | None = None) -> npt.NDArray[Any]:
        """Bytes of the messages of a definition, ascending; in a boot or the whole file."""
        if boot is None:
            return self.positions[self._first[slot] : self._first[slot + 1]]
        first, last = self.rows(boot)
        return self.positions[first[slot] : last[slot]]

    @property
    def totals(self) -> Int64s:
        """Messages of each definition."""
        return np.diff(self._first)

    def timed_beside(self, places: Int64s, boot: Boot, low: int, high: int) -> tuple[Int64s, Int64s]:
        """Byte and clock [us] of the timed messages before and after bytes, shapes (n, 2); bytes -1 where none is.

        What is timed outside `low` to `high` is passed over.
        """
        timed = {slot: self.placed(slot, boot) for slot in np.flatnonzero(self.time_width[: len(self.slots)]).tolist()}
        while True:
            # Rows with room for a clock, and the definitions of the messages there.
            rows, which = np.tile(np.array((-1, 0)), (2, len(places), 1)), np.full((2, len(places)), -1)
            for slot, there in timed.items():
                behind = np.searchsorted(there, places)
                for side, row in enumerate((behind - 1, behind)):
                    inside = np.flatnonzero((row >= 0) & (row < len(there)))
                    found, best = there[row[inside]].astype(np.int64), rows[side, inside, 0]
                    nearer = (best < 0) | ((found < best) if side else (found > best))
                    rows[side, inside[nearer], 0], which[side, inside[nearer]] = found[nearer], slot
            damaged = set()
            for slot in np.unique(which[which >= 0]).tolist():
                clock = self._clock(slot, rows[which == slot, 0])
                rows[which == slot, 1] = clock
                if not ((clock >= low) & (clock <= high)).all():
                    damaged.add(slot)
            if not damaged:
                return rows[0], rows[1]
            for slot in damaged:
                clock = self._clock(slot, timed[slot])
                timed[slot] = timed[slot][(clock >= low) & (clock <= high)]

    def _clock(self, slot: int, places: npt.NDArray[Any]) -> Int64s:
        """Boot clock of messages of a definition, us; -1 where it cannot be."""
        width, offset = int(self.time_width[slot]), int(self.time_offset[slot])
        raw = self.data[places[:, None].astype(np.int64) + np.arange(offset, offset + width)]
        counts = raw.view(f"<u{width}")[:, 0]
        clock: Int64s = counts.astype(np.int64)
        if width == 4:
            return np.asarray(np.where(counts > 0, clock * 1000, -1))
        clock[counts >= np.uint64(1 << 58)] = -1  # beyond ten thousand years the clock is not a clock
        return clock

    def distinct_rows(self, name: str, columns: Mapping[str, type]) -> list[tuple[Any, ...]]:
        """Return stored values of a few columns of UNIT, MULT, FMTU or DSF, each row behind the byte where it is.

        Of rows that are the same in these columns only the first is given: logs repeat themselves. Nothing is given
        where a damaged FMT row makes the columns something else than int, float or bytes as asked.
        """
        rows: list[tuple[Any, ...]] = []
        for number, slot in enumerate(self.slots):
            fields = {item.name: item for item in slot.fields}
            places = self.placed(number)
            if slot.name != name or not set(columns) <= set(fields) or not len(places):
                continue
            items = [fields[column] for column in columns]
            if any(
                _KINDS.get(i.type.dtype.kind) is not kind or i.type.items != 1
                for i, kind in zip(items, columns.values(), strict=True)
            ):
                continue
            within = np.concatenate([np.arange(item.offset, item.offset + item.type.size) for item in items])
            raw = self.data[places[:, None].astype(np.int64) + within]
            record = np.dtype([(item.name, item.type.dtype) for item in items])
            _, first = np.unique(raw.view(np.dtype((np.void, record.itemsize)))[:, 0], return_index=True)
            values = raw[first].view(record)[:, 0].tolist()
            rows.extend((place, *value) for place, value in zip(places[first].tolist(), values, strict=True))
        return sorted(rows, key=lambda row: row[0])
