"""When the craft was in the air."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pandas as pd

from logparse.craft.pwm_range import pwm_range
from logparse.tables import Tables

Array = npt.NDArray[np.float64]

#: Share of the PWM range by which the motors' mean must exceed the idle level: hovering takes at least 0.1.
_ABOVE_IDLE = 0.03
#: Pauses [s] in which the motors may fall to idle within one flight (dropping with closed throttle).
_PAUSE = 5.0
#: Gap [s] in the data that ends a flight, the same in sample intervals for slow telemetry, and at most: where a clock
#: claims years between rows, they are no flight of years.
_GAP, _GAP_SAMPLES, LONGEST_GAP = 5.0, 20.0, 60.0
#: Height [m] that makes a flight; pressure under the propellers feigns up to about a metre on the ground. A lower
#: hover counts when the craft also moved about its axes: root mean square angular rate [rad/s].
_RISE, _HOP, _TURNING = 1.5, 0.5, 0.05
#: Height [m] at which the craft has left the ground, or is back on it.
_LIFT = 0.3
#: Time beside a flight in which the ground is looked for, s.
_BESIDE = 3.0
#: Height [m] that no barometer drifts on the ground: who rose that far flew, whatever an accelerometer says.
_SURE_RISE = 5.0
#: Steps [s] in which outputs and specific force are compared, over how many of them their course is taken off, and the
#: fewest of them. Outputs must change by more than the first part of themselves, and the force by less than the second
#: part of that: in the air, where motors alone carry, the two change alike (0.6 to 2 on 60 flights, 0.3 on the ground).
_STEP, _COURSE, _FEWEST_STEPS = 0.5, 9, 6
_DRIVEN, _STILL = 0.1, 0.35
#: Horizontal movement [m] with a speed [m/s] that makes a flight at constant height, and shortest flight [s].
_MOVEMENT, _SPEED, _SHORTEST = 8.0, 2.5, 3.0
#: Median disagreement [m] with the barometer at which the autopilot's height does not count.
_DISAGREEMENT = 3.0


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
    when the craft also rose or moved, and the force on it changed with the motors'. The interval is trimmed to the time
    off the ground where the height tells.
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
    height = height_above_ground(tables)
    if tables.motors is not None and len(tables.motors) > 1:
        candidates = _powered(tables.motors, tables.parameters)
    elif height is not None:
        candidates = _risen(height, tables)
    else:
        candidates = []
    flights = []
    for start, stop in candidates:
        if stop - start < _SHORTEST or not _flew(start, stop, height, tables) or held(start, stop, height, tables):
            continue
        flight = Flight(start, stop) if height is None else _trimmed(start, stop, height, tables)
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
    gap = min(max(_GAP, _GAP_SAMPLES * float(np.median(np.diff(t)))), LONGEST_GAP)
    times = t[on]
    if not len(times):
        return []
    # A pause in which samples went on may be bridged; a gap without samples may not.
    cuts = np.flatnonzero(np.diff(t) > gap)
    section = np.searchsorted(cuts, np.flatnonzero(on), side="left")
    ends = np.flatnonzero((np.diff(times) > max(_PAUSE, gap)) | (np.diff(section) != 0))
    first, last = np.append(0, ends + 1), np.append(ends, len(times) - 1)
    return list(zip(times[first].tolist(), times[last].tolist(), strict=True))


def height_above_ground(tables: Tables) -> "pd.Series[float] | None":
    """Return the height above some ground [m, up]: the autopilot's estimate, the barometer or GPS.

    The estimate is smoother than the barometer, which feels the propellers, but can run away with a bad GPS.
    """
    heights = []
    for table, name, sign in ((tables.ekf, "p_d", -1.0), (tables.baro, "alt", 1.0), (tables.gps, "alt", 1.0)):
        height = None if table is None else (sign * table[name]).dropna()
        varies = height is not None and len(height) > 5 and float(height.max() - height.min()) > 0.0
        heights.append(height if varies else None)
    estimate, barometer, fixes = heights
    if estimate is not None and barometer is not None:
        # A filter that started in flight does not show the take-off.
        nearest = np.searchsorted(estimate.index, barometer.index).clip(0, len(estimate) - 1)
        covered = np.abs(estimate.index.to_numpy()[nearest] - barometer.index.to_numpy()) < 2.0
        if float(covered.mean()) < 0.95:
            return barometer
        difference = estimate.to_numpy() - np.interp(estimate.index, barometer.index, barometer)
        if float(np.median(np.abs(difference - np.median(difference)))) > _DISAGREEMENT:
            return barometer
    return next((height for height in (estimate, barometer, fixes) if height is not None), None)


def speed_down(tables: Tables) -> "pd.Series[float] | None":
    """Return the autopilot's speed down [m/s]; None without one, or where its height runs away from the barometer's."""
    if tables.ekf is None:
        return None
    speed, height = tables.ekf["v_d"].dropna(), height_above_ground(tables)
    if len(speed) < 3 or height is None or not (speed != 0.0).any():
        return None
    if tables.baro is not None and height.index.equals(tables.baro["alt"].dropna().index):
        return None
    return speed


def slope_down(height: "pd.Series[float] | None") -> "pd.Series[float] | None":
    """Return the speed down [m/s] that a height [m, up] shows over a second around each of its times; None without one.

    The slope of a line through the samples of the second; NaN where there are fewer than three.
    """
    if height is None or len(height) < 3:
        return None
    t, values = height.index.to_numpy(np.float64), height.to_numpy(np.float64)
    first, last = np.searchsorted(t, t - 0.5), np.searchsorted(t, t + 0.5, side="right")
    # Sums over a window are differences of running sums; t and height from their means, for the sums' precision.
    t, values = t - t.mean(), values - values.mean()
    n, sum_t, sum_y, sum_tt, sum_ty = (
        (total := np.concatenate(([0.0], np.cumsum(each))))[last] - total[first]
        for each in (np.ones(len(t)), t, values, t * t, t * values)
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = (n * sum_ty - sum_t * sum_y) / (n * sum_tt - sum_t**2)
    return pd.Series(np.where(n >= 3.0, -slope, np.nan), index=height.index)


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
    inside = None if height is None else height.loc[start:stop]
    if inside is not None and len(inside) > 1:
        rise = float(inside.max() - inside.min())
        if rise > _RISE or (rise > _HOP and _turning(start, stop, tables) > _TURNING):
            return True
    if tables.gps is not None:
        fixes = tables.gps.loc[start:stop]
        fixes = fixes[(fixes["fix"] >= 3.0) & fixes["lat"].notna() & ~(fixes["hdop"] > 3.0)]
        speed = np.hypot(fixes["v_n"].to_numpy(), fixes["v_e"].to_numpy())
        speed = speed[np.isfinite(speed)]
        if len(speed) > 1 and float(np.quantile(speed, 0.9)) > _SPEED:
            radius = 6.37e6
            north = radius * float(fixes["lat"].max() - fixes["lat"].min())
            east = radius * float(fixes["lon"].max() - fixes["lon"].min()) * float(np.cos(fixes["lat"].iloc[0]))
            return north > _MOVEMENT or east > _MOVEMENT
    if inside is None and tables.gps is None:
        return _turning(start, stop, tables) > _TURNING
    return False


def held(start: float, stop: float, height: "pd.Series[float] | None", tables: Tables) -> bool:
    """Return whether motors were driven hard while the specific force hardly changed: on the ground, or on a stand.

    Parameters
    ----------
    start, stop : float
        The stretch of time, s.
    height : Series or None
        Height, m, indexed by t, s; None where nothing tells.
    tables : Tables
        Motors, IMU and parameters of the log.
    """
    inside = None if height is None else height.loc[start:stop]
    if inside is not None and len(inside) > 1 and float(inside.max() - inside.min()) > _SURE_RISE:
        return False
    if tables.motors is None or tables.imu is None or "accel_x" not in tables.imu:
        return False
    outputs = tables.motors.loc[start:stop].dropna()
    force = tables.imu.loc[start:stop, ["accel_x", "accel_y", "accel_z"]].dropna()
    if len(outputs) < _FEWEST_STEPS or len(force) < _FEWEST_STEPS:
        return False
    levels = pwm_range(tables.parameters)
    above = np.clip((outputs.to_numpy(np.float64) - levels.pwm_min) / (levels.pwm_max - levels.pwm_min), 0.0, 1.0)
    times = outputs.index.to_numpy(np.float64), force.index.to_numpy(np.float64)
    grid = np.arange(max(times[0][0], times[1][0]), min(times[0][-1], times[1][-1]), _STEP)
    if len(grid) <= _FEWEST_STEPS:
        return False
    values = above.mean(axis=1), np.linalg.norm(force.to_numpy(np.float64), axis=1)
    driven, followed = (_swing(t, each, grid) for t, each in zip(times, values, strict=True))
    # A force that never changes at all is that of a sensor that has stopped, and shows nothing.
    return driven > _DRIVEN and 1e-6 < followed < _STILL * driven


def _swing(t: Array, values: Array, grid: Array) -> float:
    """Return by what part of itself a signal changes from step to step of a grid, its slow course taken off."""
    integral = np.concatenate(([0.0], np.cumsum(0.5 * np.diff(t) * (values[1:] + values[:-1]))))
    steps = np.diff(np.interp(grid, t, integral)) / _STEP
    usual = abs(float(np.median(steps)))
    padded = np.pad(steps, _COURSE // 2, mode="edge")
    course = np.convolve(padded, np.full(_COURSE, 1.0 / _COURSE), "valid")
    return float(np.std(steps - course)) / usual if usual > 0.0 else 0.0


def _turning(start: float, stop: float, tables: Tables) -> float:
    """Root mean square of the angular rate [rad/s] about its mean; 0 where no gyro is logged."""
    if tables.imu is None:
        return 0.0
    rates = tables.imu.loc[start:stop, ["gyro_x", "gyro_y", "gyro_z"]]
    return float(np.sqrt((rates.var(ddof=0)).sum())) if len(rates) > 1 else 0.0


def _trimmed(start: float, stop: float, height: "pd.Series[float]", tables: Tables) -> Flight:
    """Cut the time on the ground off both ends of a powered interval.

    The ground is the height just before the motors ran up, and just after they ran down or, where the log ends with
    disarming, at that moment. Where the log does not show the ground (it starts or ends in the air) the interval is
    kept: messages that come a moment before the first output, or after the last, are as high as the craft.
    """
    inside = height.loc[start:stop]
    if len(inside) < 3:
        return Flight(start, stop)
    before, after = height.loc[start - _BESIDE : start], height.loc[stop : stop + _BESIDE]
    if tables.motors is not None:
        outputs = tables.motors.index
        before = before if len(outputs[(outputs >= start - _BESIDE) & (outputs < start)]) else before.iloc[:0]
        after = after if len(outputs[(outputs > stop) & (outputs <= stop + _BESIDE)]) else after.iloc[:0]
    if len(after) < 2 and _landed_at(stop, tables.events):
        after = inside.iloc[-5:]
    for ground, first in ((before, True), (after, False)):
        if len(ground) < 2:
            continue
        up = inside[inside > float(ground.median()) + _LIFT]
        if len(up) and first:
            start = max(start, float(up.index[0]))
        elif len(up):
            stop = min(stop, float(up.index[-1]))
    return Flight(start, stop)


def _landed_at(time: float, events: pd.DataFrame | None) -> bool:
    """Whether the autopilot said within two seconds that it is on the ground."""
    if events is None:
        return False
    near = events.loc[time - 2.0 : time + 2.0, "event"]
    return bool(near.isin(["LAND_COMPLETE", "LAND_COMPLETE_MAYBE", "DISARMED"]).any())
