"""The few signals of which the account of a flight is made, each as a log viewer shows it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from core.quantity import joined
from logparse import FlightLog, Tables, Vehicle
from logparse.craft.pwm_range import PwmRange, pwm_range
from logparse.heights import (
    above_ground,
    barometer_stopped,
    ground_level,
    heights,
    not_returned,
    slope_down,
    smoothed,
)
from logparse.messages import NumericMessages
from logparse.rest import ACCEL
from pipeline.flight.account.vibration import Floats, Vibration, read_vibration
from pipeline.results.span import Span, around, within

Mask = NDArray[np.bool_]

#: Modes in which the autopilot works the throttle itself, and those that tumble on purpose or have no attitude target.
HOLDING = frozenset(
    (
        *("ALT_HOLD", "LOITER", "AUTO", "GUIDED", "RTL", "LAND", "POSHOLD", "BRAKE", "CIRCLE", "SPORT", "DRIFT"),
        *("SMART_RTL", "FLOWHOLD", "AUTOTUNE", "POSITION", "MISSION", "HOLD", "ALTITUDE"),
    )
)
AEROBATIC = frozenset(["ACRO", "FLIP", "THROW", "TURTLE", "AUTOROTATE", "MANUAL", "STABILIZED_ACRO", "RATE"])

#: Time [s] that a craft may take to reach a new attitude target, and steps in which it is cut: what counts is the
#: distance from the way that the target took within it, so that a stick thrown about is no loss of control.
_FOLLOWS, _STEPS = 1.0, 10
#: Interval of rows [s] beyond which a stick thrown about between them is not seen (every fifth row of 29-09-2014_2).
#: Rows nearer to each other [s] say the same of how an attitude is held: all of them took half of a long log's account.
BLIND, _SAME = 0.42, 0.02
#: Throttle of idling motors (peterbarker 1.BIN, 775 s: a craft left to itself for a second rolls by 50 deg), and share
#: of an output's range within which it is at a limit.
_CLOSED, AT_LIMIT = 0.05, 0.01


#: Time [s] after lift-off in which the ground still shakes the craft: 42 m/s^2 in 22-12-2014_41.
SHAKE = 0.5
#: Time [s] without a row that is told of: telemetry pauses for 3 s (code-lever 2013-10-13).
_HOLE = 5.0
#: What is believed of a receiver: fewest satellites of a three-dimensional fix, acceleration [m/s^2] that is no jump
#: (uavlogviewer__vtol turns at 11; ArduCopter's own check has 10), and time [s] after which it is believed again
#: (26-11-2014_181 jumped until its end).
SATELLITES, ACCELERATION, RECOVERS = 4, 12.0, 10.0


@dataclass(frozen=True)
class Readings:
    """Signals of one flight and of the ground beside it; each is None where the log lacks it.

    Times are seconds on the log's boot clock. What is read is computed once, when it is first asked for.
    """

    tables: Tables
    messages: Mapping[str, pd.DataFrame]  #: As logged, as numbers.
    vehicle: Vehicle
    flight: Span
    belongs: Span  #: The flight with half of the time on the ground beside it.

    @classmethod
    def of(cls, log: FlightLog, flight: Span) -> Readings:
        """Return the readings of one flight of a log."""
        messages = NumericMessages(log.intact)
        return cls(log.tables, messages, log.vehicle, flight, around(flight, log.flights))

    @cached_property
    def limits(self) -> PwmRange:
        """Limits of the motor outputs, as the parameters set them."""
        return pwm_range(self.tables.parameters)

    @cached_property
    def _logged_heights(self) -> dict[str, pd.Series[float]]:
        return dict(heights(self.tables))

    @cached_property
    def stayed(self) -> dict[str, float]:
        """How far above the ground [m] sources of height stayed where others came back with the craft."""
        return not_returned(self._logged_heights, self.tables.gps, self.flight)

    @cached_property
    def barometer_stopped(self) -> float | None:
        """When the barometer stopped in flight, s; None for one that did not."""
        return barometer_stopped(self._logged_heights, self.flight)

    @cached_property
    def heights(self) -> list[tuple[str, pd.Series[float]]]:
        """Heights by source, the most credible first, those that did not come back or stopped last."""
        wrong = {*self.stayed, *(("baro",) if self.barometer_stopped is not None else ())}
        return sorted(self._logged_heights.items(), key=lambda height: height[0] in wrong)

    @cached_property
    def height(self) -> pd.Series[float] | None:
        """Credible height above the ground that the flight left, m up; above its lowest where no ground was logged."""
        return above_ground(self.heights[0][1], self.flight) if self.heights else None

    @property
    def ground_logged(self) -> bool:
        """Whether the credible height is above the ground."""
        return any(ground_level(height, self.flight) is not None for _, height in self.heights[:1])

    @property
    def own_height(self) -> bool:
        """Whether that is the autopilot's own, which runs away with vibration."""
        return any(source == "autopilot" for source, _ in self.heights[:1])

    @cached_property
    def sink(self) -> pd.Series[float] | None:
        """Speed down that the credible height shows over a second, m/s."""
        return None if self.height is None else slope_down(smoothed(self.height))

    @cached_property
    def force(self) -> pd.Series[float] | None:
        """Magnitude of the specific force, m/s^2."""
        axes = self.specific_force
        return None if axes is None else pd.Series(np.linalg.norm(axes.to_numpy(np.float64), axis=1), index=axes.index)

    @property
    def specific_force(self) -> pd.DataFrame | None:
        """Specific force along the body's axes, m/s^2, over the time that belongs to the flight.

        It is a view of the inertial sensors' table, the longest of a log: kept here, that would be in memory twice.
        """
        imu = self.tables.imu
        if imu is None:
            return None
        axes = imu[list(ACCEL)].iloc[self.belongs.rows(imu.index)].dropna()
        return axes if len(axes) > 2 else None

    @cached_property
    def vibration(self) -> Vibration | None:
        """Vibration of the first accelerometer."""
        return read_vibration(self.messages, lambda: self.specific_force)

    @cached_property
    def outputs(self) -> pd.DataFrame | None:
        """Motor outputs between their limits in flight, 0 at MOT_SPIN_MIN and 1 at MOT_SPIN_MAX."""
        motors = self.tables.motors
        low, high = (self.limits.pwm(spin) for spin in (self.limits.spin_min, self.limits.spin_max))
        if motors is None or not high > low:
            return None
        inside = motors.loc[self.flight.start : self.flight.stop].dropna(how="all")
        return (inside - low) / (high - low) if len(inside) > 2 else None

    @cached_property
    def throttle(self) -> pd.Series[float] | None:
        """Throttle, 0..1: what the controller asked for, else the mean thrust of the motor outputs."""
        given = self.tables.column("setpoints", "throttle")
        if given is not None and len(asked := given.dropna()):
            return asked.iloc[self.belongs.rows(asked.index)]
        if self.outputs is None:
            return None
        part, expo = self.outputs.clip(0.0, 1.0), self.limits.thrust_expo
        # ArduPilot's curve (AP_MotorsMulticopter::apply_thrust_curve_and_volt_scaling), backwards.
        return ((1.0 - expo) * part + expo * part**2).mean(axis=1).dropna()

    @cached_property
    def lean(self) -> pd.Series[float] | None:
        """Angle between the thrust axis and the vertical, rad."""
        attitude = self.tables.part("attitude", ("roll", "pitch"))
        if attitude is None:
            return None
        angles = attitude.iloc[self.belongs.rows(attitude.index)].dropna()
        cosine = np.cos(angles["roll"].to_numpy(np.float64)) * np.cos(angles["pitch"].to_numpy(np.float64))
        return pd.Series(np.arccos(np.clip(cosine, -1.0, 1.0)), index=angles.index) if len(angles) > 1 else None

    @cached_property
    def attitude_error(self) -> pd.Series[float] | None:
        """Angle between the thrust axis flown and the way of its target, rad; NaN where nothing should hold it."""
        wanted, flown = (
            None if table is None else table.iloc[self.belongs.rows(table.index)].dropna()
            for table in (self.tables.part(name, ("roll", "pitch")) for name in ("setpoints", "attitude"))
        )
        if wanted is None or flown is None or min(len(wanted), len(flown)) < 2:
            return None
        times = wanted.index.to_numpy(np.float64)
        usual = float(np.median(np.diff(times)))
        if usual > BLIND:
            return None
        times = times[:: max(int(_SAME / usual), 1)]
        t = times[(times >= flown.index[0]) & (times <= flown.index[-1])]
        way = (_axes(wanted, t - lag) for lag in np.linspace(0.0, _FOLLOWS, _STEPS + 1))
        error = _off_the_way(_axes(flown, t), way)
        error[self.in_modes(t, AEROBATIC) | self.chirped(t) | self.idle(t)] = np.nan
        return pd.Series(error, index=pd.Index(t))

    @cached_property
    def holes(self) -> tuple[Span, ...]:
        """Times in flight of which the log has nothing."""
        known = (self.tables.times(name) for name in ("attitude", "baro", "motors", "gps"))
        t = np.sort(np.concatenate([np.empty(0), *(times for times in known if times is not None)]))
        t = t[slice(*np.searchsorted(t, (self.flight.start, self.flight.stop)))]
        return tuple(Span(float(t[row]), float(t[row + 1])) for row in np.flatnonzero(np.diff(t) > _HOLE))

    def mode_forgotten(self, t: Floats) -> Mask:
        """Return at which times a hole may have swallowed the newest mode."""
        modes = self.tables.modes
        changes = np.empty(0) if modes is None else modes.index.to_numpy(np.float64)
        return within(
            t, (Span(hole.start, float(min(changes[changes >= hole.stop], default=np.inf))) for hole in self.holes)
        )

    def in_modes(self, t: Floats, names: frozenset[str]) -> Mask:
        """Return which times lie in one of the flight modes, as far as the log has them."""
        modes = self.tables.modes
        if modes is None or not len(modes):
            return np.zeros(len(t), dtype=bool)
        place = np.searchsorted(modes.index.to_numpy(np.float64), t, side="right") - 1
        return np.asarray((place >= 0) & modes["mode"].isin(names).to_numpy()[place.clip(0)])

    def chirped(self, t: Floats) -> Mask:
        """Return which times lie within a second of a chirp of SYSTEMID mode."""
        return within(t, self._chirps)

    @cached_property
    def _chirps(self) -> tuple[Span, ...]:
        """Chirps of SYSTEMID mode with a second on either side."""
        added = self.tables.column("systemid", "target")
        if added is None:
            return ()
        moving, times = np.isfinite(added.to_numpy(np.float64)), added.index.to_numpy(np.float64)
        return tuple(Span(first - 1.0, last + 1.0) for first, last, _ in stretches(times, moving, join=2.0))

    def idle(self, t: Floats) -> Mask:
        """Return which times lie within a second after a closed throttle, which leaves motors nothing to turn with."""
        if self.throttle is None:
            return np.zeros(len(t), dtype=bool)
        closed = self.throttle.index.to_numpy(np.float64)[self.throttle.to_numpy(np.float64) < _CLOSED]
        return np.asarray(np.searchsorted(closed, t, side="right") > np.searchsorted(closed, t - _FOLLOWS))

    def at_limits(self, first: float, last: float) -> str:
        """Write which motors stood at a limit for most of a stretch, as a clause; empty where none did."""
        outputs = None if self.outputs is None else self.outputs.loc[first:last]
        if outputs is None or not len(outputs):
            return ""
        sides = {"its maximum": (outputs >= 1.0 - AT_LIMIT).mean(), "its minimum": (outputs <= AT_LIMIT).mean()}
        words = []
        for side, share in sides.items():
            motors = [str(name).removeprefix("m") for name in share.index[share > 0.5]]
            if motors and len(motors) < len(share):
                several = len(motors) > 1
                words.append(
                    f"motor{'s' * several} {joined(motors)} at {side.replace('its', 'their') if several else side}"
                )
        return " and ".join(words)

    def flying(self, t: Floats) -> Mask:
        """Return which times lie in the flight, the shake of lift-off left out."""
        return (t >= self.flight.start + SHAKE) & (t <= self.flight.stop)


