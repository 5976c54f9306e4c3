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

from core.runs import runs
from logparse.craft.pwm_range import pwm_range
from logparse.heights import heights, slope_down, smoothed
from logparse.tables import Tables

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

_FORCE = ("accel_x", "accel_y", "accel_z")
#: Share of the weight from which the ground carries the craft (0.4 in spool-ups, 0.15 in gusts and dives), and time [s]
#: for which it must: a collision in the air passes sooner.
_CARRIED, _STANDING = 0.3, 1.0
#: Height [m] that makes a flight, and height that does where thrust carries: propellers feign a metre on the ground.
_RISE, _HOP = 1.5, 0.5
#: Height [m] that a barometer drifts on the ground at most (3.9 m in ten minutes of 23-9-2014_52).
_DRIFT = 5.0
#: Change of the specific force for a change of thrust that shows free motion (0.5 to 1.4 in the air, 0 on a bench), and
#: how far thrust must vary for its absence to tell.
_FOLLOWS, _VARIED = 0.3, 0.1
#: Share of the PWM range by which motors must exceed idle: hovering takes at least 0.1.
_ABOVE_IDLE = 0.03
#: Pause [s] of motors (dropping with closed throttle) that a flight may have, and hole in the log [s]: one that begins
#: and ends in the air is flown through, if it is no clock that claims years.
_PAUSE, LONGEST_GAP = 5.0, 60.0
#: Height [m] at which a barometer shows that the craft has left the ground, and the time [s] that it takes to rise so.
_LIFTED, _LIFTING = 0.3, 0.5
#: Specific force [m/s^2] of a contact with the ground: 20 to 160 at hard landings and crashes.
_SHOCK = 25.0
#: Modes in which motors carry a QuadPlane, and time [s] for which they must not in others: descents pass sooner.
_ON_MOTORS, _WINGS = ("QSTABILIZE", "QHOVER", "QLOITER", "QLAND", "QAUTOTUNE", "QACRO"), 3.0
#: Time [s] beside a flight in which the height of the ground is read, and in which a rate of descent is.
_GROUND = 2.0
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
        """Return the readings from start to stop, both included."""
        part = slice(*np.searchsorted(self.t, (start - 1e-6, stop + 1e-6)))
        return _Readings(self.t[part], self.thrust[part], self.force[part], self.height[part])

    @property
    def level(self) -> float:
        """Median height; NaN for less than two readings."""
        return float(np.median(self.height)) if len(self.t) > 1 else np.nan


@dataclass(frozen=True, slots=True)
class _Run:
    """A run of the motors: the ground before it and how far it rose [m], thrust and specific force while it was up.

    `follows` is the change of the specific force for a change of thrust, both as parts of those; NaN where thrust
    hardly changes.
    """

    start: float
    stop: float
    ground: float
    rise: float
    thrust: float
    force: float
    follows: float

    @property
    def flown(self) -> bool:
        """Whether it rose higher than propellers feign, and than a barometer drifts while forces stand still."""
        return self.rise > (_DRIFT if self.follows < _FOLLOWS else _RISE)

    def hopped(self, carries: float) -> bool:
        """Whether a low run is a flight: its thrust is known to carry the craft, or else the forces follow it."""
        enough = self.follows > _FOLLOWS if np.isnan(carries) else self.thrust > (1.0 - 0.5 * _CARRIED) * carries
        return not self.rise < _HOP and enough


