"""Where the columns of DataFlash messages lie in memory, and what they become in a DataFrame."""

from collections.abc import Collection
from itertools import compress
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import pyarrow as pa

from logparse.dataflash import _decode
from logparse.dataflash.chain import Slot
from logparse.dataflash.format import UnitTable
from logparse.source import clean_text

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


class Layout:
    """Where the columns of some tables lie in one block of memory."""

    def __init__(self, slots: list[Slot], rows: list[int], units: UnitTable, wanted: Collection[str] | None = None):
        self.slots, self.rows = slots, rows
        chosen = [[wanted is None or item.name in wanted for item in slot.fields] for slot in slots]
        self._fields = [list(compress(slot.fields, kept)) for slot, kept in zip(slots, chosen, strict=True)]
        self._scales = [list(compress(slot.scales(units), kept)) for slot, kept in zip(slots, chosen, strict=True)]
        first, offset, operation, size, target, factor, divisor = [0], [], [], [], [], [], []
        self._places: list[list[tuple[int, np.dtype]]] = []
        end = 0
        for slot, fields, n, scales in zip(slots, self._fields, rows, self._scales, strict=True):
            places = []
            plan = [(item, *scale) for item, scale in zip(fields, scales, strict=True)]
            if slot.time is not None:
                # The index: the boot clock in seconds.
                plan.append((slot.time, 1.0, float(slot.time_scale)))
            for k, (item, up, down) in enumerate(plan):
                code = item.type.dtype.str.lstrip("<|")
                is_index = k == len(fields)
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
        return self._raw(table, len(self._fields[table]))

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
            elif item.char == "g":
                up, down = self._scales[table][k]
                with np.errstate(invalid="ignore"):  # signalling NaNs of damaged rows
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
