"""Signals of a log by name, as people write them: ``ATT.Roll``, ``IMU[1].GyrX``, ``motors.m1``."""

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import pandas as pd

from core.errors import MissingDataError
from logparse.canonical.fields import instance_column
from logparse.source import INSTANCE_NAMES
from logparse.tables import COLUMNS

if TYPE_CHECKING:
    from logparse.log import FlightLog

_NAME = re.compile(r"(?P<message>\w+)(?:\[(?P<instance>\d+)\])?\.(?P<field>\w+)")
#: Names listed in an error.
_LISTED = 12


class SignalError(MissingDataError):
    """A name that the log has no signal for."""


@dataclass(frozen=True, slots=True, eq=False)
class LoggedSignal:
    """One field of a message, or one column of a canonical table, over time."""

    name: str  #: As asked for.
    unit: str  #: As logged; of canonical tables SI. Empty where unknown.
    #: shape (n,): s on the boot clock, and the value.
    t: npt.NDArray[np.float64]
    y: npt.NDArray[np.float64]


def logged_signal(log: "FlightLog", name: str) -> LoggedSignal:
    """Find a signal by its name."""
    match = _NAME.fullmatch(name.strip())
    if match is None:
        raise SignalError(f"{name!r} is no signal; write MESSAGE.Field, such as ATT.Roll, or table.column")
    message, field = match["message"], match["field"]
    canonical = message in COLUMNS
    frame = getattr(log.tables, message) if canonical else _decoded(log, message, field)
    if frame is None:
        have = ", ".join([*sorted(log.messages)[:_LISTED], "..."])
        raise SignalError(f"{log.path.name} has no {message}; it has {have} (rotorid inspect lists all)")
    if field not in frame:
        raise SignalError(f"{message} of {log.path.name} has no {field}; it has {', '.join(map(str, frame.columns))}")
    if not canonical:
        frame = _instance(log, frame, name, message, match["instance"])
    with np.errstate(invalid="ignore"):  # signalling NaNs of damaged rows
        values = pd.to_numeric(frame[field], errors="coerce").to_numpy(np.float64)
    if not np.isfinite(values).any():
        raise SignalError(f"{name} of {log.path.name} holds no numbers")
    unit = COLUMNS[message].get(field, "").partition(";")[0] if canonical else frame.attrs.get("units", {}).get(field)
    return LoggedSignal(name.strip(), str(unit or ""), frame.index.to_numpy(np.float64), values)


def _decoded(log: "FlightLog", message: str, field: str) -> pd.DataFrame | None:
    """Decode one field of a message and what tells its instances apart; all fields where there is no such one."""
    if message not in log.messages:
        return None
    wanted = {field, *INSTANCE_NAMES}
    frame = log.messages.once(message, wanted)
    own = frame.attrs.get("instance")  # it may have a name of its own, such as C for a core
    if own is not None and own not in frame:
        frame = log.messages.once(message, {*wanted, own})
    return frame if field in frame else log.messages.once(message)


def _instance(log: "FlightLog", frame: pd.DataFrame, name: str, message: str, wanted: str | None) -> pd.DataFrame:
    """Rows of one instance: that asked for, otherwise the first."""
    column = instance_column(frame) or frame.attrs.get("instance")
    if column is None:
        if wanted is not None:
            raise SignalError(f"{message} of {log.path.name} has no instances; leave [{wanted}] out of {name}")
        return frame
    numbers = pd.to_numeric(frame[column], errors="coerce")
    there = [int(value) for value in np.unique(numbers[np.isfinite(numbers)].to_numpy())]
    number = int(wanted) if wanted is not None else there[0] if there else 0
    if number not in there:
        raise SignalError(f"{message} of {log.path.name} has no instance {number}; it has {', '.join(map(str, there))}")
    if len(there) == 1:
        return frame
    part = frame[numbers == number]
    part.attrs = frame.attrs
    return part