def find_flights(tables: Tables) -> tuple[Flight, ...]:
    """Find the airborne intervals of a log, in order.

    Flights are separated by landings and by gaps of more than a minute in the log; a log that starts or ends in the
    air has a flight that does. After a crash the flight ends at the first contact after which the craft stays on the
    ground.

    Returns
    -------
    tuple of Flight
        Empty for a bench log.
    """
    height, (thrust, idle) = next((height for _, height in heights(tables)), None), _thrust(tables)
    if thrust is None:
        return () if height is None else tuple(_by_height(height, tables.events))
    readings, shocks = _readings(tables, thrust, height)
    runs = [_run(readings, *each) for each in _intervals(readings.t, readings.thrust > idle, _PAUSE)]
    winged = tables.parameters.get("Q_ENABLE", 0.0) > 0.0
    by_height = tuple(_by_height(height, tables.events)) if winged and height is not None else ()
    if not runs and by_height:
        return by_height  # a QuadPlane that took off and landed on its wheels
    sure = [run.thrust for run in runs if run.flown]
    carries = float(np.median(sure)) if sure else np.nan
    flights = []
    for k, run in enumerate(runs):
        if run.flown or run.hopped(carries):
            first = runs[k - 1].stop + _STEP if k else readings.t[0]
            last = runs[k + 1].start - _STEP if k + 1 < len(runs) else readings.t[-1]
            around = _airborne(readings.between(first, last), run)
            flights += [
                _contact(readings, each, shocks) for each in around if each.start < run.stop and each.stop > run.start
            ]
    if flights and by_height and flights[0].start == readings.t[0]:
        # Motors that ran already may idle on the ground as high as in hover (uavlogviewer__vtol): the height tells.
        flights[0] = Flight(max(flights[0].start, by_height[0].start), flights[0].stop)
    return tuple(flights)


#: VEHICLE_VTOL_STATE_TRANSITION_TO_FW, _TRANSITION_TO_MC and _FW.
_PX4_ON_WINGS = (1, 2, 4)


def wing_borne(tables: Tables, motors: pd.DataFrame) -> list[tuple[float, float]]:
    """Return when wings carried a QuadPlane: what its motors gave upwards would not have kept it in the air."""
    height = next((height for _, height in heights(tables)), None)
    if height is None:
        return []
    tilting, levels = int(tables.parameters.get("Q_TILT_MASK", 0.0)), pwm_range(tables.parameters)
    upright = [not tilting >> (int(str(name)[1:]) - 1) & 1 for name in motors]
    pulses = motors.loc[:, upright if any(upright) else slice(None)].dropna(how="all")
    t = pulses.index.to_numpy(np.float64)
    thrust = np.nanmean(levels.thrust(pulses.to_numpy(np.float64)), axis=1)
    flown = np.zeros(len(t), np.bool_)
    for flight in _by_height(height, tables.events):
        flown |= (t >= flight.start) & (t <= flight.stop)
    on_motors = np.zeros(len(t), np.bool_)
    if tables.modes is not None and len(tables.modes):
        modes = np.append("", tables.modes["mode"].to_numpy(str))
        on_motors = np.isin(modes[np.searchsorted(tables.modes.index.to_numpy(), t, side="right")], _ON_MOTORS)
    running = flown & (thrust > levels.thrust(np.array(idle_level(tables.parameters))))
    carries = float(np.median(thrust[running])) if running.any() else np.inf
    weak = flown & ~on_motors & (thrust < (1.0 - _CARRIED) * carries)
    return [(start, stop) for start, stop in _intervals(t, weak, _GROUND) if stop - start > _WINGS]


def wing_borne_px4(status: pd.DataFrame | None) -> list[tuple[float, float]]:
    """Return when wings carried, or took over, a VTOL of PX4, by its topic vtol_vehicle_status."""
    if status is None or not len(status):
        return []
    if "vehicle_vtol_state" in status:
        wings = status["vehicle_vtol_state"].isin(_PX4_ON_WINGS).to_numpy()
    elif "vtol_in_rw_mode" in status:  # before 1.13
        wings = ~status["vtol_in_rw_mode"].to_numpy(np.bool_) | status["vtol_in_trans_mode"].to_numpy(np.bool_)
    else:
        return []
    t = status.index.to_numpy(np.float64)
    ends = np.append(t, np.inf)  # what was said last holds on
    return [(float(ends[first]), float(ends[last])) for first, last in runs(wings)]


def idle_level(parameters: Mapping[str, float]) -> float:
    """PWM [us] of motors that idle on the ground, armed: the higher of MOT_SPIN_ARM and MOT_SPIN_MIN."""
    levels = pwm_range(parameters)
    return levels.pwm(max(levels.spin_arm, levels.spin_min))


