"""When the craft was in the air."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pandas as pd

from logparse.tables import Tables
from logparse.vehicle import pwm_range

Array = npt.NDArray[np.float64]

#: Share of the PWM range by which the motors' mean must exceed the idle level: hovering takes at least 0.1.
_ABOVE_IDLE = 0.03
#: Pauses [s] in which the motors may fall to idle within one flight (dropping with closed throttle).
_PAUSE = 5.0
#: Gap [s] in the data that ends a flight, and the same in sample intervals for slow telemetry.
_GAP, _GAP_SAMPLES = 5.0, 20.0
#: Height [m] that makes a flight; pressure under the propellers feigns up to about a metre on the ground.
_RISE = 1.5
#: Height [m] at which the craft has left the ground, or is back on it.
_LIFT = 0.3
#: Movement [m] that makes a flight where no height is logged, and shortest flight [s].
_MOVEMENT, _SHORTEST = 8.0, 3.0


@dataclass(frozen=True, slots=True)
class Flight:
    """One airborne interval, seconds on the boot clock."""

    start: float
    stop: float

    @property
    def duration(self) -> float:
        """Length [s]."""
        return self.stop - self.start


def find_flights(tables: Tables) -> tuple[Flight, ...]:
    """Find the airborne intervals of a log, in order.

    Motors above their idle level (MOT_SPIN_MIN or THR_MIN over the vehicle's PWM range) make a candidate; it counts
    when the craft also rose or moved. The interval is trimmed to the time off the ground where the height tells.
    Without motor outputs the height decides while the autopilot was armed. Flights are separated by landings and by
    gaps in the log; a log that starts or ends in the air has a flight that does.

    Parameters
    ----------
    tables : Tables

    Returns
    -------
    tuple of Flight
        Empty for a bench log.
    """
    height = _height(tables)
    if tables.motors is not None and len(tables.motors) > 1:
        candidates = _powered(tables.motors, tables.parameters)
    elif height is not None:
        candidates = _risen(height, tables)
    else:
        candidates = []
    flights = []
    for start, stop in candidates:
        if stop - start < _SHORTEST or not _flew(start, stop, height, tables):
            continue
        flight = Flight(start, stop) if height is None else _trimmed(start, stop, height)
        if flight.duration >= _SHORTEST:
            flights.append(flight)
    return tuple(flights)


def idle_level(parameters: Mapping[str, float]) -> float:
    """PWM [us] of motors that idle on the ground, armed: the higher of MOT_SPIN_ARM and MOT_SPIN_MIN."""
    levels = pwm_range(parameters)
    return levels.pwm(max(levels.spin_arm, levels.spin_min))


def _powered(motors: pd.DataFrame, parameters: Mapping[str, float]) -> list[tuple[float, float]]:
    """Intervals in which the motors on average run above idle."""
    levels = pwm_range(parameters)
    threshold = idle_level(parameters) + _ABOVE_IDLE * (levels.pwm_max - levels.pwm_min)
    t = motors.index.to_numpy()
    values = motors.to_numpy()
    count = np.isfinite(values).sum(axis=1)
    mean = np.divide(np.nansum(values, axis=1), count, out=np.zeros(len(t)), where=count > 0)
    return _intervals(t, mean > threshold)


def _intervals(t: Array, on: npt.NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Intervals of consecutive times with `on`, short pauses bridged, cut at gaps in the data."""
    gap = max(_GAP, _GAP_SAMPLES * float(np.median(np.diff(t))))
    result: list[tuple[float, float]] = []
    times = t[on]
    if not len(times):
        return result
    # A pause in which samples went on may be bridged; a gap without samples may not.
    cuts = np.flatnonzero(np.diff(t) > gap)
    section = np.searchsorted(cuts, np.flatnonzero(on), side="left")
    start = previous = float(times[0])
    for k in range(1, len(times)):
        now = float(times[k])
        if now - previous > max(_PAUSE, gap) or section[k] != section[k - 1]:
            result.append((start, previous))
            start = now
        previous = now
    result.append((start, previous))
    return result


def _height(tables: Tables) -> "pd.Series[float] | None":
    """Height above some ground [m, up], from the autopilot's estimate, the barometer or GPS, whichever varies."""
    for table, name, sign in ((tables.ekf, "p_d", -1.0), (tables.baro, "alt", 1.0), (tables.gps, "alt", 1.0)):
        if table is None:
            continue
        height = (sign * table[name]).dropna()
        if len(height) > 5 and float(height.max() - height.min()) > 0.0:
            return height
    return None


def _risen(height: "pd.Series[float]", tables: Tables) -> list[tuple[float, float]]:
    """Intervals in which the craft was above its lowest point while armed (or always, where arming is not logged)."""
    t, values = height.index.to_numpy(), height.to_numpy()
    armed = np.ones(len(t), dtype=bool)
    if tables.events is not None:
        switches = tables.events[tables.events["event"].isin(["ARMED", "DISARMED"])]
        if len(switches):
            position = np.searchsorted(switches.index.to_numpy(), t, side="right") - 1
            state = (switches["event"] == "ARMED").to_numpy()
            # Before its first switch the craft was in the other state.
            armed = np.where(position >= 0, state[position.clip(0)], ~state[0])
    if not armed.any():
        return []
    ground = float(np.percentile(values[armed], 2.0))
    return _intervals(t, armed & (values > ground + _RISE))


def _flew(start: float, stop: float, height: "pd.Series[float] | None", tables: Tables) -> bool:
    """Whether the craft rose or moved far enough while its motors ran."""
    if height is not None:
        inside = height.loc[start:stop]
        if len(inside) > 1 and float(inside.max() - inside.min()) > _RISE:
            return True
    if tables.gps is not None:
        fixes = tables.gps.loc[start:stop]
        fixes = fixes[(fixes["fix"] >= 3.0) & fixes["lat"].notna()]
        if len(fixes) > 1:
            radius = 6.37e6
            north = radius * float(fixes["lat"].max() - fixes["lat"].min())
            east = radius * float(fixes["lon"].max() - fixes["lon"].min()) * float(np.cos(fixes["lat"].iloc[0]))
            return north > _MOVEMENT or east > _MOVEMENT
    if height is None and tables.motors is not None:
        # Nothing but motors: a craft in the air is steered all the time, one on a stand gets a few commands.
        values = tables.motors.loc[start:stop].to_numpy()
        return bool(np.nanmean(np.nanstd(values, axis=0)) > 5.0)
    return False


def _trimmed(start: float, stop: float, height: "pd.Series[float]") -> Flight:
    """Cut the time on the ground off both ends of a powered interval.

    The ground is the height just before the motors ran up, and just after they ran down. Where the log does not
    show the ground (it starts or ends in the air) the interval is kept.
    """
    inside = height.loc[start:stop]
    before = height.loc[start - 3.0 : start]
    after = height.loc[stop : stop + 3.0]
    if len(inside) < 3:
        return Flight(start, stop)
    if len(before) > 1:
        up = inside[inside > float(before.median()) + _LIFT]
        if len(up):
            start = max(start, float(up.index[0]))
    if len(after) > 1:
        up = inside[inside > float(after.median()) + _LIFT]
        if len(up):
            stop = min(stop, float(up.index[-1]))
    return Flight(start, stop)
