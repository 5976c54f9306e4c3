"""Read DataFlash binary logs (.bin): every message, every field, whatever happened to the file.

`DataflashSource` follows the chain of message headers once (`chain`). Columns are gathered when they are asked
for, with the units and multipliers that the FMTU rows name.
"""

from bisect import bisect_right
from collections.abc import Collection, Iterable
from functools import cached_property
from itertools import compress, pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import pyarrow as pa

from core.errors import LogError
from core.findings import Finding
from logparse.containers import Buffer
from logparse.dataflash import _decode
from logparse.dataflash.chain import Chain, Int64s, Slot
from logparse.dataflash.findings import crowded_names, scan_findings
from logparse.dataflash.format import FMT_ID, HEADER, UnitTable
from logparse.source import Boot, MessageSource, clean_text, in_order, mended_times
from logparse.timebase import mend_times


class Layout:
    """Where the columns of some tables lie in one block of memory."""

    def __init__(self, slots: list[Slot], rows: list[int], units: UnitTable, wanted: Collection[str] | None = None):
        self.slots, self.rows = slots, rows
        chosen = [[wanted is None or item.name in wanted for item in slot.fields] for slot in slots]
        self._fields = [list(compress(slot.fields, kept)) for slot, kept in zip(slots, chosen, strict=True)]
        self._scales = [list(compress(slot.scales(units), kept)) for slot, kept in zip(slots, chosen, strict=True)]
        first, offset, size, target = [0], [], [], []
        self._places: list[list[tuple[int, np.dtype]]] = []
        end = 0
        for slot, fields, n in zip(slots, self._fields, rows, strict=True):
            places = []
            for item in fields if slot.time is None or slot.time in fields else [*fields, slot.time]:
                dtype = item.type.dtype if item.type.items == 1 else np.dtype((np.void, item.type.size))
                offset.append(item.offset)
                size.append(item.type.size)
                target.append(end)
                places.append((end, dtype))
                end += -(-n * dtype.itemsize // 8) * 8
            self._places.append(places)
            first.append(len(offset))
        self.memory = np.empty(end, np.uint8)
        self.first_field, self.offset = np.array(first, np.int64), np.array(offset, np.int64)
        self.size, self.target = np.array(size, np.int64), np.array(target, np.int64)

    def _raw(self, table: int, k: int) -> npt.NDArray[Any]:
        start, dtype = self._places[table][k]
        n = self.rows[table]
        return self.memory[start : start + n * dtype.itemsize].view(dtype)

    def time(self, table: int) -> npt.NDArray[np.float64]:
        """Boot clock of each row, s."""
        slot, fields = self.slots[table], self._fields[table]
        assert slot.time is not None
        counts = self._raw(table, fields.index(slot.time) if slot.time in fields else len(fields))
        # A clock beyond 2**63 is damaged; read as signed it stands out.
        return (counts.view(np.int64) if counts.itemsize == 8 else counts) / float(slot.time_scale)

    def multipliers(self, table: int) -> dict[str, float]:
        """Scale that was applied to each scaled column."""
        scales = zip(self._fields[table], self._scales[table], strict=True)
        return {item.name: up / down for item, (up, down) in scales if up != down}

    def columns(self, table: int) -> dict[str, object]:
        """Columns by name."""
        slot = self.slots[table]
        columns: dict[str, object] = {}
        for k, item in enumerate(self._fields[table]):
            raw = self._raw(table, k)
            if item.char == "a":
                values = pa.Array.from_buffers(pa.int16(), 32 * len(raw), [None, pa.py_buffer(raw.view(np.uint8))])
                columns[item.name] = pd.arrays.ArrowExtensionArray(pa.FixedSizeListArray.from_arrays(values, 32))
            elif item.type.is_text:
                columns[item.name] = _text_column(raw, is_bytes=slot.name == "FILE" and item.name == "Data")
            elif (scale := self._scales[table][k]) != (1.0, 1.0) or item.char == "g":
                columns[item.name] = _scaled(raw, *scale)
            else:
                columns[item.name] = raw
        return columns


def _scaled(raw: npt.NDArray[Any], up: float, down: float) -> npt.NDArray[Any]:
    """Return numbers in their unit; of those of two bytes and of floats in single precision."""
    with np.errstate(invalid="ignore", over="ignore"):  # signalling NaNs of damaged rows
        numbers = raw.astype(np.float64) * up / down
        return numbers.astype(np.float32) if raw.itemsize <= 2 or raw.dtype == np.float32 else numbers


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


#: Times so far outside a boot, us, are not taken for neighbours.
_OUTSIDE_US = 5_000_000


def looks_like(head: bytes) -> bool:
    """Whether a file that begins so is a DataFlash binary log, perhaps with a damaged beginning."""
    if head.startswith(HEADER + bytes((FMT_ID,))):
        return True
    return head.count(HEADER + bytes((FMT_ID,))) >= 3 or head.count(HEADER) > max(8, len(head) // 400)


class DataflashSource(MessageSource):
    """An opened DataFlash binary log; LogError where not one message is intact."""

    format = "dataflash"

    def __init__(self, buffer: Buffer):
        self._mended: dict[str, int] = {}
        self._chain = Chain(buffer)
        if not len(self._chain.positions):
            if buffer.find(HEADER) >= 0 and buffer.find(HEADER + bytes((FMT_ID,))) < 0:
                raise LogError(
                    "the beginning of this DataFlash log is missing, where FMT rows say how its messages are read: "
                    "the file is cut off at its start; copy the whole log again"
                )
            raise LogError("no intact DataFlash message in the file: it is damaged or not a DataFlash log")
        self._units = UnitTable()
        self._read_units()
        self._chain.pages.release()

    def _read_units(self) -> None:
        """Return each definition the units and multipliers that the FMTU rows behind it name."""
        for values in self._chain.distinct_rows("UNIT", {"Id": int, "Label": bytes}):
            self._units.add_unit(values[1], clean_text(values[2]))
        for values in self._chain.distinct_rows("MULT", {"Id": int, "Mult": float}):
            self._units.add_multiplier(values[1], values[2])
        by_id: dict[int, list[Slot]] = {}
        for slot in self._chain.slots:
            by_id.setdefault(slot.definition.id, []).append(slot)
        columns = {"FmtType": int, "UnitIds": bytes, "MultIds": bytes}
        for place, message_id, *ids in self._chain.distinct_rows("FMTU", columns):
            units, multipliers = map(clean_text, ids)
            slots = by_id.get(message_id, [])
            newest = bisect_right(slots, place, key=lambda slot: slot.since)
            # The newest definition before this row is meant; one that contradicts itself has two slots.
            for slot in slots[max(0, newest - 2) : newest]:
                meant = slot.definition is slots[newest - 1].definition
                if meant and not slot.units and len(units) == len(slot.definition.format):
                    slot.units, slot.multipliers = units, multipliers
        for slots in by_id.values():
            for old, new in pairwise(slots):
                if not new.units and old.definition.labels == new.definition.labels:
                    new.units, new.multipliers = old.units, old.multipliers

    @property
    def boots(self) -> tuple[Boot, ...]:
        """Power-ups in the file."""
        return self._chain.boots

    def counts(self, boot: Boot) -> dict[str, int]:
        """Messages of each type in this boot."""
        first, last = self._chain.rows(boot)
        counts: dict[str, int] = {}
        for slot, count in zip(self._chain.slots, (last - first).tolist(), strict=True):
            if count:
                counts[slot.name] = counts.get(slot.name, 0) + count
        return counts

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What the scan and the decoding so far had to say."""
        return (*self._scan_findings, *mended_times(self._mended), *crowded_names(self._chain.crowded))

    @cached_property
    def _scan_findings(self) -> list[Finding]:
        return list(scan_findings(self._chain))

    def decode_many(
        self, names: Iterable[str], boot: Boot, fields: Collection[str] | None = None
    ) -> dict[str, pd.DataFrame]:
        """Return several message types, decoded in one pass over the file."""
        chain = self._chain
        parts: dict[str, list[tuple[int, pd.DataFrame]]] = {name: [] for name in names}
        first, last = chain.rows(boot)
        numbers = [k for k in np.flatnonzero(last > first).tolist() if chain.slots[k].name in parts]
        untimed = [k for k in numbers if chain.slots[k].time is None]
        times = self._interpolated_times(boot, untimed) if untimed else {}
        rows = (last - first)[numbers].tolist()
        layout = Layout([chain.slots[k] for k in numbers], rows, self._units, fields)
        self._gather(boot, layout, first[numbers], last[numbers])
        for table, number in enumerate(numbers):
            frame = self._frame(layout, table, times.get(number), boot)
            parts[chain.slots[number].name].append((number, frame))
        frames = {}
        for name, own in parts.items():
            if not own:
                raise KeyError(name)
            frames[name] = own[0][1] if len(own) == 1 else self._joined(name, boot, own)
        return {name: in_order(frame) for name, frame in frames.items()} if boot in chain.shuffled else frames

    def _gather(self, boot: Boot, layout: Layout, row: Int64s, last: Int64s) -> None:
        """Fill the columns of `layout`, whose tables have the messages from `row` to `last` of all positions."""
        chain, memory = self._chain, layout.memory
        chain.pages.start_at(boot.start)
        for stop in chain.pages.pieces(boot.start, boot.stop):
            _decode.gather(
                chain.data, chain.positions, min(stop, boot.stop), row, last, layout.first_field, layout.offset,
                layout.size, layout.target, memory, memory.view(np.uint16), memory.view(np.uint32),
                memory.view(np.uint64),
            )  # fmt: skip
            chain.pages.release_up_to(stop)
        chain.pages.release()

    def _frame(
        self, layout: Layout, table: int, t: npt.NDArray[np.float64] | None, boot: Boot
    ) -> pd.DataFrame:  # fmt: skip
        slot = layout.slots[table]
        if t is None:
            t, mended = mend_times(layout.time(table), boot.t_start, boot.t_end)
            if mended:
                self._mended[slot.name] = mended
        index = pd.Index(t, name="t", copy=False)
        frame = pd.DataFrame(layout.columns(table), index=index, copy=False)
        frame.attrs["units"] = slot.unit_labels(self._units)
        frame.attrs["multipliers"] = layout.multipliers(table)
        # Of all fields, decoded or not.
        frame.attrs["numeric"] = {field.name: field.char for field in slot.fields if field.is_number}
        instance = slot.units.find("#")
        if 0 <= instance < len(slot.fields):
            frame.attrs["instance"] = slot.fields[instance].name
        return frame

    def _joined(self, name: str, boot: Boot, parts: list[tuple[int, pd.DataFrame]]) -> pd.DataFrame:
        """Rows of one name under several definitions, in file order; columns that one lacks are missing there."""
        parts = self._affordable(name, parts)
        attrs: dict[Any, Any] = {}
        for _, frame in parts:
            for key, value in frame.attrs.items():
                attrs[key] = {**attrs.get(key, {}), **value} if isinstance(value, dict) else value
            frame.attrs = {}
        joined = pd.concat([frame for _, frame in parts])
        places = np.concatenate([self._chain.placed(number, boot) for number, _ in parts])
        joined = joined.iloc[np.argsort(places)]
        joined.attrs = attrs
        return joined

    def _affordable(self, name: str, parts: list[tuple[int, pd.DataFrame]]) -> list[tuple[int, pd.DataFrame]]:
        """Leave out the rarest layouts where joining all would take far more memory than the file has bytes.

        Only a damaged or made-up file has so many layouts of one name.
        """
        budget = 8_000_000 + len(self._chain.data)
        kept: list[tuple[int, pd.DataFrame]] = []
        columns: set[str] = set()
        rows = 0
        for number, frame in sorted(parts, key=lambda part: -len(part[1])):
            columns |= set(frame.columns)
            rows += len(frame)
            if kept and rows * len(columns) > budget:
                self._chain.crowded.add(name)
                break
            kept.append((number, frame))
        return sorted(kept, key=lambda part: part[0])

    def _interpolated_times(self, boot: Boot, slots: list[int]) -> dict[int, npt.NDArray[np.float64]]:
        """Boot clock of messages that carry none, from the bytes between the timed messages around them."""
        low, high = round(boot.t_start * 1e6) - _OUTSIDE_US, round(boot.t_end * 1e6) + _OUTSIDE_US
        of_each = [self._chain.placed(slot, boot).astype(np.int64) for slot in slots]
        places = np.concatenate(of_each)
        before, after = self._chain.timed_beside(places, boot, low, high)
        self._chain.pages.release()
        for here, there in ((before, after), (after, before)):
            missing = here[:, 0] < 0
            here[missing] = there[missing]
        distance = np.maximum(after[:, 0] - before[:, 0], 1)
        fraction = np.clip((places - before[:, 0]) / distance, 0.0, 1.0)
        t = (before[:, 1] + fraction * (after[:, 1] - before[:, 1])) * 1e-6
        t[before[:, 0] < 0] = 0.0
        return dict(zip(slots, np.split(t, np.cumsum([len(there) for there in of_each])[:-1]), strict=True))
