"""Height above the ground that a flight left, and how fast the craft moved: readings that anyone can check in a viewer.

The barometer is believed before the autopilot's estimate, which runs away with vibration or without GPS, and before
the receiver, whose height wanders by metres.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
import pandas as pd
from numpy.lib.stride_tricks import sliding_window_view

from logparse.tables import Tables

if TYPE_CHECKING:
    from logparse.flights import Flight


class _Interval(Protocol):
    """A stretch of time, s."""

    @property
    def start(self) -> float: ...

    @property
    def stop(self) -> float: ...


#: Sources of height in the order of belief, with the column and the sign of up.
_SOURCES = {"baro": ("baro", "alt", 1.0), "autopilot": ("ekf", "p_d", -1.0), "gps": ("gps", "alt", 1.0)}
#: Window of the median of a height, and time before lift-off in which the ground is read [s].
_MEDIAN, _GROUND = 0.5, 2.0
#: Median disagreement [m] with the barometer at which the autopilot's speed down does not count.
_DISAGREEMENT = 3.0
#: Fixes that count: 3-D, dilution below, satellites at least; the acceleration [m/s^2] of a jump, and the time [s]
#: around one that does not count.
_FIX, _HDOP, _SATELLITES, _JUMP, _AROUND = 3.0, 4.0, 5.0, 12.0, 1.0


@dataclass(frozen=True, slots=True)
class HeightReadings:
    """Largest height of a flight above the ground it left [m]: the credible `value`, its source, and all sources'."""

    value: float
    source: str
    by_source: Mapping[str, float]


def heights(tables: Tables) -> Iterator[tuple[str, "pd.Series[float]"]]:
    """Yield the heights [m, up] of a log by source (baro, autopilot, gps), the most credible first."""
    for source, (table, column, sign) in _SOURCES.items():
        frame = getattr(tables, table)
        if frame is None:
            continue
        height = sign * frame[column]
        if source == "gps":
            height = height[frame["fix"] >= _FIX]
        height = height.dropna()
        # A sensor that never moves has stopped.
        if len(height) > 5 and float(np.ptp(height)) > 0.0:
            yield source, height


def height_above_ground(tables: Tables) -> "pd.Series[float] | None":
    """Return the credible height above some ground [m, up] of a log; None where nothing measures height."""
    return next((height for _, height in heights(tables)), None)


def height_readings(tables: Tables, flight: "Flight") -> HeightReadings | None:
    """Read the largest height of a flight by every source.

    Returns
    -------
    HeightReadings or None
        Each is the largest 0.5 s median above the median of the 2 s before lift-off, or above the landing point where
        the log begins in the air. None where no source saw the flight.
    """
    found = {}
    for source, height in heights(tables):
        flown = height.loc[flight.start : flight.stop]
        if len(flown):
            found[source] = float(smoothed(flown).max()) - ground_level(height, flight)
    return HeightReadings(next(iter(found.values())), next(iter(found)), found) if found else None


def ground_level(height: "pd.Series[float]", flight: "_Interval") -> float:
    """Return the height of the ground that a flight left, or of that where it ended, or the lowest of the flight."""
    for start, stop in ((flight.start - _GROUND, flight.start), (flight.stop, flight.stop + _GROUND)):
        near = height.loc[start:stop]
        if len(near) > 1:
            return float(near.median())
    return float(height.loc[flight.start : flight.stop].min())


def ground_speed(tables: Tables, flight: "Flight") -> float | None:
    """Return the largest horizontal speed [m/s] of a flight by GPS, a median of three good fixes; None without them.

    Fixes count with a 3-D position, a dilution below 4 and five satellites, and a second away from a jump of the speed.
    """
    if tables.gps is None:
        return None
    fixes = tables.gps.loc[flight.start : flight.stop]
    bad = (fixes["hdop"] >= _HDOP) | (fixes["satellites"] < _SATELLITES)
    fixes = fixes[(fixes["fix"] >= _FIX) & ~bad].dropna(subset=["v_n", "v_e"])
    velocity = fixes[["v_n", "v_e"]].to_numpy(np.float64)
    if len(velocity) < 3:
        return None
    t = fixes.index.to_numpy(np.float64)
    jumps = t[1:][np.linalg.norm(np.diff(velocity, axis=0), axis=1) > _JUMP * np.diff(t)]
    near = np.searchsorted(jumps, t + _AROUND) > np.searchsorted(jumps, t - _AROUND)
    speed = np.linalg.norm(velocity[~near], axis=1)
    return float(np.median(sliding_window_view(speed, 3), axis=1).max()) if len(speed) > 2 else None


def climb_and_sink(tables: Tables, flight: "Flight") -> tuple[float, float] | None:
    """Return the fastest climb and descent [m/s] of a flight, by the credible height over a second each."""
    height = height_above_ground(tables)
    flown = None if height is None else height.loc[flight.start : flight.stop]
    if flown is None or len(flown) < 3:
        return None
    down = slope_down(smoothed(flown))
    return max(-float(down.min()), 0.0), max(float(down.max()), 0.0)


def smoothed(height: "pd.Series[float]") -> "pd.Series[float]":
    """Return the running median of a height over half a second."""
    if len(height) < 3:
        return height
    usual = float(np.median(np.diff(height.index.to_numpy(np.float64))))
    size = 2 * round(0.5 * _MEDIAN / usual) + 1 if usual > 0.0 else 1
    half = size // 2
    padded = pd.Series(np.pad(height.to_numpy(np.float64), half, mode="edge")).rolling(size, center=True).median()
    return pd.Series(padded.to_numpy()[half : half + len(height)], index=height.index)


def speed_down(tables: Tables) -> "pd.Series[float] | None":
    """Return the autopilot's speed down [m/s]; None without one, or where its height leaves the barometer's."""
    found = dict(heights(tables))
    if tables.ekf is None or "autopilot" not in found:
        return None
    speed, height = tables.ekf["v_d"].dropna(), found["autopilot"]
    if "baro" in found:
        away = height.to_numpy() - np.interp(height.index, found["baro"].index, found["baro"])
        if float(np.median(np.abs(away - np.median(away)))) > _DISAGREEMENT:
            return None
    return speed if len(speed) > 2 and (speed != 0.0).any() else None


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
