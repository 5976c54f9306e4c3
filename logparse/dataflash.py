"""Read DataFlash binary logs (.bin): every message, every field, whatever happened to the file.

`open_dataflash` follows the chain of message headers once, notes which definition (FMT row) each message follows and
where the chain is broken, and finds the boots. Columns are gathered when they are asked for.

After a break the reader goes on at the next position where a known header is followed, one message on, by another
header: payloads can hold bytes that look like one header, hardly two at the right distance.
"""

import mmap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import pyarrow as pa

from logparse import _decode
from logparse.boots import Span, boot_spans
from logparse.containers import Buffer
from logparse.dataflash_findings import scan_findings
from logparse.dataflash_format import (
    FMT,
    FMT_ID,
    FMT_LENGTH,
    HEADER,
    Definition,
    Field,
    UnitTable,
    boot_clock,
    clean_text,
)
from logparse.errors import LogError
from logparse.findings import Finding, Severity
from logparse.source import Boot
from logparse.timebase import mend_times

_CHUNK = 1 << 22
#: Definitions of one id that are tried in turn: after a redefinition the one before may still be meant.
_CANDIDATES = 4
#: Bytes of a mapped file that are kept in memory before they are given back.
_KEEP = 1 << 23
#: A page cache of huge pages maps them whole: giving back a part of one brings it all back at the next touch.
_HUGE_PAGE = 1 << 21

_COPY = {1: _decode.COPY_1, 2: _decode.COPY_2, 4: _decode.COPY_4, 8: _decode.COPY_8}
_SCALE = {
    "i1": _decode.SCALE_I8,
    "u1": _decode.SCALE_U8,
    "i2": _decode.SCALE_I16,
    "u2": _decode.SCALE_U16,
    "i4": _decode.SCALE_I32,
    "u4": _decode.SCALE_U32,
    "i8": _decode.SCALE_I64,
    "u8": _decode.SCALE_U64,
    "f4": _decode.SCALE_F32,
    "f8": _decode.SCALE_F64,
}


