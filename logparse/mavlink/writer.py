"""Write MAVLink telemetry logs as ground stations do, for simulated flights and for tests.

Each record is the receive time, 8 bytes big-endian, in microseconds since 1970 UTC, followed by one MAVLink 2 frame as
pymavlink packs it. Values are the protocol's own: ``GPS_RAW_INT.lat`` in 1e-7 degrees, ``SYS_STATUS.voltage_battery``
in mV (see `dialect`). A field left out is zero, which is also how MAVLink 2 reads a field cut off a frame.
"""

import re
import struct
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt
import pandas as pd

from logparse.mavlink.dialect import MessageDefinition, definitions, pymavlink_dialect

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_ELEMENT = re.compile(r"(?P<field>\w+)\[(?P<index>\d+)\]")


class TlogWriter:
    """Writes time-stamped MAVLink 2 frames to a binary stream; sequence numbers count up per component."""

    def __init__(self, stream: BinaryIO):
        self._stream = stream
        self._links: dict[tuple[int, int], Any] = {}

    def write(self, time_unix_us: int, name: str, /, system: int = 1, component: int = 1, **fields: Any) -> None:
        """Write one message."""
        definition = _definition(name)
        self._write_records(
            definition,
            _records(definition, {key: [value] for key, value in fields.items()}, 1),
            [time_unix_us],
            [system],
            [component],
        )

    def write_table(
        self,
        name: str,
        time_unix_us: npt.ArrayLike,
        columns: Mapping[str, npt.ArrayLike],
    ) -> None:
        """Write many messages of one name, in the order given."""
        stamps = np.asarray(time_unix_us, np.int64)
        definition = _definition(name)
        records = _records(definition, columns, len(stamps))
        self._write_records(definition, records, stamps.tolist(), [1] * len(stamps), [1] * len(stamps))

    def _write_records(
        self,
        definition: MessageDefinition,
        records: npt.NDArray[np.void],
        stamps: Iterable[int],
        systems: Iterable[int],
        components: Iterable[int],
    ) -> None:
        dialect = pymavlink_dialect
        message_class = dialect.mavlink_map[definition.id]
        wire_names = definition.wire.names or ()
        order = [wire_names.index(name) for name in definition.fields]
        for row, stamp, system, component in zip(records.tolist(), stamps, systems, components, strict=True):
            link = self._links.get((system, component))
            if link is None:
                link = self._links[system, component] = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
            frame = message_class(*(row[k] for k in order)).pack(link)
            link.seq = (link.seq + 1) % 256
            self._stream.write(struct.pack(">Q", stamp) + frame)


def write_tlog(
    path: str | Path,
    messages: Iterable[tuple[str, pd.DataFrame]],
    start_utc: datetime,
) -> None:
    """Write tables as one telemetry log, rows interleaved by time."""
    start_us = (start_utc - _EPOCH) // timedelta(microseconds=1)
    tables = []
    for name, frame in messages:
        definition = _definition(name)
        t = frame.index.to_numpy(np.float64)
        boot_us = np.rint(t * 1e6).astype(np.int64)
        columns: dict[str, npt.ArrayLike] = {str(column): frame[column].to_numpy() for column in frame.columns}
        systems = np.broadcast_to(np.asarray(columns.pop("system", 1)), t.shape)
        components = np.broadcast_to(np.asarray(columns.pop("component", 1)), t.shape)
        if "time_boot_ms" in definition.fields:
            columns.setdefault("time_boot_ms", np.rint(t * 1e3))
        if "time_usec" in definition.fields:
            columns.setdefault("time_usec", boot_us)
        tables.append((definition, _records(definition, columns, len(t)), start_us + boot_us, systems, components))
    if not tables:
        raise ValueError("a log needs at least one table")
    table_of_row = np.repeat(np.arange(len(tables)), [len(table[1]) for table in tables])
    row_in_table = np.concatenate([np.arange(len(table[1])) for table in tables])
    stamps = np.concatenate([table[2] for table in tables])
    with Path(path).open("wb") as stream:
        writer = TlogWriter(stream)
        for k in np.argsort(stamps, kind="stable"):
            definition, records, table_stamps, systems, components = tables[table_of_row[k]]
            row = row_in_table[k]
            writer._write_records(
                definition,
                records[row : row + 1],
                [int(table_stamps[row])],
                [int(systems[row])],
                [int(components[row])],
            )


def _definition(name: str) -> MessageDefinition:
    try:
        return definitions()[name]
    except KeyError:
        raise ValueError(f"MAVLink has no message {name!r}") from None


def _records(definition: MessageDefinition, columns: Mapping[str, npt.ArrayLike], rows: int) -> npt.NDArray[np.void]:
    """Rows in wire layout, shape (rows,)."""
    records = np.zeros(rows, definition.wire)
    for key, values in columns.items():
        element = _ELEMENT.fullmatch(key)
        name = element["field"] if element else key
        if name not in definition.fields:
            raise ValueError(f"{definition.name} has no field {name!r}; it has {', '.join(definition.fields)}")
        target = records[name][:, int(element["index"])] if element else records[name]
        try:
            target[...] = _stored(values, target)
        except (TypeError, ValueError, OverflowError) as error:
            raise ValueError(f"{definition.name}.{key}: {error}") from error
    return records


def _stored(values: npt.ArrayLike, target: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Values as the wire holds them: text as bytes, integers rounded and within range."""
    if target.dtype.kind == "S":
        texts = [text.encode() if isinstance(text, str) else bytes(text) for text in np.asarray(values, object)]
        longest = max(map(len, texts), default=0)
        if longest > target.dtype.itemsize:
            raise ValueError(f"{longest} bytes of text do not fit into {target.dtype.itemsize}")
        return np.array(texts, target.dtype)
    array = np.asarray(values)
    if array.dtype == object:
        array = np.array([np.asarray(value) for value in array])
    if target.dtype.kind == "f":
        return array
    limits = np.iinfo(target.dtype)
    if array.dtype.kind == "f":
        if not np.isfinite(array).all():
            raise ValueError("not finite, and the field is an integer")
        array = np.rint(array)
    if array.size and (array.min() < limits.min or array.max() > limits.max):
        raise ValueError(f"outside {limits.min} .. {limits.max}")
    return array
