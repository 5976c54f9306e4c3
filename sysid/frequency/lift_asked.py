"""What asked for lift from outside the loop: the pilot's throttle stick, or the target of the height.

The acceleration target and the throttle that the height controller puts out answer the wind as well: as instruments
they made the gain of a firmware craft in 5 m/s of wind twice too large. ``CTUN.ThI`` is such an output since firmware
3.4, ``ThrIn`` before was the stick.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from core.units import quantity
from logparse import FlightLog
from sysid.frequency.axes import HEIGHT_TARGET, PILOTS_THROTTLE, FrequencyError
from sysid.frequency.response import Floats

#: Standard deviation of the stick [1] and of the rate of climb asked [m/s] or height asked [m] below which nothing was.
_STICK, _CLIMB, _HEIGHT = 0.01, 0.05, 0.2

#: Standard deviation of the stick from which on it is what asks, whatever else moves.
_FLOWN_BY_HAND = 0.03

#: Fewest rows.
_FEWEST = 16


def lift_asked(log: FlightLog, start: float, stop: float) -> tuple[Floats, Floats, str]:
    """Return times, values and name of what asked for lift from start to stop [s], positive upwards."""
    known = []
    for t, values, name, least in (*_sticks(log), *_heights(log)):
        finite = np.isfinite(values)
        inside = finite & (t >= start) & (t <= stop)
        if np.count_nonzero(inside) < _FEWEST:
            continue
        moved = float(np.std(values[inside]))
        if moved > least:
            known.append((moved > _FLOWN_BY_HAND or name == HEIGHT_TARGET, t[finite], values[finite], name))
    if not known:
        raise FrequencyError(
            f"{log.path.name}: the pilot's throttle hardly moved, nor did the target of the height; climb and sink by "
            "short movements of the throttle for a minute"
        )
    _, t, values, name = next((each for each in known if each[0]), known[0])
    return t, values, name


def _sticks(log: FlightLog) -> Iterator[tuple[Floats, Floats, str, float]]:
    channel = int(log.parameters_flown.get("RCMAP_THROTTLE", 3.0))
    if "RCIN" in log.messages:
        frame = log.messages["RCIN"]
        column = next((name for name in (f"C{channel}", f"Ch{channel}", f"Chan{channel}") if name in frame), None)
        if column is not None:
            yield frame.index.to_numpy(np.float64), 1e-3 * frame[column].to_numpy(np.float64), PILOTS_THROTTLE, _STICK
    if "CTUN" in log.messages and "ThrIn" in log.messages["CTUN"]:
        frame = log.messages["CTUN"]
        values = quantity(frame, "ThrIn", "")
        span = max(float(np.nanmax(np.abs(values), initial=0.0)), 1e-9)
        yield frame.index.to_numpy(np.float64), values / span, PILOTS_THROTTLE, _STICK


def _heights(log: FlightLog) -> Iterator[tuple[Floats, Floats, str, float]]:
    table = log.tables.setpoints
    if table is None:
        return
    for column, least in (("v_d_ref", _CLIMB), ("p_d", _HEIGHT)):
        if column in table:
            t, values = table.index.to_numpy(np.float64), -table[column].to_numpy(np.float64)
            yield t, values, HEIGHT_TARGET, least