class Stretch(NamedTuple):
    """A stretch of samples: its first and last time [s], and its rows."""

    first: float
    last: float
    rows: slice


def stretches(t: Floats, on: Mask, *, join: float, shortest: float = 0.0) -> list[Stretch]:
    """Return the stretches of samples with `on` that last `shortest` s; interruptions up to `join` s end none.

    Nor does the time between two rows, in a log that is slower.
    """
    rows = np.flatnonzero(on)
    if not len(rows):
        return []
    apart = max(join, 1.5 * float(np.median(np.diff(t)))) if len(t) > 1 else join
    cuts = np.flatnonzero(np.diff(t[rows]) > apart)
    ends = zip(rows[np.r_[0, cuts + 1]].tolist(), rows[np.r_[cuts, len(rows) - 1]].tolist(), strict=True)
    candidates = [Stretch(float(t[first]), float(t[last]), slice(first, last + 1)) for first, last in ends]
    return [stretch for stretch in candidates if stretch.last - stretch.first >= shortest]


def at(t: float | Floats, series: pd.Series[float]) -> Floats:
    """Interpolate a series at times, shape (n,) or ()."""
    return np.asarray(np.interp(t, series.index.to_numpy(np.float64), series.to_numpy(np.float64)))


def _axes(attitude: pd.DataFrame, t: Floats) -> Floats:
    """Thrust axis at times, unit vectors in a frame that turns with the heading, shape (n, 3)."""
    roll, pitch = attitude["roll"].to_numpy(np.float64), attitude["pitch"].to_numpy(np.float64)
    columns = np.sin(pitch) * np.cos(roll), -np.sin(roll), np.cos(pitch) * np.cos(roll)
    axis = np.column_stack([np.interp(t, attitude.index.to_numpy(np.float64), column) for column in columns])
    return np.asarray(axis / np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), 1e-9))


def _off_the_way(axis: Floats, way: Iterable[Floats]) -> Floats:
    """Angle [rad] between directions (n, 3) and the nearest point of a way, whose points are (n, 3); shape (n,)."""
    closest = np.full(len(axis), -1.0)
    for begin, end in pairwise(way):  # one leg at a time: all of a long log at once are many times its size
        leg = end - begin
        part = np.sum((axis - begin) * leg, axis=1) / np.maximum(np.sum(leg**2, axis=1), 1e-12)
        nearest = begin + np.clip(part, 0.0, 1.0)[:, None] * leg
        cosine = np.sum(axis * nearest, axis=1) / np.maximum(np.linalg.norm(nearest, axis=1), 1e-9)
        np.maximum(closest, cosine, out=closest)
    return np.asarray(np.arccos(np.clip(closest, -1.0, 1.0)))
