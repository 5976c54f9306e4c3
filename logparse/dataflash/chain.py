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


@dataclass(frozen=True, slots=True)
class ByteSpan:
    """Messages of one boot: ``first`` to ``last - 1``, the first of them at byte (or line) `position`."""

    first: int
    last: int
    position: int


def boot_spans(
    rows: npt.NDArray[np.int64], state: npt.NDArray[np.int64], messages: int, size: int
) -> dict[Boot, ByteSpan]:  # fmt: skip
    """Return the boots and their messages."""
    n = int(state[_decode.BOOTS])
    rows = rows[: n + 1].copy()
    rows[n, 2:] = state[_decode.BOOT_START], state[_decode.TIME]
    ahead = int(state[_decode.PENDING_TIME] - state[_decode.TIME])
    if 0 < ahead <= (_decode.PAUSE_US if state[_decode.PENDING] > 1 else _LAST_PAUSE_US) and state[_decode.PENDING] > 0:
        # The last rows came after a pause and were too few to be sure of; nothing speaks against them.
        rows[n, 3] = state[_decode.PENDING_TIME]
    lasts = [*rows[1:, 0].tolist(), messages]
    stops = [*rows[1:, 1].tolist(), size]
    return {
        Boot(position, stop, start * 1e-6, end * 1e-6): ByteSpan(first, last, position)
        for (first, position, start, end), last, stop in zip(rows.tolist(), lasts, stops, strict=True)
    }


_CHUNK = 1 << 22
#: Definitions that are told apart; ArduPilot has some 250, and only a made-up file has more than a few times that.
_MOST_SLOTS = 4096
#: Definitions of one id that are tried in turn: after a redefinition the one before may still be meant.
_CANDIDATES = 4

_KINDS = {"i": int, "u": int, "f": float, "S": bytes}

Int64s = npt.NDArray[np.int64]


@dataclass
class Slot:
    """One definition in force somewhere in the file."""

    definition: Definition
    length: int  #: Bytes of its messages with their header.
    since: int  #: Message from which on it holds.
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
    sequence : ndarray of uint8 or uint16, shape (messages,)
        Definition of each message, in file order.
    length, time_width, time_offset : ndarrays of int32
        By definition: bytes of a message, bytes and place of its boot clock (0: none).
    gap_start, gap_stop : ndarrays of int64
        Stretches of the file that hold no message.
    truncated_at : int
        Where a message begins that the end of the file cuts short; -1 where none does.
    unknown_ids : ndarray of int64, shape (256,)
        Headers met of each id that no FMT row explains.
    spans : dict from Boot to Span
        Power-ups in the file.
    contradictory : set of int
        Definitions whose length and format disagree.
    crowded : set of str
        Names of definitions that were too many to be told apart.
    """

    def __init__(self, buffer: Buffer):
        self.data = np.frombuffer(buffer, np.uint8)
        self.pages = MappedPages(buffer)
        self._counted: dict[tuple[int, int], Int64s] = {}
        self._scan(())
        # Messages may come before the FMT row that explains them where rows were lost: read again, knowing them.
        first_break = self._run_index[0] if len(self._run_index) else len(self.sequence)
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
                self._define(Definition.unpack(row), int(state[_decode.COUNT]))
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
        sequence.resize(int(state[_decode.COUNT]), refcheck=False)
        self.sequence = sequence
        n_runs = int(state[_decode.RUNS])
        self._run_index, self._run_position, self.gap_start, self.gap_stop = (array[:n_runs] for array in runs)
        self.truncated_at = int(state[_decode.TRUNCATED])
        self.unknown_ids = unknown
        self.spans = boot_spans(boots, state, len(self.sequence), len(self.data))

    def _define(self, definition: Definition, index: int) -> None:
        """Account for a FMT row from message `index` on."""
        if definition.id == FMT_ID:
            return  # The layout of FMT rows is fixed; some firmwares describe it wrongly.
        asked = definition.format_length
        if definition.length >= 3 and asked in (None, definition.length):
            self._add_candidate(definition.id, self._add_slot(definition, definition.length, index))
            return
        # A row that contradicts itself is believed only where nothing better is known, and either way round.
        for length in (definition.length, asked):
            if length is not None and 3 <= length <= 255:
                slot = self._add_slot(definition, length, index)
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

    def runs(self, span: ByteSpan) -> tuple[Int64s, Int64s, Int64s]:
        """Return the breaks within a span: message behind it counted from the span's first, its byte, the gap's."""
        a = int(np.searchsorted(self._run_index, span.first, "right" if span.first else "left"))
        b = int(np.searchsorted(self._run_index, span.last, "left"))
        return self._run_index[a:b] - span.first, self._run_position[a:b], self.gap_start[a:b]

    @property
    def whole(self) -> ByteSpan:
        """All messages."""
        return ByteSpan(0, len(self.sequence), 0)

    def totals(self, span: ByteSpan) -> Int64s:
        """Messages of each definition."""
        key = (span.first, span.last)
        if key not in self._counted:
            totals = np.zeros(len(self.slots), np.int64)
            _decode.count(self.sequence[span.first : span.last], totals)
            self._counted[key] = totals
        return self._counted[key]

    def locate(self, span: ByteSpan, slots: set[int]) -> tuple[Int64s, Int64s]:
        """Byte and index, counted from the span's first, of each message that follows one of these definitions."""
        wanted = np.zeros(max(1, len(self.slots)), np.bool_)
        wanted[list(slots)] = True
        sequence = self.sequence[span.first : span.last]
        count = int(self.totals(span)[list(slots)].sum())
        positions, indices = np.empty(count, np.int64), np.empty(count, np.int64)
        run_index, run_position, _ = self.runs(span)
        _decode.locate(sequence, self.length, run_index, run_position, span.position, wanted, positions, indices)
        return positions, indices

    def distinct_rows(self, name: str, columns: Mapping[str, type]) -> list[tuple[Any, ...]]:
        """Return stored values of a few columns of UNIT, MULT, FMTU or DSF, each row behind its message index.

        Of rows that are the same in these columns only the first is given: logs repeat themselves. Nothing is given
        where a damaged FMT row makes the columns something else than int, float or bytes as asked.
        """
        rows: list[tuple[Any, ...]] = []
        for number, (positions, indices) in self._housekeeping.items():
            fields = {item.name: item for item in self.slots[number].fields}
            if self.slots[number].name != name or not set(columns) <= set(fields) or not len(indices):
                continue
            items = [fields[column] for column in columns]
            if any(
                _KINDS.get(i.type.dtype.kind) is not kind or i.type.items != 1
                for i, kind in zip(items, columns.values(), strict=True)
            ):
                continue
            places = np.concatenate([np.arange(item.offset, item.offset + item.type.size) for item in items])
            raw = self.data[positions[:, None] + places]
            record = np.dtype([(item.name, item.type.dtype) for item in items])
            _, first = np.unique(raw.view(np.dtype((np.void, record.itemsize)))[:, 0], return_index=True)
            values = raw[first].view(record)[:, 0].tolist()
            rows.extend((index, *value) for index, value in zip(indices[first].tolist(), values, strict=True))
        return sorted(rows, key=lambda row: row[0])

    @cached_property
    def _housekeeping(self) -> dict[int, tuple[Int64s, Int64s]]:
        """Bytes and indices of the messages that the reader itself wants, by definition."""
        wanted = [k for k, slot in enumerate(self.slots) if slot.name in ("UNIT", "MULT", "FMTU", "DSF")]
        positions, indices = self.locate(self.whole, set(wanted))
        which = self.sequence[indices]
        return {number: (positions[which == number], indices[which == number]) for number in wanted}
