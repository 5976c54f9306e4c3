"""Read MAVLink telemetry logs (.tlog): every message of every sender, whatever happened to the file.

`TlogSource` walks the stream once, verifies every frame's checksum, sorts the frames by message and finds the
power-ups of the autopilot (`clock`). Columns are decoded when they are asked for. Values are the protocol's
own: see the units of each column.

After damage the reader goes on at the next frame whose checksum is right. A frame of an unknown message cannot be
verified; it is skipped as one where the next frame follows it.
"""

from bisect import bisect_right
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import pyarrow as pa

from core.errors import LogError
from core.findings import Finding
from logparse.containers import Buffer, MappedPages
from logparse.mavlink import _decode
from logparse.mavlink.clock import BootClock, find_boots, logger_clock
from logparse.mavlink.dialect import definitions
from logparse.mavlink.findings import scan_findings
from logparse.mavlink.scan import Scan, dialect_arrays
from logparse.source import Boot, MessageSource, clean_text, in_order

_STAMP_BYTES = 8
#: Bytes by which a stream with time stamps is told from one without.
_SAMPLE = 1 << 16
#: Intact frames that make a file of unknown content telemetry; chance gives less than one in a hundred heads.
_ENOUGH_FRAMES = 3
#: MAV_AUTOPILOT_PX4, which sends integer parameters bit by bit in the float field.
_PX4 = 12
_INTEGER_PARAMETERS = {1: "<u1", 2: "<i1", 3: "<u2", 4: "<i2", 5: "<u4", 6: "<i4"}


@dataclass(frozen=True, slots=True)
class _Column:
    """One column of a message: an element of a field."""

    name: str
    offset: int
    dtype: np.dtype[Any]


@cache
def _columns(name: str) -> tuple[_Column, ...]:
    """List the columns of a message: arrays by element, ``voltages[0]``, except text."""
    definition = definitions()[name]
    columns = []
    for field in definition.fields:
        dtype, offset = definition.dtype_and_offset(field)
        if dtype.shape:
            base = dtype.base
            columns += [_Column(f"{field}[{k}]", offset + k * base.itemsize, base) for k in range(dtype.shape[0])]
        else:
            columns.append(_Column(field, offset, dtype))
    return tuple(columns)


@cache
def _units(name: str) -> Mapping[str, str]:
    """Return the unit of each column that has one."""
    declared = definitions()[name].units
    units = {column.name: declared.get(column.name.partition("[")[0]) for column in _columns(name)}
    return {column: unit for column, unit in units.items() if unit is not None}


