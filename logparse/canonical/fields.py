"""Columns of messages as tables of fields: which message of which age and autopilot holds a quantity, in which unit.

A field is written ``Name unit``, with further ones for other ages of the firmware behind bars: ``BAlt m | BarAlt m``. A
minus before it turns the sign.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from enum import Enum
from functools import cache

import numpy as np
import pandas as pd

from core.attitude import euler_from_quat
from core.units import numbers, quantity
from logparse.canonical.series import ANGLES, Array, series, wrap
from logparse.craft.vehicle import vehicle_heartbeats
from logparse.messages import MessageView
from logparse.source import INSTANCE_NAMES


class Kind(Enum):
    """Kinds of logs, which name what they hold each in its way: PX4 in SI units, NED and FRD already."""

    DATAFLASH = "dataflash"
    TELEMETRY = "telemetry"
    PX4 = "px4"


Messages = MessageView
#: Columns of a canonical table and where a message has them.
Fields = Mapping[str, str]
#: A table of the first healthy instance of a sensor, and those of the others.
Sensor = tuple[pd.DataFrame | None, tuple[pd.DataFrame, ...]]


class Sender(MessageView):
    """Messages of the vehicle's autopilot in telemetry, those of ground station and companions left out."""

    def __init__(self, messages: Messages) -> None:
        super().__init__(messages)
        beats = vehicle_heartbeats(messages)
        self._ids: dict[str, int] = {}
        if beats is not None and len(beats):
            self._ids = {name: int(beats[name].iloc[0]) for name in ("system", "component") if name in beats}

    def __getitem__(self, name: str) -> pd.DataFrame:
        frame = self._messages[name]
        keep = np.ones(len(frame), dtype=bool)
        for column, value in self._ids.items():
            if column in frame:
                keep &= frame[column].to_numpy() == value
        return frame if keep.all() else rows_of(frame, keep)


def rows_of(frame: pd.DataFrame, keep: "np.ndarray | pd.Series[bool]") -> pd.DataFrame:
    """Return some rows of a message with its units."""
    part: pd.DataFrame = frame[keep]
    part.attrs = frame.attrs
    return part


def first(messages: Messages, *names: str) -> pd.DataFrame | None:
    """Return the first of the messages that is logged with at least one row."""
    return next((messages[name] for name in names if name in messages and len(messages[name])), None)


@cache
def _alternatives(field: str) -> tuple[tuple[str, str, float], ...]:
    """Return name, unit and sign of each way to write a field."""
    parts = (part.strip().partition(" ") for part in field.split("|"))
    return tuple((name.lstrip("-"), unit, -1.0 if name.startswith("-") else 1.0) for name, _, unit in parts)


def names_of(fields: Fields) -> set[str]:
    """Return every name that fields may have in a message."""
    return {name for field in fields.values() for name, _, _ in _alternatives(field)}


def plain(fields: Fields) -> list[tuple[str, str]]:
    """List name and unit of fields that have one name only."""
    return [_alternatives(field)[0][:2] for field in fields.values()]


def value(frame: pd.DataFrame, field: str) -> Array:
    """Read a field in SI units by the first of its names that the message has; NaN without any."""
    for name, unit, sign in _alternatives(field):
        if name in frame:
            read = quantity(frame, name, unit)
            return read if sign > 0.0 else -read
    return np.full(len(frame), np.nan)


def has(frame: pd.DataFrame, field: str) -> bool:
    """Return whether a message has a field under any of its names."""
    return any(name in frame for name, _, _ in _alternatives(field))


def values(frame: pd.DataFrame, fields: Fields) -> dict[str, Array]:
    """Read fields in SI units; angles of an attitude lie within half a turn."""
    return {
        column: wrap(value(frame, field)) if column in ANGLES else value(frame, field)
        for column, field in fields.items()
    }


def table(frame: pd.DataFrame, fields: Fields) -> pd.DataFrame:
    """Make a canonical table of the fields of one message."""
    return series(frame.index, values(frame, fields))


def axes(fields: Fields, **letters: Sequence[str]) -> dict[str, str]:
    """Write fields of several axes: ``axes({"p_{n}": "P{N} m"}, n="ned", N="NED")`` has p_n, p_e and p_d."""
    rows = [dict(zip(letters, each, strict=True)) for each in zip(*letters.values(), strict=True)]
    return {column.format(**row): field.format(**row) for column, field in fields.items() for row in rows}


def quaternion_angles(frame: pd.DataFrame, name: str, numbered: range) -> dict[str, Array]:
    """Read an attitude that is logged as a quaternion, scalar first, in four numbered columns."""
    quat_nb = np.column_stack([value(frame, name.format(k)) for k in numbered])
    norm = np.linalg.norm(quat_nb, axis=1, keepdims=True)
    return dict(zip(ANGLES, euler_from_quat(np.where(norm > 0.5, quat_nb, np.nan)).T, strict=True))


def instances(
    messages: Messages, *names: str, fields: Collection[str] | None = None
) -> Iterator[tuple[str, pd.DataFrame]]:
    """Yield the instances of a sensor in their order, each with its name for findings.

    They have a number in the name of their message, or an instance column.
    """
    for name in names:
        if name not in messages:
            continue
        frame = messages[name] if fields is None else messages.part(name, fields)
        column = instance_column(frame)
        if column is None:
            if len(frame):
                yield name, frame
            continue
        logged = frame[column].to_numpy()
        if len(logged) and logged.dtype.kind in "iu" and (logged == logged[0]).all():
            yield f"{name}[{int(logged[0])}]", frame
            continue
        counted = numbers(frame, column)
        for number in np.unique(counted[np.isfinite(counted)]):
            of_this = counted == number
            yield f"{name}[{int(number)}]", frame if of_this.all() else rows_of(frame, of_this)


def instance_column(frame: pd.DataFrame) -> str | None:
    """Return the name of the column that counts the instances of a sensor; None where the message has none."""
    return next((column for column in INSTANCE_NAMES if column in frame), None)


def pick(tables: list[pd.DataFrame], key: str, preferred: int = 0) -> Sensor:
    """Pick the first healthy instance of a sensor and keep the others that measured anything.

    An instance is healthy when column `key` has at least half as many values as that of the best instance.
    """
    counts = [int(table[key].notna().sum()) for table in tables]
    best = max(counts, default=0)
    if best == 0:
        return None, ()
    order = sorted(range(len(tables)), key=lambda k: (k != preferred, k))
    chosen = next(k for k in order if counts[k] >= 0.5 * best)
    return tables[chosen], tuple(tables[k] for k in range(len(tables)) if k != chosen and counts[k] > 0)
