"""Write DataFlash binary logs as ArduPilot does, for simulated flights and for tests.

Values are given as the reader returns them: in the units that the definition states, the time column as the integer
of the file. ``GPS.Lat`` of format ``L`` is in degrees, ``MAG.MagX`` of format ``h`` and multiplier
``C`` in Gauss.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt
import pandas as pd

from logparse.dataflash.format import (
    FIELD_TYPES,
    FMT,
    FMT_ID,
    HEADER,
    HEADER_LENGTH,
    LONGEST_FORMAT,
    LONGEST_LABELS,
    LONGEST_MESSAGE,
    LONGEST_NAME,
    MULTIPLIERS,
    TIME_COLUMNS,
    UNITS,
    Definition,
    Field,
)

_LAST_ID = 254

#: One message for `write_dataflash`: name, format, unit ids, multiplier ids, table.
MessageTable = tuple[str, str, str, str, pd.DataFrame]


class MessageLayout:
    """Packs the columns of one message into the bytes of its rows."""

    def __init__(self, definition: Definition, multipliers: str):
        self.definition = definition
        self.fields: tuple[Field, ...] = definition.fields()
        names = ["header", *(f"f{k}" for k in range(len(self.fields)))]
        formats: list[Any] = ["V3"]
        for field in self.fields:
            formats.append(field.type.dtype if field.type.items == 1 else (field.type.dtype, (field.type.items,)))
        self.dtype = np.dtype({"names": names, "formats": formats})
        self.scales: list[tuple[float, float]] = []
        for k, field in enumerate(self.fields):
            # A legacy format character already implies its scale; the multiplier only repeats it.
            multiplier = MULTIPLIERS.get(multipliers[k], 0.0) if k < len(multipliers) else 0.0
            if field.type.divisor != 1:
                self.scales.append((1.0, float(field.type.divisor)))
            elif multiplier in (0.0, 1.0) or field.type.is_text or field.name in TIME_COLUMNS:
                self.scales.append((1.0, 1.0))
            elif multiplier < 1.0:
                self.scales.append((1.0, float(round(1.0 / multiplier))))
            else:
                self.scales.append((multiplier, 1.0))

    def pack(self, columns: Mapping[str, Any], rows: int) -> npt.NDArray[np.uint8]:
        """Return rows as bytes, shape (rows, length of the message)."""
        records = np.zeros(rows, self.dtype)
        raw = records.view(np.uint8).reshape(rows, self.dtype.itemsize)
        raw[:, :HEADER_LENGTH] = np.frombuffer(HEADER + bytes((self.definition.id,)), np.uint8)
        for k, field in enumerate(self.fields):
            if field.name not in columns:
                raise ValueError(f"{self.definition.name}: column {field.name} is missing")
            try:
                records[f"f{k}"] = _encode(columns[field.name], field, *self.scales[k])
            except (TypeError, ValueError, OverflowError) as error:
                raise ValueError(f"{self.definition.name}.{field.name} (format {field.char}): {error}") from error
        return raw


class DataflashWriter:
    """Writes messages to a binary stream; FMT, UNIT, MULT and FMTU rows are added automatically."""

    def __init__(self, stream: BinaryIO, start_us: int = 0):
        self._stream = stream
        self._time_us = start_us
        self._layouts: dict[str, MessageLayout] = {}
        self._ids: set[int] = {FMT_ID}
        self._declare(FMT, "")
        for name, form, labels in (
            ("FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds"),
            ("UNIT", "QbZ", "TimeUS,Id,Label"),
            ("MULT", "Qbd", "TimeUS,Id,Mult"),
        ):
            self._declare(self._definition(name, form, labels.split(","), None), "")
        for unit_id, label in UNITS.items():
            self.write("UNIT", self._time_us, ord(unit_id), label)
        for multiplier_id, multiplier in MULTIPLIERS.items():
            self.write("MULT", self._time_us, ord(multiplier_id), multiplier)
        self._write_units("FMT", "-b---", "-----")
        self._write_units("FMTU", "s---", "F---")
        self._write_units("UNIT", "s--", "F--")
        self._write_units("MULT", "s--", "F--")

    def define(
        self,
        name: str,
        format: str,  # noqa: A002 - ArduPilot's term
        columns: str | Sequence[str],
        units: str = "",
        multipliers: str = "",
        id: int | None = None,  # noqa: A002
    ) -> None:
        """Define a message, once, before its first row."""
        labels = columns.split(",") if isinstance(columns, str) else list(columns)
        self._declare(self._definition(name, format, labels, id), multipliers)
        if units or multipliers:
            n = len(format)
            self._write_units(name, units.ljust(n, "-"), multipliers.ljust(n, "-"))

    def write(self, name: str, *values: object) -> None:
        """Write one row, a value per field."""
        layout = self._layouts[name]
        if len(values) != len(layout.fields):
            raise ValueError(f"{name} has {len(layout.fields)} fields, got {len(values)} values")
        columns = {field.name: [value] for field, value in zip(layout.fields, values, strict=True)}
        self._write_rows(layout, layout.pack(columns, 1))

    def write_table(self, name: str, columns: Mapping[str, npt.ArrayLike]) -> None:
        """Write rows in the order given; `columns` must have every field of the message."""
        layout = self._layouts[name]
        rows = len(np.asarray(next(iter(columns.values()))))
        self._write_rows(layout, layout.pack(columns, rows))

    def write_interleaved(self, tables: Iterable[tuple[str, npt.ArrayLike, Mapping[str, npt.ArrayLike]]]) -> None:
        """Write tables of (name, time [s], columns) as one stream ordered by time; ties keep the order given."""
        packed: list[npt.NDArray[np.uint8]] = []
        times: list[npt.NDArray[np.float64]] = []
        for name, time, columns in tables:
            table_time = np.asarray(time, np.float64)
            packed.append(self._layouts[name].pack(columns, len(table_time)))
            times.append(table_time)
        if not packed:
            return
        self._stream.write(interleaved(packed, times).data)
        last = max((float(t.max()) for t in times if len(t)), default=0.0)
        self._time_us = max(self._time_us, round(last * 1e6))

    def _definition(self, name: str, form: str, labels: Sequence[str], message_id: int | None) -> Definition:
        if not 0 < len(name.encode("ascii")) <= LONGEST_NAME:
            raise ValueError(f"a message name has one to four characters, not {name!r}")
        unknown = set(form) - set(FIELD_TYPES)
        if unknown or len(form) > LONGEST_FORMAT:
            raise ValueError(f"{name}: format {form!r} has unknown characters or more than {LONGEST_FORMAT}")
        if len(labels) != len(form) or len(set(labels)) != len(labels):
            raise ValueError(f"{name}: {len(form)} format characters need as many different labels, not {labels}")
        if len(",".join(labels)) > LONGEST_LABELS:
            raise ValueError(f"{name}: labels are longer than {LONGEST_LABELS} characters together")
        length = HEADER_LENGTH + sum(FIELD_TYPES[char].size for char in form)
        if length > LONGEST_MESSAGE:
            raise ValueError(f"{name}: a message has at most {LONGEST_MESSAGE} bytes, this has {length}")
        if message_id is None:
            # Ids above FMT's first, as ArduPilot numbers its common messages, then those below.
            free = (k for k in (*range(FMT_ID + 1, _LAST_ID + 1), *range(FMT_ID)) if k not in self._ids)
            message_id = next(free, None)
            if message_id is None:
                raise ValueError("all message ids are taken")
        elif not 0 <= message_id <= LONGEST_MESSAGE or message_id == FMT_ID:
            raise ValueError(f"{name}: {message_id} cannot be the id of a message")
        return Definition(message_id, length, name, form, tuple(labels))

    def _declare(self, definition: Definition, multipliers: str) -> None:
        self._layouts[definition.name] = MessageLayout(definition, multipliers)
        self._ids.add(definition.id)
        self._stream.write(definition.pack())

    def _write_units(self, name: str, units: str, multipliers: str) -> None:
        self.write("FMTU", self._time_us, self._layouts[name].definition.id, units, multipliers)

    def _write_rows(self, layout: MessageLayout, raw: npt.NDArray[np.uint8]) -> None:
        self._stream.write(raw.tobytes())
        if len(raw) and layout.fields and layout.fields[0].name == "TimeUS":
            self._time_us = int(raw[-1, HEADER_LENGTH : HEADER_LENGTH + 8].copy().view("<u8")[0])


def interleaved(packed: Sequence[npt.NDArray[np.uint8]], keys: Sequence[npt.NDArray[Any]]) -> npt.NDArray[np.uint8]:
    """Return the rows of several messages as one stream, sorted stably by their keys.

    Shapes: each of `packed` (rows, bytes of the message), of `keys` (rows,); of the result (total bytes,).
    """
    lengths = np.concatenate([np.full(len(raw), raw.shape[1], np.int64) for raw in packed])
    order = np.argsort(np.concatenate(keys), kind="stable")
    starts = np.empty(len(order), np.int64)
    starts[order] = np.cumsum(lengths[order]) - lengths[order]
    out = np.empty(int(lengths.sum()), np.uint8)
    first = 0
    for raw in packed:
        rows, length = raw.shape
        out[starts[first : first + rows, None] + np.arange(length)] = raw
        first += rows
    return out


def write_dataflash(path: str | Path, messages: Iterable[MessageTable]) -> None:
    """Write tables as one DataFlash log, rows interleaved by time."""
    tables: list[tuple[str, npt.ArrayLike, Mapping[str, npt.ArrayLike]]] = []
    definitions: list[tuple[str, str, list[str], str, str]] = []
    for name, form, units, multipliers, frame in messages:
        columns: dict[str, Any] = {str(label): frame[label].to_numpy() for label in frame.columns}
        if frame.index.name == "t":
            time = frame.index.to_numpy(np.float64)
            if len(form) == len(columns) + 1 and "TimeUS" not in columns:
                columns = {"TimeUS": np.rint(time * 1e6).astype(np.uint64), **columns}
        elif "TimeUS" in columns:
            time = np.asarray(columns["TimeUS"], np.float64) * 1e-6
        else:
            raise ValueError(f"{name} has neither an index t nor a column TimeUS")
        tables.append((name, time, columns))
        definitions.append((name, form, list(columns), units, multipliers))
    start = min((float(np.min(np.asarray(time))) for _, time, _ in tables if len(np.asarray(time))), default=0.0)
    with Path(path).open("wb") as stream:
        writer = DataflashWriter(stream, start_us=max(0, round(start * 1e6)))
        for name, form, labels, units, multipliers in definitions:
            writer.define(name, form, labels, units, multipliers)
        writer.write_interleaved(tables)


def _encode(values: npt.ArrayLike, field: Field, factor: float, divisor: float) -> npt.NDArray[Any]:
    """Return values as stored in the file: unscaled, and rounded to integers for integer fields."""
    kind = field.type
    if kind.is_text:
        return _encode_text(values, kind.dtype)
    array = np.asarray(values)
    if array.dtype.kind == "f" and not isinstance(values, np.ndarray):
        # numpy turns a list of large and small integers into floats, which lose the last digits.
        exact = np.array(values, dtype=object)
        if all(isinstance(value, int | np.integer) for value in exact):
            array = exact
    if array.dtype == object and kind.items != 1:
        array = np.stack([np.asarray(value) for value in array]) if len(array) else np.empty((0, kind.items))
    if kind.items != 1:
        if array.shape[1:] != (kind.items,):
            raise ValueError(f"each row is an array of {kind.items} integers")
    elif array.ndim != 1:
        raise ValueError("a column has one dimension")
    if factor != 1.0 or divisor != 1.0:
        array = array.astype(np.float64) / factor * divisor
    if kind.dtype.kind == "f":
        return array.astype(kind.dtype)
    if array.dtype.kind == "f":
        if not np.isfinite(array).all():
            raise ValueError("an integer field cannot hold NaN or infinity")
        array = np.rint(array)
    limits = np.iinfo(kind.dtype)
    # Compared as Python integers, because a float above 2**63 could be rounded into range.
    if array.size and (int(array.min()) < limits.min or int(array.max()) > limits.max):
        raise ValueError(
            f"values reach from {array.min()} to {array.max()}, the field from {limits.min} to {limits.max}"
        )
    return array.astype(kind.dtype)


def _encode_text(values: npt.ArrayLike, dtype: np.dtype) -> npt.NDArray[Any]:
    encoded = [v if isinstance(v, bytes) else str(v).encode() for v in np.asarray(values, object)]
    longest = max(map(len, encoded), default=0)
    if longest > dtype.itemsize:
        raise ValueError(f"text of {longest} bytes does not fit into {dtype.itemsize}")
    return np.array(encoded, dtype)