def _thrust(tables: Tables) -> tuple["pd.Series[float] | None", float]:
    """Return the thrust of all motors as a part of the most they have (the throttle without outputs), and idling's."""
    levels = pwm_range(tables.parameters)
    if tables.motors is not None:
        pulses = tables.motors.dropna(how="all")
        above = idle_level(tables.parameters) + _ABOVE_IDLE * (levels.pwm_max - levels.pwm_min)
        if tables.parameters.get("Q_ENABLE"):  # while wings carry it, as in hover: what motors carried is carried on
            pulses = tables.motors.fillna(tables.motors[tables.motors > above].median())
        means = np.nanmean(levels.thrust(pulses.to_numpy(np.float64)), axis=1)
        thrust, idle = pd.Series(means, index=pulses.index, dtype=np.float64), float(levels.thrust(np.array(above)))
    else:
        asked = tables.column("setpoints", "throttle")
        if asked is None or tables.parameters.get("Q_ENABLE"):  # a quadplane's pulls it forward
            return None, 0.0
        thrust, idle = asked.dropna(), _ABOVE_IDLE
    return (thrust, idle) if len(thrust) > 1 else (None, idle)


def _readings(
    tables: Tables, outputs: "pd.Series[float]", height: "pd.Series[float] | None"
) -> tuple[_Readings, Array]:
    """Read what tells of flight at the times of the motor outputs, at most ten a second, and the times of shocks."""
    times: Array = outputs.index.to_numpy(np.float64)
    t: Array = times[np.flatnonzero(np.diff(np.floor(times / _STEP), prepend=-np.inf))]
    usual = float(np.median(np.diff(t))) if len(t) > 1 else _STEP
    half = max(0.25, 0.75 * usual)
    thrust = _means(times, np.asarray(outputs, dtype=np.float64), t, half)
    force, shocks = _specific_force(tables, t, half)
    risen = np.full(len(t), np.nan)
    if height is not None:
        smooth = smoothed(height)
        risen = np.interp(t, smooth.index.to_numpy(np.float64), smooth.to_numpy(np.float64))
    return _Readings(t, thrust, force, risen), shocks


def _specific_force(tables: Tables, t: Array, half: float) -> tuple[Array, Array]:
    """Return the size of the mean specific force about each of the times t, and the times of shocks."""
    times: Array = np.zeros(0)
    squares, size = np.zeros(0), np.full(len(t), np.nan)
    for k, axis in enumerate(tables.columns("imu", _FORCE)):
        times, values = np.asarray(axis.index, dtype=np.float64), np.asarray(axis, dtype=np.float64)
        known = np.isfinite(values)
        # The mean of the vector: the size of each sample would grow with vibration.
        mean = _means(times[known], values[known], t, half)
        size, squares = (size + mean**2, squares + values**2) if k else (mean**2, values**2)
    return np.sqrt(size), times[squares > _SHOCK**2]


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
    section = np.cumsum(np.diff(t, prepend=t[0]) > LONGEST_GAP)[on]
    rows, times = np.flatnonzero(on), t[on]
    ends = np.flatnonzero(((np.diff(rows) > 1) & (np.diff(times) > pause)) | (np.diff(section) != 0))
    first, last = np.append(0, ends + 1), np.append(ends, len(times) - 1)
    return list(zip(times[first].tolist(), times[last].tolist(), strict=True))


def _run(readings: _Readings, start: float, stop: float) -> _Run:
    """Read what a run of the motors shows."""
    run, ground = readings.between(start, stop), readings.between(start - _GROUND, start - _STEP).level
    level = float(run.height.min()) if np.isnan(ground) else ground
    rise = float(run.height.max()) - level
    up = run.height - level >= min(0.5 * rise, _RISE) if rise > 0.0 else np.ones(len(run.t), np.bool_)
    thrust, known = float(np.median(run.thrust[up])), up & np.isfinite(run.force)
    if np.count_nonzero(known) < 10 or thrust == 0.0:
        return _Run(start, stop, ground, rise, thrust, np.nan, np.nan)
    force = float(np.median(run.force[known]))
    x, y = run.thrust[known] / thrust, run.force[known] / force
    varied = float(x.std())
    follows = float(np.mean((x - x.mean()) * y)) / varied**2 if varied > 0.0 else np.nan
    return _Run(start, stop, ground, rise, thrust, force, follows if varied > _VARIED or follows > _FOLLOWS else np.nan)