def looks_like(head: bytes) -> bool:
    """Whether a file that begins so is a DataFlash binary log, perhaps with a damaged beginning."""
    if head.startswith(HEADER + bytes((FMT_ID,))):
        return True
    return head.count(HEADER + bytes((FMT_ID,))) >= 3 or head.count(HEADER) > max(8, len(head) // 400)


@dataclass
class _Slot:
    """One definition in force somewhere in the file, with the length that its messages have."""

    definition: Definition
    length: int
    since: int
    units: str = ""
    multipliers: str = ""
    fields: tuple[Field, ...] = field(init=False)
    time: Field | None = field(init=False)
    time_scale: int = field(init=False)

    def __post_init__(self) -> None:
        self.fields = self.definition.fields(self.length)
        self.time, self.time_scale = boot_clock(self.name, self.fields)

    @property
    def name(self) -> str:
        return self.definition.name or f"ID{self.definition.id}"

    def scales(self, table: UnitTable) -> list[tuple[float, float]]:
        """Factor and divisor of each field."""
        ids = self.multipliers.ljust(len(self.fields), "-")
        return [table.scale(item, multiplier, self.time) for item, multiplier in zip(self.fields, ids, strict=False)]

    def unit_labels(self, table: UnitTable) -> dict[str, str]:
        """Name the unit of each field that has one."""
        return table.units(self.fields, self.units, self.time, self.time_scale)


class DataflashSource:
    """An opened DataFlash binary log; see `logparse.source.MessageSource`.

    Parameters
    ----------
    buffer : bytes or mmap
        The whole file.

    Raises
    ------
    LogError
        Not one intact message.
    """

    format = "dataflash"

    def __init__(self, buffer: Buffer):
        self._buffer = buffer
        self._data = np.frombuffer(buffer, np.uint8)
        self._slots: list[_Slot] = []
        self._mended: dict[str, int] = {}
        self._counted: dict[tuple[int, int], npt.NDArray[np.int64]] = {}
        self._scan(())
        # Messages may come before the FMT row that explains them where rows were lost: read again, knowing them.
        first_break = self._run_index[0] if len(self._run_index) else len(self._sequence)
        late = {slot.definition.id: slot for slot in reversed(self._slots) if slot.since >= first_break}
        if late:
            self._scan([(slot.definition, slot.length) for slot in late.values()])
        if not len(self._sequence):
            raise LogError("no intact DataFlash message in the file: it is damaged or not a DataFlash log")
        self._read_units()
        self._release(0, len(self._data), everything=True)

    # Reading the chain of headers

    def _scan(self, known: Sequence[tuple[Definition, int]], number: type[np.unsignedinteger[Any]] = np.uint8) -> None:
        """Follow the header chain through the whole file.

        Parameters
        ----------
        known : sequence of (Definition, int)
            Definitions, with the length of their messages, that hold from the beginning.
        number : unsigned integer type
            Numbers the definitions; a byte is enough for all files but a few, and is a byte per message.
        """
        self._slots = []
        self._most_slots = int(np.iinfo(number).max) + 1
        self._candidates = np.full((256, _CANDIDATES), -1, np.int32)
        self._length = np.zeros(256, np.int32)
        self._time_width = np.zeros(256, np.int32)
        self._time_offset = np.zeros(256, np.int32)
        self._slot_keys: dict[tuple[Definition, int], int] = {}
        self._contradictory: dict[int, Definition] = {}
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
        sequence = np.empty(len(self._data) // 64 + _CHUNK // 3 + 2, number)
        released = 0
        while True:
            if len(sequence) - int(state[_decode.COUNT]) < _CHUNK // 3 + 2:
                sequence.resize(len(sequence) + len(sequence) // 4 + _CHUNK // 3 + 2, refcheck=False)
            limit = min(int(state[_decode.POSITION]) + _CHUNK, len(self._data))
            result = _decode.follow_chain(
                self._data, limit, self._candidates, self._length, self._time_width, self._time_offset, fmt_rows,
                sequence, runs[0], runs[1], runs[2], runs[3], boots, unknown, state,
            )  # fmt: skip
            position = int(state[_decode.POSITION])
            if result == _decode.NEW_FORMAT:
                row = self._data[position : position + FMT_LENGTH].tobytes()
                fmt_rows[row[3]] = np.frombuffer(row, np.uint8)[3:]
                self._define(Definition.unpack(row), int(state[_decode.COUNT]))
                if len(self._slots) >= self._most_slots and number is np.uint8:
                    self._scan(known, np.uint16)
                    return
            elif result == _decode.OUTPUT_FULL:
                if int(state[_decode.RUNS]) + 1 >= len(runs[0]):
                    runs = [np.concatenate((array, np.zeros_like(array))) for array in runs]
                if int(state[_decode.BOOTS]) + 1 >= len(boots):
                    boots = np.concatenate((boots, np.zeros_like(boots)))
            elif result == _decode.END_OF_FILE:
                break
            released = self._release(released, position)
        sequence.resize(int(state[_decode.COUNT]), refcheck=False)
        self._sequence = sequence
        n_runs = int(state[_decode.RUNS])
        self._run_index, self._run_position, self._gap_start, self._gap_stop = (array[:n_runs] for array in runs)
        self._truncated = int(state[_decode.TRUNCATED])
        self._unknown = unknown
        self._spans = boot_spans(boots, state, len(self._sequence), len(self._data))

    def _define(self, definition: Definition, index: int) -> None:
        """Take a FMT row into account from message `index` on."""
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
                self._contradictory[slot] = definition
                self._add_candidate(definition.id, slot, last=True)

    def _add_slot(self, definition: Definition, length: int, since: int) -> int:
        key = (definition, length)
        slot = self._slot_keys.get(key)
        if slot is not None:
            return slot
        if len(self._slots) >= self._most_slots:
            return -1
        slot = len(self._slots)
        if slot >= len(self._length):
            self._length, self._time_width, self._time_offset = (
                np.concatenate((array, np.zeros_like(array)))
                for array in (self._length, self._time_width, self._time_offset)
            )
        made = _Slot(definition, length, since)
        self._slots.append(made)
        self._slot_keys[key] = slot
        self._length[slot] = length
        if made.time is not None:
            self._time_width[slot] = made.time.type.size
            self._time_offset[slot] = made.time.offset
        return slot

    def _add_candidate(self, message_id: int, slot: int, last: bool = False) -> None:
        if slot < 0:
            return
        others = [int(k) for k in self._candidates[message_id] if k >= 0 and k != slot]
        if last:
            # Consistent definitions first, then the newest of the others.
            sound = [k for k in others if k not in self._contradictory]
            rest = [k for k in others if k in self._contradictory]
            order = [*sound, *rest, slot]
        else:
            order = [slot, *others]
        row = np.full(_CANDIDATES, -1, np.int32)
        row[: min(len(order), _CANDIDATES)] = order[:_CANDIDATES]
        self._candidates[message_id] = row

    def _release(self, start: int, stop: int, everything: bool = False) -> int:
        """Give mapped pages back to the system, so that a file larger than memory can be read."""
        buffer = self._buffer
        if isinstance(buffer, bytes) or len(buffer) <= _KEEP or not hasattr(mmap, "MADV_DONTNEED"):
            return start
        stop -= stop % _HUGE_PAGE if stop < len(self._data) else stop % mmap.ALLOCATIONGRANULARITY
        if stop - start < (1 if everything else _KEEP):
            return start
        buffer.madvise(mmap.MADV_DONTNEED, start, stop - start)
        return stop

    @property
    def boots(self) -> tuple[Boot, ...]:
        """Power-ups in the file."""
        return tuple(self._spans)

    def _runs(self, span: Span) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Give the breaks within a span: message behind it counted from the span's first, its byte, the gap's byte."""
        a = int(np.searchsorted(self._run_index, span.first, "right" if span.first else "left"))
        b = int(np.searchsorted(self._run_index, span.last, "left"))
        return self._run_index[a:b] - span.first, self._run_position[a:b], self._gap_start[a:b]

    @property
    def _whole(self) -> Span:
        return Span(0, len(self._sequence), 0)

    def _totals(self, span: Span) -> npt.NDArray[np.int64]:
        """Messages of each definition."""
        key = (span.first, span.last)
        if key not in self._counted:
            totals = np.zeros(len(self._slots), np.int64)
            _decode.count(self._sequence[span.first : span.last], totals)
            self._counted[key] = totals
        return self._counted[key]

    def counts(self, boot: Boot) -> dict[str, int]:
        """Messages of each type in this boot."""
        found = self._totals(self._spans[boot])
        counts: dict[str, int] = {}
        for slot in np.flatnonzero(found):
            name = self._slots[slot].name
            counts[name] = counts.get(name, 0) + int(found[slot])
        return counts

    # Units and multipliers

    def _read_units(self) -> None:
        """Give each definition the units and multipliers that the FMTU rows behind it name."""
        self._unit_table = UnitTable()
        wanted = {slot.name for slot in self._slots} & {"UNIT", "MULT", "FMTU"}
        if "FMTU" not in wanted:
            return
        for values in self._rows("UNIT", ("Id", "Label")):
            self._unit_table.add_unit(int(values[1]), clean_text(values[2]))
        for values in self._rows("MULT", ("Id", "Mult")):
            self._unit_table.add_multiplier(int(values[1]), float(values[2]))
        by_id: dict[int, list[_Slot]] = {}
        for slot in self._slots:
            by_id.setdefault(slot.definition.id, []).append(slot)
        given: set[tuple[Definition, str, str]] = set()
        for index, message_id, raw_units, raw_multipliers in self._rows("FMTU", ("FmtType", "UnitIds", "MultIds")):
            units, multipliers = clean_text(raw_units), clean_text(raw_multipliers)
            before = [slot for slot in by_id.get(int(message_id), ()) if slot.since <= index]
            for slot in before:
                # The newest definition before this row is meant, and what contradicts itself counts twice.
                if slot.definition is not before[-1].definition or slot.units or slot.multipliers:
                    continue
                if len(units) == len(slot.definition.format) and (slot.definition, units, multipliers) not in given:
                    slot.units, slot.multipliers = units, multipliers
        for slots in by_id.values():
            for old, new in pairwise(slots):
                if not new.units and old.definition.labels == new.definition.labels:
                    new.units, new.multipliers = old.units, old.multipliers

    def _rows(self, name: str, columns: tuple[str, ...]) -> list[tuple[Any, ...]]:
        """Give stored values of a few columns, each row behind its message index; for the reader's own use.

        Of rows that are the same in these columns only the first is given: logs repeat themselves.
        """
        rows: list[tuple[Any, ...]] = []
        for number, (positions, indices) in self._housekeeping.items():
            fields = {item.name: item for item in self._slots[number].fields}
            if self._slots[number].name != name or not set(columns) <= set(fields) or not len(indices):
                continue
            items = [fields[column] for column in columns]
            places = np.concatenate([np.arange(item.offset, item.offset + item.type.size) for item in items])
            raw = self._data[positions[:, None] + places]
            record = np.dtype([(item.name, item.type.dtype) for item in items])
            _, first = np.unique(raw.view(np.dtype((np.void, record.itemsize)))[:, 0], return_index=True)
            values = raw[first].view(record)[:, 0].tolist()
            rows.extend((index, *value) for index, value in zip(indices[first].tolist(), values, strict=True))
        return sorted(rows, key=lambda row: row[0])

    @cached_property
    def _housekeeping(self) -> dict[int, tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]]:
        """Bytes and indices of the messages that the reader itself wants, by definition."""
        wanted = [k for k, slot in enumerate(self._slots) if slot.name in ("UNIT", "MULT", "FMTU", "DSF")]
        positions, indices = self._locate(self._whole, set(wanted))
        which = self._sequence[indices]
        return {number: (positions[which == number], indices[which == number]) for number in wanted}

    def _locate(self, span: Span, slots: set[int]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        wanted = np.zeros(max(1, len(self._slots)), np.bool_)
        wanted[list(slots)] = True
        sequence = self._sequence[span.first : span.last]
        count = int(self._totals(span)[list(slots)].sum())
        positions, indices = np.empty(count, np.int64), np.empty(count, np.int64)
        run_index, run_position, _ = self._runs(span)
        _decode.locate(sequence, self._length, run_index, run_position, span.position, wanted, positions, indices)
        return positions, indices

    def units(self, name: str) -> dict[str, str]:
        """Units of the fields as declared, after scaling."""
        units: dict[str, str] = {}
        for slot in self._slots:
            if slot.name == name:
                units.update(slot.unit_labels(self._unit_table))
        return units

    # Columns

    def decode(self, name: str, boot: Boot) -> pd.DataFrame:
        """All fields of one message type."""
        return self.decode_many((name,), boot)[name]

    def decode_many(self, names: Iterable[str], boot: Boot) -> dict[str, pd.DataFrame]:
        """All fields of several message types, in one pass over the file."""
        names = list(dict.fromkeys(names))
        span = self._spans[boot]
        sequence = self._sequence[span.first : span.last]
        found = self._totals(span)
        tables = [k for k in np.flatnonzero(found).tolist() if self._slots[k].name in set(names)]
        layout = _Layout([self._slots[k] for k in tables], [int(found[k]) for k in tables], self._unit_table)
        table_of_slot = np.full(max(1, len(self._slots)), -1, np.int32)
        table_of_slot[tables] = np.arange(len(tables))
        run_index, run_position, _ = self._runs(span)
        untimed = [k for k in tables if self._slots[k].time is None]
        times = self._interpolated_times(span, boot, untimed) if untimed else {}
        self._release(0, len(self._data), everything=True)
        row = np.zeros(len(tables), np.int64)
        state = np.array((0, span.position, 0, 0), np.int64)
        released = span.position - span.position % _HUGE_PAGE
        step = len(sequence) if len(self._data) <= _KEEP else max(1, len(sequence) * _KEEP // len(self._data))
        for stop in range(step, len(sequence) + step, step):
            _decode.gather(
                self._data, sequence, min(stop, len(sequence)), self._length, run_index, run_position, table_of_slot,
                layout.first_field, layout.offset, layout.operation, layout.size, layout.target, layout.factor,
                layout.divisor, row, layout.memory, state,
            )  # fmt: skip
            released = self._release(released, int(state[1]))
        parts: dict[str, list[tuple[int, pd.DataFrame]]] = {}
        for table, number in enumerate(tables):
            frame = self._frame(layout, table, times.get(number), boot)
            parts.setdefault(self._slots[number].name, []).append((number, frame))
        self._release(0, len(self._data), everything=True)
        frames = {}
        for name in names:
            if name not in parts:
                raise KeyError(name)
            own = parts[name]
            frames[name] = own[0][1] if len(own) == 1 else self._joined(span, own)
        return frames

    def _frame(
        self, layout: "_Layout", table: int, t: npt.NDArray[np.float64] | None, boot: Boot
    ) -> pd.DataFrame:  # fmt: skip
        slot = layout.slots[table]
        if t is None:
            t, mended = mend_times(layout.time(table), boot.t_start, boot.t_end)
            if mended:
                self._mended[slot.name] = mended
        index = pd.Index(t, name="t", copy=False)
        frame = pd.DataFrame(layout.columns(table), index=index, copy=False)
        frame.attrs["units"] = slot.unit_labels(self._unit_table)
        frame.attrs["multipliers"] = layout.multipliers(table)
        instance = slot.units.find("#")
        if 0 <= instance < len(slot.fields):
            frame.attrs["instance"] = slot.fields[instance].name
        return frame

    def _joined(self, span: Span, parts: list[tuple[int, pd.DataFrame]]) -> pd.DataFrame:
        """Rows of one name under several definitions, in file order; columns that one lacks are missing there."""
        order = np.concatenate([self._locate(span, {number})[1] for number, _ in parts]).argsort(kind="stable")
        attrs: dict[Any, Any] = {}
        for _, frame in parts:
            for key, value in frame.attrs.items():
                attrs[key] = {**attrs.get(key, {}), **value} if isinstance(value, dict) else value
            frame.attrs = {}
        joined = pd.concat([frame for _, frame in parts]).iloc[order]
        joined.attrs = attrs
        return joined

    def _interpolated_times(
        self, span: Span, boot: Boot, slots: list[int]
    ) -> dict[int, npt.NDArray[np.float64]]:  # fmt: skip
        """Boot clock of messages that carry none, from the bytes between the timed messages around them."""
        positions, indices = self._locate(span, set(slots))
        before, after = np.empty((len(positions), 2), np.int64), np.empty((len(positions), 2), np.int64)
        run_index, run_position, gap_start = self._runs(span)
        low, high = (round(limit * 1e6) for limit in (boot.t_start - 5.0, boot.t_end + 5.0))
        sequence = self._sequence[span.first : span.last]
        _decode.neighbouring_times(
            self._data, sequence, self._length, run_index, run_position, gap_start, self._time_width,
            self._time_offset, low, high, positions, indices, before, after,
        )  # fmt: skip
        for here, there in ((before, after), (after, before)):
            missing = here[:, 0] < 0
            here[missing] = there[missing]
        distance = np.maximum(after[:, 0] - before[:, 0], 1)
        fraction = np.clip((positions - before[:, 0]) / distance, 0.0, 1.0)
        t = (before[:, 1] + fraction * (after[:, 1] - before[:, 1])) * 1e-6
        t[before[:, 0] < 0] = 0.0
        which = sequence[indices]
        return {number: t[which == number] for number in slots}

    # Findings

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What the scan and the decoding so far had to say."""
        return tuple(self._scan_findings) + tuple(
            Finding(
                "implausible-time",
                Severity.WARNING,
                f"{count} rows of {name} carry a time outside the boot or far from their neighbours; "
                "their time was interpolated.",
                evidence={"message": name, "rows": count},
            )
            for name, count in self._mended.items()
        )

    @cached_property
    def _scan_findings(self) -> list[Finding]:
        return scan_findings(self)

    # What the findings are made of

    @property
    def data(self) -> npt.NDArray[np.uint8]:
        """The whole file."""
        return self._data

    @property
    def size(self) -> int:
        """Bytes in the file."""
        return len(self._data)

    @property
    def gaps(self) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """First byte of each stretch that holds no message, and the first byte behind it."""
        return self._gap_start, self._gap_stop

    @property
    def truncated_at(self) -> int:
        """Where a message begins that the end of the file cuts short; -1 where none does."""
        return self._truncated

    @property
    def unknown_ids(self) -> npt.NDArray[np.int64]:
        """Headers met of each id that no FMT row explains."""
        return self._unknown

    @cached_property
    def mean_length(self) -> float:
        """Bytes of a message on average."""
        found = self._totals(self._whole)
        return float(found @ self._length[: len(found)]) / len(self._sequence)

    @cached_property
    def _used(self) -> list[int]:
        return np.flatnonzero(self._totals(self._whole)).tolist()

    @property
    def contradictory_in_use(self) -> list[str]:
        """Names of messages that occur under a FMT row whose length and format disagree."""
        return list(dict.fromkeys(self._slots[k].name for k in self._used if k in self._contradictory))

    @property
    def redefined_in_use(self) -> list[str]:
        """Names of messages that occur under more than one layout of the same id."""
        by_id: dict[int, set[tuple[str, tuple[str, ...]]]] = {}
        for k in self._used:
            definition = self._slots[k].definition
            by_id.setdefault(definition.id, set()).add((definition.format, definition.labels))
        return list(
            dict.fromkeys(self._slots[k].name for k in self._used if len(by_id[self._slots[k].definition.id]) > 1)
        )

    @property
    def dropped_by_autopilot(self) -> int:
        """Messages that the autopilot counted as dropped (DSF.Dp), over all boots."""
        counts: dict[int, int] = {}
        starts = [self._spans[boot].first for boot in self.boots]
        for index, dropped in self._rows("DSF", ("Dp",)):
            boot = int(np.searchsorted(starts, index, "right"))
            counts[boot] = max(counts.get(boot, 0), int(dropped))
        return sum(counts.values())


class _Layout:
    """Where the columns of some tables lie in one block of memory."""

    def __init__(self, slots: list[_Slot], rows: list[int], units: UnitTable):
        self.slots, self.rows = slots, rows
        self._scales = [slot.scales(units) for slot in slots]
        first, offset, operation, size, target, factor, divisor = [0], [], [], [], [], [], []
        self._places: list[list[tuple[int, np.dtype]]] = []
        end = 0
        for slot, n, scales in zip(slots, rows, self._scales, strict=True):
            places = []
            plan = [(item, *scale) for item, scale in zip(slot.fields, scales, strict=True)]
            if slot.time is not None:
                # The index: the boot clock in seconds.
                plan.append((slot.time, 1.0, float(slot.time_scale)))
            for k, (item, up, down) in enumerate(plan):
                code = item.type.dtype.str.lstrip("<|")
                is_index = k == len(slot.fields)
                if (up == 1.0 and down == 1.0) or code == "f2":
                    what = _COPY.get(item.type.size, _decode.COPY_N)
                    dtype = item.type.dtype if item.type.items == 1 else np.dtype((np.void, item.type.size))
                else:
                    # A clock beyond 2**63 is damaged; read as signed it stands out, and converts in one step.
                    what = _SCALE["i8" if is_index and code == "u8" else code]
                    dtype = np.dtype(np.float32 if item.type.size <= 2 or code == "f4" else np.float64)
                    if is_index and item.type.size == 4:
                        dtype = np.dtype(np.float64)
                offset.append(item.offset)
                operation.append(what)
                size.append(item.type.size)
                target.append(end)
                factor.append(up)
                divisor.append(down)
                places.append((end, dtype))
                end += -(-n * dtype.itemsize // 8) * 8
            self._places.append(places)
            first.append(len(offset))
        self.memory = np.empty(end, np.uint8)
        self.first_field = np.array(first, np.int64)
        self.offset, self.operation = np.array(offset, np.int64), np.array(operation, np.int64)
        self.size, self.target = np.array(size, np.int64), np.array(target, np.int64)
        self.factor, self.divisor = np.array(factor, np.float64), np.array(divisor, np.float64)

    def _raw(self, table: int, k: int) -> npt.NDArray[Any]:
        start, dtype = self._places[table][k]
        n = self.rows[table]
        return self.memory[start : start + n * dtype.itemsize].view(dtype)

    def time(self, table: int) -> npt.NDArray[np.float64]:
        """Boot clock of each row, s."""
        return self._raw(table, len(self.slots[table].fields))

    def multipliers(self, table: int) -> dict[str, float]:
        """Scale that was applied to each scaled column."""
        scales = zip(self.slots[table].fields, self._scales[table], strict=True)
        return {item.name: up / down for item, (up, down) in scales if up != down}

    def columns(self, table: int) -> dict[str, Any]:
        """Columns by name."""
        slot = self.slots[table]
        columns: dict[str, Any] = {}
        for k, item in enumerate(slot.fields):
            raw = self._raw(table, k)
            if item.char == "a":
                values = pa.array(np.frombuffer(raw.tobytes(), "<i2"))
                columns[item.name] = pd.arrays.ArrowExtensionArray(pa.FixedSizeListArray.from_arrays(values, 32))
            elif item.type.is_text:
                columns[item.name] = _text_column(raw, is_bytes=slot.name == "FILE" and item.name == "Data")
            elif item.char == "g":
                up, down = self._scales[table][k]
                columns[item.name] = raw.astype(np.float32) * np.float32(up / down)
            else:
                columns[item.name] = raw
        return columns


def _text_column(raw: npt.NDArray[np.bytes_], is_bytes: bool) -> Any:
    """Text cells, cut at the first NUL; pieces of files stay bytes."""
    width = raw.dtype.itemsize
    cells = raw.view(np.uint8).reshape(len(raw), width)
    if is_bytes:
        return np.array([cell.tobytes() for cell in cells] + [None], dtype=object)[:-1]
    if (cells > 127).any():
        return pd.array([clean_text(cell.tobytes()) for cell in cells], dtype="str")
    ends = cells == 0
    lengths = np.where(ends.any(axis=1), ends.argmax(axis=1), width)
    kept = np.arange(width) < lengths[:, None]
    offsets = np.zeros(len(raw) + 1, np.int64)
    np.cumsum(lengths, out=offsets[1:])
    text = pa.LargeStringArray.from_buffers(
        len(raw), pa.py_buffer(offsets.tobytes()), pa.py_buffer(cells[kept].tobytes())
    )
    return pd.array(text, dtype="str")


def open_dataflash(buffer: Buffer) -> DataflashSource:
    """Scan a DataFlash binary log.

    Raises
    ------
    LogError
        Not one intact message.
    """
    return DataflashSource(buffer)
