"""Sensors that come several times: messages with a number in their name, or with an instance column."""

from collections.abc import Collection, Mapping

import numpy as np
import pandas as pd

from core.units import numbers
from logparse.messages import PassingMessages

#: Columns that hold the instance, by age of the firmware.
INSTANCE_NAMES = ("I", "Instance", "Inst")


def some_fields(messages: Mapping[str, pd.DataFrame], name: str, fields: Collection[str] | None) -> pd.DataFrame:
    """Return a message; of a long one only `fields`, for the others would take memory for nothing."""
    return messages.once(name, fields) if isinstance(messages, PassingMessages) else messages[name]


def instances(
    messages: Mapping[str, pd.DataFrame], *names: str, fields: Collection[str] | None = None
) -> list[tuple[str, pd.DataFrame]]:
    """List the instances of a sensor in their order, each with its name for findings."""
    found: list[tuple[str, pd.DataFrame]] = []
    for name in names:
        if name not in messages:
            continue
        frame = some_fields(messages, name, fields)
        column = instance_column(frame)
        if column is None:
            if len(frame):
                found.append((name, frame))
            continue
        logged = frame[column].to_numpy()
        if len(logged) and logged.dtype.kind in "iu" and (logged == logged[0]).all():
            found.append((f"{name}[{int(logged[0])}]", frame))
            continue
        values = numbers(frame, column)
        for value in np.unique(values[np.isfinite(values)]):
            mine = values == value
            part = frame if mine.all() else frame[mine]
            part.attrs = frame.attrs
            found.append((f"{name}[{int(value)}]", part))
    return found


def instance_column(frame: pd.DataFrame) -> str | None:
    """Return the name of the column that counts the instances of a sensor; None where the message has none."""
    return next((column for column in INSTANCE_NAMES if column in frame), None)


def pick(
    candidates: list[tuple[str, pd.DataFrame]], key: str, preferred: int = 0
) -> tuple[pd.DataFrame | None, tuple[pd.DataFrame, ...]]:
    """Pick the first healthy instance of a sensor and keep the others that measured anything.

    An instance is healthy when column `key` has at least half as many values as that of the best instance.
    """
    tables = [table for _, table in candidates]
    counts = [int(table[key].notna().sum()) for table in tables]
    best = max(counts, default=0)
    if best == 0:
        return None, ()
    order = sorted(range(len(tables)), key=lambda k: (k != preferred, k))
    chosen = next(k for k in order if counts[k] >= 0.5 * best)
    return tables[chosen], tuple(tables[k] for k in range(len(tables)) if k != chosen and counts[k] > 0)
