"""The walk over a telemetry stream: where the intact frames of each message lie, and what was met on the way."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from logparse.containers import MappedPages
from logparse.mavlink import _decode
from logparse.mavlink.dialect import MessageDefinition, definitions

#: Frames per chunk: few enough that a chunk of the file and its columns stay in the processor's cache.
_CHUNK_FRAMES = 1 << 14
_MOST_UNKNOWN = 64
#: Clock windows, ms of boot time: shorter where there is no logger time to tell the time between.
_WINDOW_MS, _RAW_WINDOW_MS = 1000, 100


@dataclass(frozen=True, slots=True)
class DialectArrays:
    """The dialect as the kernels take it; a message's slot is its place in `messages`."""

    messages: tuple[MessageDefinition, ...]
    slot_of_name: Mapping[str, int]
    slot_of_id: npt.NDArray[np.int16]
    crc_extra: npt.NDArray[np.uint16]
    checksum_tables: npt.NDArray[np.uint16]
    boot_field: npt.NDArray[np.int64]
    clock_kind: npt.NDArray[np.int64]
    clock_offset: npt.NDArray[np.int64]


@cache
def dialect_arrays() -> DialectArrays:
    """Return the arrays of the dialect, made once."""
    messages = tuple(definitions().values())
    slot_of_id = np.full(max(message.id for message in messages) + 1, -1, np.int16)
    boot_field = np.full(len(messages), -1, np.int64)
    clock = np.zeros((len(messages), 2), np.int64)
    for slot, message in enumerate(messages):
        slot_of_id[message.id] = slot
        for name, dtype, kind in (
            ("time_boot_ms", "<u4", _decode.CLOCK_BOOT_MS),
            ("time_usec", "<u4", _decode.CLOCK_US32),
            ("time_usec", "<u8", _decode.CLOCK_US64),
        ):
            if clock[slot, 0] == _decode.CLOCK_NONE and name in message.fields:
                field_dtype, offset = message.dtype_and_offset(name)
                if field_dtype == dtype:
                    clock[slot] = kind, offset
                    if kind == _decode.CLOCK_BOOT_MS:
                        boot_field[slot] = offset
    return DialectArrays(
        messages,
        {message.name: slot for slot, message in enumerate(messages)},
        slot_of_id,
        np.array([message.crc_extra for message in messages], np.uint16),
        _decode.checksum_tables(),
        boot_field,
        clock[:, 0].copy(),
        clock[:, 1].copy(),
    )


@dataclass(frozen=True, slots=True)
class Chunk:
    """Some thousand successive frames, sorted by message (see `_decode.sort_by_slot`)."""

    first_mark: int
    last_mark: int
    ordered: npt.NDArray[Any]
    starts: npt.NDArray[np.int32]


class Scan:
    """One walk over a stream, with or without time stamps."""

    def __init__(self, data: npt.NDArray[np.uint8], stamp_bytes: int):
        self.data, self.stamp_bytes = data, stamp_bytes
        self.chunks: list[Chunk] = []
        self.unknown = np.zeros((_MOST_UNKNOWN, 2), np.int64)
        self.bad_by_slot = np.zeros(len(dialect_arrays().messages), np.int64)
        self.link_frames, self.link_lost, self.link_votes = (np.zeros(_decode.LINKS, np.int64) for _ in range(3))
        self.state = np.zeros(_decode.STATE_SIZE, np.int64)
        self.state[_decode.TAIL] = len(data)
        self._next_seq = np.full(_decode.LINKS, -1, np.int16)
        self._open_windows = np.zeros((_decode.LINKS, _decode.WINDOW_SIZE), np.int64)
        self._windows: list[npt.NDArray[np.int64]] = []

    def run(self, pages: MappedPages | None = None) -> None:
        """Walk to the end of the stream."""
        known = dialect_arrays()
        # Four bytes per frame where they do.
        offsets = np.empty(_CHUNK_FRAMES, np.uint32 if len(self.data) < 1 << 32 else np.uint64)
        slots = np.empty(_CHUNK_FRAMES, np.uint16)
        windows = np.empty((_CHUNK_FRAMES // 4, 1 + _decode.WINDOW_SIZE), np.int64)
        while self.state[_decode.POSITION] < len(self.data):
            n, n_windows = _decode.scan(
                self.data, self.stamp_bytes, known.slot_of_id, known.crc_extra, known.checksum_tables,
                known.boot_field, known.slot_of_name["HEARTBEAT"],
                _WINDOW_MS if self.stamp_bytes else _RAW_WINDOW_MS, self.state, offsets, slots, self.unknown,
                self.bad_by_slot, self._next_seq, self.link_frames, self.link_lost, self.link_votes,
                self._open_windows, windows,
            )  # fmt: skip
            if n:
                ordered, starts = _decode.sort_by_slot(offsets[:n], slots[:n], len(known.messages))
                self.chunks.append(Chunk(int(offsets[0]), int(offsets[n - 1]), ordered, starts))
            if n_windows:
                self._windows.append(windows[:n_windows].copy())
            if pages is not None:
                pages.release_up_to(int(self.state[_decode.POSITION]))

    @cached_property
    def chunk_begins(self) -> list[int]:
        """Where the first frame of each chunk begins."""
        return [chunk.first_mark for chunk in self.chunks]

    @property
    def frames(self) -> int:
        """Intact frames."""
        return sum(len(chunk.ordered) for chunk in self.chunks)

    def take_windows(self, link: int) -> npt.NDArray[np.int64]:
        """Clock windows of one sender in the order of the stream; all windows are forgotten."""
        rows = np.concatenate([*self._windows, np.empty((0, 1 + _decode.WINDOW_SIZE), np.int64)])
        self._windows.clear()
        ours = rows[:, 0] == link
        closed = rows[:, 1:] if ours.all() else rows[ours, 1:]
        last = self._open_windows[link : link + 1]
        return np.concatenate((closed, last[last[:, _decode.SAMPLES] > 0]))

    def autopilot(self) -> int:
        """Link of the vehicle's autopilot: most heartbeats, else most messages with boot time, else most frames."""
        if self.link_votes.any():
            return int(self.link_votes.argmax())
        timed = np.zeros(_decode.LINKS, np.int64)
        for rows in self._windows:
            np.add.at(timed, rows[:, 0], rows[:, 1 + _decode.SAMPLES])
        timed += self._open_windows[:, _decode.SAMPLES]
        return int((timed if timed.any() else self.link_frames).argmax())