def _airborne(readings: _Readings, run: _Run) -> Iterator[Flight]:
    """Yield the flights among the readings around one run of the motors: where the ground does not carry the craft."""
    t, height = readings.t, readings.height
    # The ground carries no more than the weight: where the force exceeds it, that is a shock, or vibration.
    force = np.minimum(np.nan_to_num(readings.force / run.force, nan=1.0), 1.0)
    carried = force - readings.thrust / run.thrust > _CARRIED
    end = min(t[-1], run.stop + _PAUSE)
    landed = readings.between(end - _GROUND, end).level if end > run.stop else np.nan
    air = np.ones(len(t), np.bool_)
    for start, stop in _intervals(t, carried, 0.0):
        stretch = slice(*np.searchsorted(t, (start, stop + 1e-6)))
        # Fast descents and vibration feign support high above the ground.
        above = float(np.median(height[stretch])) - np.array([run.ground, landed])
        high = (above > 0.0).any() and not (np.abs(above) < _DRIFT).any()
        air[stretch] = high or (stop - start < _STANDING and stretch.stop < len(t))
    for start, stop in _intervals(t, air, 0.0):
        flight = _trimmed(readings, start, _touching(readings, air, stop))
        if flight is not None:
            yield flight


def _touching(readings: _Readings, air: Flags, stop: float) -> float:
    """Return when a craft that was last seen sinking has touched down, where rows are missing until it stands."""
    t, height = readings.t, readings.height
    after = int(np.searchsorted(t, stop, side="right"))
    first = min(int(np.searchsorted(t, stop - _GROUND)), after - 3)
    if after == len(t) or air[after] or first < 0:
        return stop
    rate = -float(np.polyfit(t[first:after] - stop, height[first:after], 1)[0])
    fall = float(height[after - 1] - height[after])
    return min(stop + fall / rate, float(t[after])) if rate > 0.0 and fall > 0.0 else stop


def _trimmed(readings: _Readings, start: float, stop: float) -> Flight | None:
    """Return a flight from where the height leaves the ground; None where it does not."""
    flown, before = readings.between(start, stop), readings.between(start - _GROUND, start - _STEP).level
    ground = float(flown.height.min()) if np.isnan(before) else before
    if float(flown.height.max()) - ground < _HOP or stop - start < _SHORTEST:
        return None
    if before == ground:
        for lifted, lost in _intervals(flown.t, flown.height > ground + _LIFTED, 0.0):
            if lost - lifted > _STANDING:  # propellers that run up feign a jump
                low = float(flown.t[max(int(np.searchsorted(flown.t, lifted)) - 1, 0)])
                return Flight(max(start, low - _LIFTING), stop)
    return Flight(start, stop)


def _contact(readings: _Readings, flight: Flight, shocks: Array) -> Flight:
    """Return a flight that ends at the first shock of its last seconds, or after which it stays down.

    Motors may run on for a moment, and in a craft that crashed until they are disarmed.
    """
    beyond = readings.between(flight.stop, flight.stop + _GROUND).level
    ground = readings.between(flight.stop - _GROUND, flight.stop).level if np.isnan(beyond) else beyond
    flown = readings.between(flight.start, flight.stop)
    high = flown.t[flown.height > ground + _HOP]
    down = min(flight.stop - _GROUND, float(high[-1]) if len(high) else flight.stop)
    last = shocks[(shocks >= max(flight.start + _SHORTEST, down)) & (shocks <= flight.stop)]
    return Flight(flight.start, float(last[0])) if len(last) else flight


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
    ground = float(np.percentile(values[armed], 2.0)) if armed.any() else np.inf
    # The climb that brought it there began on the ground, and the descent ends there.
    up = armed & (values > ground + _RISE)
    for start, stop in _intervals(t, slope_down(smooth).abs().to_numpy() > _LIFTED / _GROUND, 0.0):
        climb = slice(*np.searchsorted(t, (start, stop + 1e-6)))
        up[climb] |= up[climb].any()
    for start, stop in _intervals(t, up, _PAUSE):
        if stop - start >= _SHORTEST:
            yield Flight(start, stop)
