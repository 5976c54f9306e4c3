"""When the craft was in the air: the ground carries none of its weight.

Specific force is what ground and air do to the craft for each kilogram. On the ground it is gravity whatever the motors
do; in the air it is what the motors give: in hover, climb and flips, and in a fall, where both are nothing. With thrust
and specific force as parts of what they are while the height shows the craft in the air, the share of the weight that
the ground carries is

    support = specific force - thrust,

0 in the air and towards 1 on the ground. Height tells which runs of the motors are flights at all.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pandas as pd

from core.units import STANDARD_GRAVITY
from logparse.craft.pwm_range import pwm_range
from logparse.heights import height_above_ground, slope_down, smoothed
from logparse.tables import Tables

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

#: Share of the weight from which the ground carries the craft: it is 0.4 in spool-ups, 0.15 in gusts and dives.
_CARRIED = 0.3
#: Time [s] for which it must, as a collision in the air passes sooner, and how far [m] from the ground before or after
#: the flight: a fast descent and vibration feign support.
_STANDING, _NEAR = 1.0, 3.0
#: Part by which the mean specific force in the air may differ from gravity, beyond which vibration spoils it.
_CALIBRATED = 0.2
#: Time [s] after the motors stop by which the craft lies on the ground.
_FALLEN = 10.0
#: Height [m] that makes a flight, and height that does where forces agree: propellers feign a metre on the ground.
_RISE, _HOP = 1.5, 0.5
#: Height [m] that a barometer drifts on the ground within minutes, at most (3.9 m in ten minutes of 23-9-2014_52).
_DRIFT = 5.0
#: Change of the specific force for a change of thrust (0.5 to 1.4 in the air, 0 on a bench), how far thrust must vary
#: for its absence to tell, and the correlation that proves a hop.
_FOLLOWS, _VARIED, _CORRELATED = 0.2, 0.1, 0.5
#: Part of the thrust that is known to carry the craft from which a run of the motors is a flight.
_CARRIES = 0.85
#: Share of the PWM range by which motors must exceed idle: hovering takes at least 0.1.
_ABOVE_IDLE = 0.03
#: Pauses [s] in which the motors may idle within one run: dropping with closed throttle.
_PAUSE = 5.0
#: Gap [s] in the data that ends a flight, the same in sample intervals for slow telemetry, and at most: where a clock
#: claims years between rows, they are no flight of years.
_GAP, _GAP_SAMPLES, LONGEST_GAP = 5.0, 20.0, 60.0
#: Height [m] at which a barometer shows that the craft has left the ground, and the time [s] that it takes to rise so far.
_LIFTED, _LIFTING = 0.3, 0.5
#: Time [s] before the motors run up in which the height is that of the ground.
_GROUND = 2.0
#: Time [s] over which the rate of descent is read.
_SINKING = 4.0
#: Rate of climb [m/s] below which a craft that is near the ground stands.
_CLIMBING = 0.2
#: Shortest flight, and least interval of readings [s].
_SHORTEST, _STEP = 2.0, 0.1


@dataclass(frozen=True, slots=True)
class Flight:
    """One airborne interval, seconds on the boot clock."""

    start: float
    stop: float

    @property
    def duration(self) -> float:
        """Length [s]."""
        return self.stop - self.start


@dataclass(frozen=True, slots=True)
class _Readings:
    """Thrust (relative), size of the specific force [m/s^2] and height [m, up] at common times; NaN where unknown."""

    t: Array
    thrust: Array
    force: Array
    height: Array

    def between(self, start: float, stop: float) -> "_Readings":
        part = slice(*np.searchsorted(self.t, (start, np.nextafter(stop, np.inf))))
        return _Readings(self.t[part], self.thrust[part], self.force[part], self.height[part])


@dataclass(frozen=True, slots=True)
class _Hover:
    """What a run of the motors shows: how far the craft rose [m], and thrust and specific force while it was up.

    `follows` is the change of the specific force for a change of thrust, both as parts of those, with its correlation
    and how much thrust varied.
    """

    rise: float
    thrust: float
    force: float
    follows: float
    correlation: float
    varied: float

    @property
    def flown(self) -> bool:
        """Whether the height alone makes it a flight: higher than propellers feign, and than a barometer drifts."""
        still = self.varied > _VARIED and self.follows < _FOLLOWS
        return self.rise > (_DRIFT if still else _RISE)

    def hopped(self, carries: float) -> bool:
        """Whether a low run is a flight: its thrust is known to carry the craft, or the forces move with it."""
        if self.rise < _HOP:
            return False
        if np.isfinite(carries):
            return self.thrust > _CARRIES * carries
        return self.correlation > _CORRELATED and self.follows > _FOLLOWS


def find_flights(tables: Tables) -> tuple[Flight, ...]:
    """Find the airborne intervals of a log, in order.

    Flights are separated by landings and by gaps in the log; a log that starts or ends in the air has a flight that
    does. After a crash the flight ends at the first contact after which the craft stays on the ground.

    Parameters
    ----------
    tables : Tables
        Of a multirotor: thrust carries it.

    Returns
    -------
    tuple of Flight
        Empty for a bench log.
    """
    height = height_above_ground(tables)
    if tables.motors is None or len(tables.motors) < 2:
        return () if height is None else tuple(_by_height(height, tables.events))
    readings = _readings(tables.motors, tables.imu, height, tables.parameters)
    levels = pwm_range(tables.parameters)
    idle = idle_level(tables.parameters) + _ABOVE_IDLE * (levels.pwm_max - levels.pwm_min)
    runs = _intervals(readings.t, readings.thrust > _thrust(np.array(idle), tables.parameters), _PAUSE)
    hovers = [_hover(readings, start, stop) for start, stop in runs]
    sure = [hover.thrust for hover in hovers if hover.flown]
    carries = float(np.median(sure)) if sure else np.nan
    flights = []
    for k, (run, hover) in enumerate(zip(runs, hovers, strict=True)):
        if hover.flown or hover.hopped(carries):
            first = runs[k - 1][1] + 1e-6 if k else readings.t[0]
            last = runs[k + 1][0] - 1e-6 if k + 1 < len(runs) else readings.t[-1]
            around = _airborne(readings.between(first, last), hover, run[1])
            flights += [each for each in around if each.start < run[1] and each.stop > run[0]]
    return tuple(flights)


def idle_level(parameters: Mapping[str, float]) -> float:
    """PWM [us] of motors that idle on the ground, armed: the higher of MOT_SPIN_ARM and MOT_SPIN_MIN."""
    levels = pwm_range(parameters)
    return levels.pwm(max(levels.spin_arm, levels.spin_min))


def _thrust(pwm: Array, parameters: Mapping[str, float]) -> Array:
    """Return the thrust of motors at pulses [us], as a part of that at full output."""
    levels = pwm_range(parameters)
    output = np.clip((pwm - levels.pwm_min) / (levels.pwm_max - levels.pwm_min), 0.0, 1.0)
    return (1.0 - levels.thrust_expo) * output + levels.thrust_expo * output**2


def _readings(
    motors: pd.DataFrame, imu: pd.DataFrame | None, height: "pd.Series[float] | None", parameters: Mapping[str, float]
) -> _Readings:
    """Read what tells of flight at the times of the motor outputs, at most ten a second."""
    times = motors.index.to_numpy(np.float64)
    outputs = motors.to_numpy(np.float64)
    known = np.isfinite(outputs).any(axis=1)
    times, outputs = times[known], outputs[known]
    t = times[np.flatnonzero(np.diff(np.floor(times / _STEP), prepend=-np.inf))]
    usual = float(np.median(np.diff(t))) if len(t) > 1 else _STEP
    half = max(0.25, 0.75 * usual)
    thrust = _means(times, np.nanmean(_thrust(outputs, parameters), axis=1), t, half)
    force = np.full(len(t), np.nan)
    if imu is not None and "accel_x" in imu:
        rows = imu[["accel_x", "accel_y", "accel_z"]].dropna()
        sampled = rows.index.to_numpy(np.float64)
        # The mean of the vector: the size of each sample would grow with vibration.
        axes = [_means(sampled, rows[name].to_numpy(np.float64), t, half) for name in rows]
        force = np.linalg.norm(axes, axis=0)
    risen = np.full(len(t), np.nan)
    if height is not None:
        smooth = smoothed(height)
        risen = np.interp(t, smooth.index.to_numpy(np.float64), smooth.to_numpy(np.float64))
    return _Readings(t, thrust, force, risen)


def _means(times: Array, values: Array, t: Array, half: float) -> Array:
    """Return the mean of the values within `half` [s] of each of the times t; NaN where there are none."""
    total = np.concatenate(([0.0], np.cumsum(values)))
    first, last = np.searchsorted(times, t - half), np.searchsorted(times, t + half, side="right")
    with np.errstate(invalid="ignore"):
        return np.asarray((total[last] - total[first]) / np.where(last > first, last - first, np.nan))


def _intervals(t: Array, on: Flags, pause: float) -> list[tuple[float, float]]:
    """Intervals of consecutive times with `on`, pauses of at most `pause` bridged, cut at gaps in the data."""
    if not on.any():
        return []
    gap = min(max(_GAP, _GAP_SAMPLES * float(np.median(np.diff(t)))) if len(t) > 1 else _GAP, LONGEST_GAP)
    # A pause in which samples went on may be bridged; a gap without samples may not.
    section = np.cumsum(np.diff(t, prepend=t[0]) > gap)[on]
    rows, times = np.flatnonzero(on), t[on]
    ends = np.flatnonzero(((np.diff(rows) > 1) & (np.diff(times) > pause)) | (np.diff(section) != 0))
    first, last = np.append(0, ends + 1), np.append(ends, len(times) - 1)
    return list(zip(times[first].tolist(), times[last].tolist(), strict=True))


def _hover(readings: _Readings, start: float, stop: float) -> _Hover:
    """Read thrust and specific force while the craft is up in a run of the motors."""
    run, ground = readings.between(start, stop), readings.between(start - _GROUND, start - 1e-6).height
    level = float(np.median(ground)) if len(ground) > 1 else float(run.height.min())
    rise = float(run.height.max()) - level
    up = run.height - level > min(0.5 * rise, _RISE) if np.isfinite(rise) else np.ones(len(run.t), np.bool_)
    if not up.any():
        return _Hover(0.0, np.nan, np.nan, np.nan, np.nan, 0.0)
    thrust, force = float(np.median(run.thrust[up])), float(np.nanmedian(run.force[up]))
    both = up & np.isfinite(run.force)
    x, y = run.thrust[both] / thrust, run.force[both] / force
    varied, moved = (float(each.std()) if len(each) > 10 else 0.0 for each in (x, y))
    common = float(np.mean((x - x.mean()) * (y - y.mean()))) if varied > 0.0 else 0.0
    correlation = common / (varied * moved) if varied > 0.0 and moved > 0.0 else 0.0
    return _Hover(rise, thrust, force, common / varied**2 if varied > 0.0 else 0.0, correlation, varied)


def _airborne(readings: _Readings, hover: _Hover, stopped: float) -> Iterator[Flight]:
    """Yield the flights among the readings around one run of the motors: where the ground does not carry the craft."""
    t, height = readings.t, readings.height
    force = readings.force / hover.force
    if not abs(hover.force / STANDARD_GRAVITY - 1.0) < _CALIBRATED:
        force = np.ones(len(t))
    support = np.nan_to_num(force, nan=1.0) - readings.thrust / hover.thrust
    end = min(t[-1], stopped + _FALLEN)
    levels = np.array([np.median(height[:20]), np.median(readings.between(end - _GROUND, end).height)])
    air = np.ones(len(t), np.bool_)
    for start, stop in _intervals(t, support > _CARRIED, 0.0):
        stretch = slice(*np.searchsorted(t, (start, np.nextafter(stop, np.inf))))
        edge = stretch.start == 0 or stretch.stop == len(t)
        at = np.median(height[stretch])
        near = at < levels.min() or (np.abs(at - levels) < _NEAR).any() or np.isnan(at)
        if (stop - start >= _STANDING or edge) and near:
            air[stretch] = False
    for start, stop in _intervals(t, air, 0.0):
        flight = _trimmed(readings, start, _touching(readings, air, stop))
        if flight is not None:
            yield flight


def _touching(readings: _Readings, air: Flags, stop: float) -> float:
    """Return when a craft that was last seen sinking has touched down, where rows are missing until it stands."""
    t, height = readings.t, readings.height
    after = int(np.searchsorted(t, stop, side="right"))
    sinking = np.flatnonzero(t[:after] > stop - _SINKING)
    if after == len(t) or air[after] or len(sinking) < 3:
        return stop
    rate = -float(np.polyfit(t[sinking] - stop, height[sinking], 1)[0])
    fall = float(height[after - 1] - height[after])
    return min(stop + fall / rate, float(t[after])) if rate > 0.0 and fall > 0.0 else stop


def _trimmed(readings: _Readings, start: float, stop: float) -> Flight | None:
    """Return a flight from where the height leaves the ground; None where it does not."""
    flown, before = readings.between(start, stop), readings.between(start - _GROUND, start - 1e-6).height
    ground = float(np.median(before)) if len(before) > 1 else float(flown.height.min())
    if float(flown.height.max()) - ground < _HOP or stop - start < _SHORTEST:
        return None
    for lifted, lost in _intervals(flown.t, flown.height > ground + _LIFTED, 0.0) if len(before) > 1 else ():
        # Propellers that run up feign a jump.
        if lost - lifted > _STANDING:
            low = flown.t[max(int(np.searchsorted(flown.t, lifted)) - 1, 0)]
            return Flight(max(start, float(low) - _LIFTING), stop)
    return Flight(start, stop)


def _by_height(height: "pd.Series[float]", events: pd.DataFrame | None) -> Iterator[Flight]:
    """Yield the flights that the height alone shows: above the lowest point while armed, or always without arming."""
    smooth = smoothed(height)
    t, values = smooth.index.to_numpy(np.float64), smooth.to_numpy(np.float64)
    armed = np.ones(len(t), np.bool_)
    switches = None if events is None else events[events["event"].isin(["ARMED", "DISARMED"])]
    if switches is not None and len(switches):
        position = np.searchsorted(switches.index.to_numpy(), t, side="right") - 1
        state = (switches["event"] == "ARMED").to_numpy()
        # Before its first switch the craft was in the other state.
        armed = np.where(position >= 0, state[position.clip(0)], ~state[0])
    if not armed.any():
        return
    ground = float(np.percentile(values[armed], 2.0))
    down = slope_down(smooth)
    still = t[np.abs(down.to_numpy()) < _CLIMBING] if down is not None else t[:0]
    for start, stop in _intervals(t, armed & (values > ground + _RISE), _PAUSE):
        before, after = still[still <= start], still[still >= stop]
        if stop - start >= _SHORTEST:
            start = float(before[-1]) if len(before) and start - before[-1] < _FALLEN else start
            stop = float(after[0]) if len(after) and after[0] - stop < _FALLEN else stop
            yield Flight(start, stop)