def looks_like(head: bytes) -> bool:
    """Whether a file that begins so is MAVLink telemetry, with or without time stamps, perhaps damaged."""
    if not (b"\xfe" in head or b"\xfd" in head):
        return False
    scan = Scan(np.frombuffer(head, np.uint8), _STAMP_BYTES)
    scan.run()
    return scan.frames >= _ENOUGH_FRAMES or (scan.frames > 0 and scan.state[_decode.STRAY_BYTES] <= len(head) // 2)


def _stamp_bytes(data: npt.NDArray[np.uint8]) -> int:
    """Bytes of logger time before each frame: with the right number there are fewer bytes between the frames."""
    known = dialect_arrays()
    first = int(
        _decode.find_frame(
            data, np.uint64(0), np.uint64(len(data)), known.slot_of_id, known.crc_extra, known.checksum_tables
        )
    )
    start = max(first - _STAMP_BYTES, 0)
    sample = data[start : start + _SAMPLE]
    breaks = {}
    for count in (_STAMP_BYTES, 0):
        scan = Scan(sample, count)
        scan.run()
        breaks[count] = int(scan.state[_decode.BREAKS])
    return 0 if breaks[0] < breaks[_STAMP_BYTES] else _STAMP_BYTES


class TlogSource(MessageSource):
    """An opened telemetry log; LogError where not one frame is intact."""

    def __init__(self, buffer: Buffer):
        if not len(buffer):
            raise LogError("the file is empty")
        self._data = np.frombuffer(buffer, np.uint8)
        self.scan = Scan(self._data, _stamp_bytes(self._data))
        self._pages = MappedPages(buffer)
        self.scan.run(self._pages)
        if not self.scan.frames:
            raise LogError("no intact MAVLink frame in the file: it is damaged or not a telemetry log")
        self._stamped = self.scan.stamp_bytes > 0
        self.format = "tlog" if self._stamped else "mavlink-raw"
        self._autopilot = self.scan.autopilot()
        self.clock = self._find_boots()
        self._pages.release()
        self._counts: dict[Boot, dict[str, int]] = {}

    @property
    def boots(self) -> tuple[Boot, ...]:
        """Power-ups of the autopilot in the file."""
        return self.clock.boots

    @property
    def autopilot(self) -> tuple[int, int]:
        """System and component whose boot clock and parameters these are."""
        return self._autopilot >> 8, self._autopilot & 0xFF

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """What the scan had to say."""
        return tuple(scan_findings(self.scan, self.clock, self._autopilot, has_boot_time=self.has_boot_time))

    # Clock

    def _find_boots(self) -> BootClock:
        windows = self.scan.take_windows(self._autopilot)
        self.has_boot_time = len(windows) > 0
        if self.has_boot_time:
            return find_boots(windows, len(self._data), self._stamped, self._boundary)
        marks = np.concatenate([chunk.ordered for chunk in self.scan.chunks[:: max(1, len(self.scan.chunks) // 8)]])
        return logger_clock(self._stamps(marks) if self._stamped else np.empty(0, np.int64), len(self._data))

    def _boundary(self, last: int, first: int) -> int:
        """Where between two frames of the autopilot a new boot begins: behind its longest silence."""
        if not self._stamped:
            return first
        begins = self.scan.chunk_begins
        chunks = self.scan.chunks[max(bisect_right(begins, last) - 1, 0) : bisect_right(begins, first)]
        pieces = [c.ordered[(c.ordered >= last) & (c.ordered <= first)] for c in chunks]
        marks = np.sort(np.concatenate(pieces)).astype(np.int64)
        who = marks + np.where(self._data[marks] == 0xFE, 3, 5)
        sender = self._data[who].astype(np.int64) << 8 | self._data[who + 1]
        marks = marks[sender == self._autopilot]
        silence = np.abs(np.diff(self._stamps(marks)))
        self._pages.release()
        return int(marks[int(silence.argmax()) + 1]) - _STAMP_BYTES

    def _stamps(self, marks: npt.NDArray[Any]) -> npt.NDArray[np.int64]:
        """Logger time of frames, us."""
        marks = marks.astype(np.int64)
        marks = marks[marks >= _STAMP_BYTES]
        raw = self._data[(marks - _STAMP_BYTES)[:, None] + np.arange(_STAMP_BYTES)]
        return np.ascontiguousarray(raw).view(">u8")[:, 0].astype(np.int64)

    # Frames

    def _marks(self, slot: int, boot: Boot) -> npt.NDArray[Any]:
        """Start bytes of the frames of one message in a boot, ascending."""
        pieces = [c.ordered[c.starts[slot] : c.starts[slot + 1]] for c in self.scan.chunks]
        marks = np.concatenate(pieces)
        return marks[np.searchsorted(marks, boot.start) : np.searchsorted(marks, boot.stop)]

    def counts(self, boot: Boot) -> Mapping[str, int]:
        """Frames of each message in this boot, by name."""
        if boot not in self._counts:
            total = np.zeros(len(dialect_arrays().messages), np.int64)
            for chunk in self.scan.chunks:
                if boot.start <= chunk.first_mark and chunk.last_mark < boot.stop:
                    total += np.diff(chunk.starts)
                elif chunk.last_mark >= boot.start and chunk.first_mark < boot.stop:
                    inside = (chunk.ordered >= boot.start) & (chunk.ordered < boot.stop)
                    total += np.diff(np.concatenate(([0], np.cumsum(inside)))[chunk.starts])
            names = [message.name for message in dialect_arrays().messages]
            self._counts[boot] = {names[slot]: int(total[slot]) for slot in np.flatnonzero(total)}
        return self._counts[boot]

    def decode_many(
        self, names: Iterable[str], boot: Boot, fields: Collection[str] | None = None
    ) -> dict[str, pd.DataFrame]:
        """Return all fields of several messages from all senders, decoded in one pass over the file.

        The index is the boot clock of the autopilot: the message's own time where it comes from there, else logger time
        less the delay of the messages around it. Arrays have a column for each element (``voltages[0]``). Columns
        ``system`` and ``component`` say who sent each row.
        """
        counts = self.counts(boot)
        names = list(dict.fromkeys(names))
        plan = _Plan(names, [counts.get(name, 0) for name in names])
        known = dialect_arrays()
        self._pages.start_at(boot.start)
        autopilot = (self._autopilot & 0xFF) << 8 | self._autopilot >> 8
        clock_kind, clock_offset = known.clock_kind[plan.slots], known.clock_offset[plan.slots]
        for chunk in self.scan.chunks:
            if chunk.last_mark < boot.start or chunk.first_mark >= boot.stop:
                continue
            _decode.decode(
                self._data, chunk.first_mark, chunk.last_mark, chunk.ordered, chunk.starts, boot.start, boot.stop,
                self._stamped, autopilot, self.clock.knots, plan.slots, clock_kind, clock_offset, plan.first_field,
                plan.field_offset, plan.field_width, plan.column, plan.t_column, plan.sender_column, plan.row,
                *plan.arenas,
            )  # fmt: skip
            self._pages.release_up_to(chunk.last_mark)
        self._pages.release()
        frames = {name: self._frame(plan, k) for k, name in enumerate(names)}
        return {name: in_order(frame) for name, frame in frames.items()} if self.clock.shuffled else frames

    def _frame(self, plan: "_Plan", k: int) -> pd.DataFrame:
        name = plan.names[k]
        columns: dict[str, object] = {}
        for column in _columns(name):
            values = plan.values(k, column.name)
            columns[column.name] = _texts(values) if column.dtype.kind == "S" else values
        columns["system"], columns["component"] = plan.senders(k)
        frame = pd.DataFrame(columns, index=pd.Index(plan.t(k), name="t", copy=False), copy=False)
        frame.attrs["units"] = dict(_units(name))
        return frame

    # Parameters

    def parameters(self, boot: Boot) -> Mapping[str, float]:
        """Parameters of the autopilot: the last value of each up to the end of this boot.

        Parameters outlive a reboot, and a ground station fetches them once: what is reported in later boots only counts
        too. Some ground stations write what they fetched in another way as messages of their own.
        """
        whole = Boot(0, len(self._data), 0.0, 0.0)
        if "PARAM_VALUE" not in self.counts(whole):
            return {}
        rows = self.decode("PARAM_VALUE", whole)
        with np.errstate(invalid="ignore"):  # signalling NaNs
            values = rows["param_value"].to_numpy(np.float64)
        if self._is_px4(whole):
            bits = rows["param_value"].to_numpy(np.float32)
            for number, dtype in _INTEGER_PARAMETERS.items():
                these = rows["param_type"].to_numpy() == number
                cells = bits[these].view(np.uint8).reshape(-1, 4)[:, : np.dtype(dtype).itemsize]
                values[these] = np.ascontiguousarray(cells).view(dtype)[:, 0]
        systems = rows["system"].to_numpy(np.int64)
        kept = systems << 8 | rows["component"].to_numpy() == self._autopilot
        kept |= ~np.isin(systems, np.flatnonzero(self.scan.link_votes) >> 8)
        names = rows["param_id"].to_numpy(object)
        known = int(np.searchsorted(self._marks(dialect_arrays().slot_of_name["PARAM_VALUE"], whole), boot.stop))
        later = np.flatnonzero(kept[known:])[::-1] + known
        parameters: dict[str, float] = {}
        for k in np.concatenate((later, np.flatnonzero(kept[:known]))):
            parameters[names[k]] = float(values[k])
        return parameters

    def _is_px4(self, whole: Boot) -> bool:
        if "HEARTBEAT" not in self.counts(whole):
            return False
        beats = self.decode("HEARTBEAT", whole)
        system, component = self.autopilot
        ours = beats[(beats["system"] == system) & (beats["component"] == component)]
        return bool((ours["autopilot"] == _PX4).mean() > 0.5) if len(ours) else False


class _Plan:
    """Where the columns of some messages lie in one block of memory."""

    def __init__(self, names: list[str], rows: list[int]):
        self.names = names
        self.rows = rows
        self.slots = np.array([dialect_arrays().slot_of_name[name] for name in names], np.int64)
        self.row = np.zeros(len(names), np.int64)
        first, offset, width, column, t_column, sender_column = [0], [], [], [], [], []
        self._places: list[dict[str, tuple[int, np.dtype[Any]]]] = []
        end = 0
        for name, n in zip(names, rows, strict=True):
            t_column.append(end // 8)
            end += 8 * n
            sender_column.append(end // 2)
            end += -(-2 * n // 8) * 8
            places = {}
            for item in _columns(name):
                is_text = item.dtype.kind == "S"
                offset.append(item.offset)
                width.append(-item.dtype.itemsize if is_text else item.dtype.itemsize)
                column.append(end if is_text else end // item.dtype.itemsize)
                places[item.name] = (end, item.dtype)
                end += -(-n * item.dtype.itemsize // 8) * 8
            self._places.append(places)
            first.append(len(offset))
        self.first_field = np.array(first, np.int64)
        self.field_offset, self.field_width = np.array(offset, np.int64), np.array(width, np.int64)
        self.column = np.array(column, np.int64)
        self.t_column, self.sender_column = np.array(t_column, np.int64), np.array(sender_column, np.int64)
        self._memory = np.empty(end, np.uint8)
        self.arenas = (
            self._memory,
            *(self._memory.view(kind) for kind in (np.uint16, np.uint32, np.uint64, np.float64)),
        )

    def t(self, k: int) -> npt.NDArray[np.float64]:
        """Boot clock of each row of message k, s."""
        start = int(self.t_column[k]) * 8
        return self._memory[start : start + 8 * self.rows[k]].view(np.float64)

    def senders(self, k: int) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.uint8]]:
        """System and component of each row of message k."""
        start = int(self.sender_column[k]) * 2
        senders = self._memory[start : start + 2 * self.rows[k]].reshape(-1, 2)
        return senders[:, 0], senders[:, 1]

    def values(self, k: int, name: str) -> npt.NDArray[Any]:
        """Column `name` of message k."""
        start, dtype = self._places[k][name]
        return self._memory[start : start + self.rows[k] * dtype.itemsize].view(dtype)


def _texts(cells: npt.NDArray[np.bytes_]) -> Any:
    """Text column of cells that are filled up with zeros."""
    # Most texts recur: decode each once.
    raw = pa.Array.from_buffers(pa.binary(cells.dtype.itemsize), len(cells), [None, pa.py_buffer(cells.view(np.uint8))])
    coded = raw.dictionary_encode()
    texts = pd.array([clean_text(text) for text in coded.dictionary.to_pylist()], dtype="str")
    return texts.take(coded.indices.to_numpy(zero_copy_only=False))
