"""Height above the ground that a flight left, by every source: readings that anyone can check in a viewer.

The barometer is believed before the autopilot's estimate, which runs away with vibration or without GPS, and before
the receiver, whose height wanders by metres; but none that stays in the air when the craft is back where it took off.
Where the autopilot takes its height from a camera or motion capture, its own is believed first: propellers feign metres
to a barometer indoors.
"""

from collections.abc import Iterator, Mapping
from typing import Protocol

import numpy as np
import pandas as pd

from core.runs import runs
from core.units import EARTH_RADIUS
from logparse.tables import Tables

#: Heights by source, as `heights` yields them.
_Heights = Mapping[str, "pd.Series[float]"]


class _Interval(Protocol):
    """A time span, s."""

    @property
    def start(self) -> float: ...

    @property
    def stop(self) -> float: ...


#: Sources of height in the order of belief, with the column and the sign of up.
_SOURCES = {"baro": ("baro", "alt", 1.0), "autopilot": ("ekf", "p_d", -1.0), "gps": ("gps", "alt", 1.0)}
#: Parameters of PX4 and ArduPilot, and their values, by which height comes from a camera or motion capture.
_SEEN = {"EKF2_HGT_REF": 3.0, "EKF2_HGT_MODE": 3.0, "EK3_SRC1_POSZ": 6.0}
#: A craft that lands so near [m] to where it took off is back at the same height; a height so far off it [m] is wrong.
_SAME_PLACE, WRONG = 20.0, 5.0
#: Time [s] for which a barometer repeats one value when it has stopped: 0.4 at most in all flights that were looked at.
_STOPPED = 5.0
#: Window of the median of a height, and time before lift-off in which the ground is read [s].
_MEDIAN, _GROUND = 0.5, 2.0


def heights(tables: Tables) -> Iterator[tuple[str, "pd.Series[float]"]]:
    """Yield the heights [m, up] of a log by source (baro, autopilot, gps), the most credible first."""
    seen = any(tables.parameters.get(name) == value for name, value in _SEEN.items())
    for source in sorted(_SOURCES, key=lambda source: source != "autopilot") if seen else _SOURCES:
        table, column, sign = _SOURCES[source]
        frame = getattr(tables, table)
        if frame is None:
            continue
        height = sign * frame[column]
        if source == "gps":
            height = height[frame["fix"] >= 3.0]
        height = height.dropna()
        # A sensor that never moves has stopped, and one row is damage.
        if len(height) > 5 and float(np.ptp(smoothed(height))) > 0.0:
            yield source, height


def not_returned(known: _Heights, gps: pd.DataFrame | None, flight: "_Interval") -> dict[str, float]:
    """Return how far above the ground [m] sources of height stayed where others came back with a craft that did."""
    if gps is None:
        return {}
    fixes = gps.loc[gps["fix"] >= 3.0, ["lat", "lon"]]
    ends = [fixes.loc[start:stop].median() for start, stop in _beside(flight)]
    north, east = (ends[1] - ends[0]) * [EARTH_RADIUS, EARTH_RADIUS * np.cos(ends[0]["lat"])]
    if not np.hypot(north, east) < _SAME_PLACE:
        return {}
    left = {}
    for source, height in known.items():
        before, after = (_level(height.loc[start:stop]) for start, stop in _beside(flight))
        if before is not None and after is not None:
            left[source] = after - before
    stayed = {source: above for source, above in left.items() if abs(above) > WRONG}
    return stayed if len(stayed) < len(left) else {}


def barometer_stopped(known: _Heights, flight: "_Interval") -> float | None:
    """Return since when [s] a barometer repeated one value in flight while another height changed; None if it did not.

    Pressure is never the same for seconds; where it was simulated without noise, nothing else changes either.
    """
    if "baro" not in known:
        return None
    own = known["baro"].loc[flight.start : flight.stop]
    spans = own.index.to_numpy(np.float64)[runs(np.diff(own.to_numpy(np.float64)) == 0.0)]
    first, last = max(spans.tolist(), key=lambda span: span[1] - span[0], default=(0.0, 0.0))
    if last - first <= _STOPPED:
        return None
    others = (height.loc[flight.start : flight.stop] for source, height in known.items() if source != "baro")
    moved = [float(np.ptp(part)) for height in others if len(part := smoothed(height).loc[first:last])]
    return first if max(moved, default=0.0) > WRONG else None


def _beside(flight: "_Interval") -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the seconds on the ground before a flight and after it."""
    return (flight.start - _GROUND, flight.start), (flight.stop, flight.stop + _GROUND)


def _level(near: "pd.Series[float]") -> float | None:
    """Return the height of the ground; None where the log shows too little of it, as one that begins at lift-off."""
    return float(near.median()) if len(near) > 1 and near.index[-1] - near.index[0] > 0.5 * _GROUND else None


def ground_level(height: "pd.Series[float]", flight: "_Interval") -> float | None:
    """Return the height of the ground that a flight left, or of that where it ended; None where the log has neither."""
    levels = (_level(height.loc[start:stop]) for start, stop in _beside(flight))
    return next((level for level in levels if level is not None), None)


def above_ground(height: "pd.Series[float]", flight: "_Interval") -> "pd.Series[float]":
    """Return a height above the ground beside a flight, or above its lowest where the log shows no ground."""
    ground = ground_level(height, flight)
    return height - (float(height.loc[flight.start : flight.stop].min()) if ground is None else ground)


def smoothed(height: "pd.Series[float]") -> "pd.Series[float]":
    """Return the running median of a height over half a second."""
    if len(height) < 3:
        return height
    usual = float(np.median(np.diff(height.index.to_numpy(np.float64))))
    size = 2 * round(0.5 * _MEDIAN / usual) + 1 if usual > 0.0 else 1
    half = size // 2
    padded = pd.Series(np.pad(height.to_numpy(np.float64), half, mode="edge")).rolling(size, center=True).median()
    return pd.Series(padded.to_numpy()[half : half + len(height)], index=height.index)


def slope_down(height: "pd.Series[float]") -> "pd.Series[float]":
    """Return the speed down [m/s] that a height [m, up] shows, by lines through the second around each of its times."""
    t, values = height.index.to_numpy(np.float64), height.to_numpy(np.float64)
    # A second, or the three samples that a line takes.
    half = max(0.5, 1.1 * float(np.median(np.diff(t)))) if len(t) > 1 else 0.5
    first, last = np.searchsorted(t, t - half), np.searchsorted(t, t + half, side="right")
    # Sums over a window are differences of running sums; t and height from their means, for the sums' precision.
    t, values = t - t.mean(), values - values.mean()
    n, sum_t, sum_y, sum_tt, sum_ty = (
        (total := np.concatenate(([0.0], np.cumsum(each))))[last] - total[first]
        for each in (np.ones(len(t)), t, values, t * t, t * values)
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = (n * sum_ty - sum_t * sum_y) / (n * sum_tt - sum_t**2)
    return pd.Series(np.where(n >= 3.0, -slope, np.nan), index=height.index)
