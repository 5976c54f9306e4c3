"""Motors at their limits, and lift that does not suffice."""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from core.findings import Severity
from logparse.craft.pwm_range import pwm_range
from logparse.events.event import FlightEvent
from logparse.events.stretches import Array, stretches, within
from logparse.flights import Flight
from logparse.heights import height_above_ground, slope_down, speed_down
from logparse.tables import Tables

#: Part of the PWM range below the upper limit that counts as being at it, longest pause within one stretch [s], and
#: time at the limit [s] from which it is a warning: a step of a stick drives motors there for a tenth of a second.
_NEAR, _PAUSE, _LASTING = 0.01, 2.0, 0.5

#: Throttle, time [s] and lean asked for [rad] of a loss of lift: ArduCopter's own check.
_THROTTLE, _SINKING_TIME, _LEVEL = 0.9, 1.0, np.radians(15.0)
_LIFT_SOURCE = "ArduCopter crash_check.cpp, THRUST_LOSS_CHECK: throttle 0.9, at most 15 deg asked, descending for 1 s"
#: Speed down [m/s] that is more than noise of the estimate, and more than noise of a barometer's slope over a second
#: and the pressure of propellers at full throttle.
_SINKING, _SINKING_BY_HEIGHT = 0.3, 1.0

#: Part of the full thrust that hovering may take: above, thrust is less than twice the weight.
_RESERVE, _POOR = 0.5, 0.6
_RESERVE_SOURCE = "ArduPilot wiki, Setting Hover Throttle: usually 0.2 to 0.6; twice the weight is advised"
#: Time [s] over which hovering is averaged.
_HOVER_TIME = 2.0


def motor_events(tables: Tables, flights: tuple[Flight, ...]) -> Iterator[FlightEvent]:
    """Yield motors at their upper limit, loss of lift and a lack of thrust in reserve.

    Parameters
    ----------
    tables : Tables
    flights : tuple of Flight
    """
    if tables.motors is not None and len(tables.motors) > 2:
        for flight in flights:
            yield from _saturation(tables.motors, tables, flight)
    throttle, linear = _throttle(tables)
    if throttle is not None:
        for flight in flights:
            yield from _lift(_asked_in_full(throttle, tables, flight), tables, flight)
            yield from _reserve(throttle, flight, linear=linear)


def _throttle(tables: Tables) -> "tuple[pd.Series[float] | None, bool]":
    """Return the throttle that the controller asked for, else the mean part of full thrust that the motors gave.

    The second value tells whether it is a part of the full thrust (in Copter 3.4 and later) or of the range of PWM.
    """
    if tables.setpoints is not None and _logged(tables):
        return tables.setpoints["throttle"].dropna(), "MOT_SPIN_MAX" in tables.parameters
    if tables.motors is None:
        return None, True
    levels = pwm_range(tables.parameters)
    idle, top = levels.pwm(levels.spin_min), levels.pwm(levels.spin_max)
    if not top > idle:
        return None, True
    actuator = ((tables.motors - idle) / (top - idle)).clip(0.0, 1.0)
    # ArduPilot's curve (AP_MotorsMulticopter::apply_thrust_curve_and_volt_scaling), backwards.
    thrust = (1.0 - levels.thrust_expo) * actuator + levels.thrust_expo * actuator**2
    return thrust.mean(axis=1).dropna(), True


def _asked_in_full(throttle: "pd.Series[float]", tables: Tables, flight: Flight) -> "pd.Series[bool]":
    """Return when all thrust that there is was asked for in a flight.

    Without a throttle in the log, that is when a motor is at its limit while all of them give no less than the flight
    takes: a mixer that keeps the attitude has no more lift to give.
    """
    inside = throttle.loc[flight.start + 1.0 : flight.stop]
    full = inside >= _THROTTLE
    if not len(inside) or tables.motors is None or _logged(tables):
        return full
    levels = pwm_range(tables.parameters)
    limit = levels.pwm(levels.spin_max) - _NEAR * (levels.pwm_max - levels.pwm_min)
    at_limit = (tables.motors.loc[inside.index] >= limit).any(axis=1)
    return full | (at_limit & (inside >= inside.median()))


def _logged(tables: Tables) -> bool:
    return tables.setpoints is not None and bool(tables.setpoints["throttle"].notna().any())


def _saturation(motors: pd.DataFrame, tables: Tables, flight: Flight) -> Iterator[FlightEvent]:
    inside = motors.loc[flight.start : flight.stop]
    if len(inside) < 3:
        return
    levels = pwm_range(tables.parameters)
    top = levels.pwm(levels.spin_max)
    limit = top - _NEAR * (levels.pwm_max - levels.pwm_min)
    t, values = inside.index.to_numpy(np.float64), inside.to_numpy(np.float64)
    with np.errstate(invalid="ignore"):
        at_limit = values >= limit
    step = float(np.median(np.diff(t)))
    for first, last in stretches(t, np.asarray(at_limit.any(axis=1)), join=max(_PAUSE, 2.5 * step)):
        rows = (t >= first) & (t <= last)
        counts = at_limit[rows].sum(axis=0)
        seconds = float(at_limit[rows].any(axis=1).sum()) * step
        names = ", ".join(
            str(name).removeprefix("m") for name, count in zip(inside.columns, counts, strict=True) if count
        )
        plural = "s" if np.count_nonzero(counts) > 1 else ""
        lasting = seconds >= _LASTING
        yield FlightEvent(
            id="motor-at-limit",
            t=first,
            end=last,
            severity=Severity.WARNING if lasting else Severity.INFO,
            reason=f"Motor{plural} {names} at the upper limit ({top:.0f} µs) for {seconds:.1f} s.",
            advice="The craft cannot do what is asked then: fly less aggressively, lighter, or with a fuller battery."
            if lasting
            else "",
            evidence={"motors": names, "seconds": seconds, "limit_us": top},
            source="MOT_SPIN_MAX",
        )


def _lift(full: "pd.Series[bool]", tables: Tables, flight: Flight) -> Iterator[FlightEvent]:
    """Find full throttle while sinking, level: no craft is expected to hold its height at any lean."""
    speed, least = speed_down(tables), _SINKING
    if speed is None and (height := height_above_ground(tables)) is not None:
        speed, least = slope_down(height), _SINKING_BY_HEIGHT
    if speed is None:
        return
    if len(full) < 3:
        return
    t = full.index.to_numpy(np.float64)
    down = np.interp(t, speed.index.to_numpy(np.float64), speed.to_numpy(np.float64))
    on = full.to_numpy(np.bool_) & (down > least) & ~(_lean_asked(tables, t) > _LEVEL)
    known = _logged(tables)
    for first, last in stretches(t, on, join=0.4 if known else 0.2, shortest=_SINKING_TIME):
        worst = float(np.max(down[(t >= first) & (t <= last)]))
        yield FlightEvent(
            id="loss-of-lift",
            t=first,
            end=last,
            severity=Severity.ERROR if known else Severity.WARNING,
            reason=f"The craft sank at up to {worst:.1f} m/s "
            + ("under full throttle." if known else "with a motor at its limit, while all gave no less than usual."),
            advice="Look for a failed motor or propeller, an empty battery, or too much weight.",
            evidence={"descent_m_s": worst, "seconds": last - first},
            source=_LIFT_SOURCE,
        )


def _lean_asked(tables: Tables, t: Array) -> Array:
    """Lean asked for at times, rad; NaN where the log does not tell."""
    wanted = tables.setpoints[["roll", "pitch"]].dropna() if tables.setpoints is not None else pd.DataFrame()
    if len(wanted) < 2:
        return np.full(len(t), np.nan)
    cosine = np.cos(wanted["roll"].to_numpy(np.float64)) * np.cos(wanted["pitch"].to_numpy(np.float64))
    return np.asarray(np.interp(t, wanted.index.to_numpy(np.float64), np.arccos(cosine)))


def _reserve(throttle: "pd.Series[float]", flight: Flight, *, linear: bool) -> Iterator[FlightEvent]:
    """Find out whether hovering takes more than half of the thrust, and since when.

    With `linear` the throttle is a part of the full thrust (Copter 3.4 and later), otherwise of the PWM range.
    """
    inside = throttle.loc[flight.start : flight.stop]
    if len(inside) < 10 or flight.duration < 2.0 * _HOVER_TIME:
        return
    median = float(inside.median())
    if not median > (_RESERVE if linear else _POOR):
        return
    t = inside.index.to_numpy(np.float64)
    above = inside.to_numpy(np.float64) > _RESERVE
    spans = stretches(t, above, join=_HOVER_TIME, shortest=_HOVER_TIME)
    first, last = (spans[0][0], spans[-1][1]) if spans else (flight.start, flight.stop)
    share = float(within(t, spans).mean())
    yield FlightEvent(
        id="low-thrust-reserve",
        t=first,
        end=last,
        severity=Severity.WARNING,
        reason=(
            f"Thrust is lacking: flying takes {100.0 * median:.0f} % of it in the median, so full thrust is only "
            f"{1.0 / median:.1f} times the weight."
            if linear
            else f"Thrust is lacking: flying takes {100.0 * median:.0f} % throttle in the median."
        ),
        advice="Fly lighter, with larger propellers or more cells; check that MOT_SPIN_MAX does not limit without need."
        + (" Do not fly in wind like this." if median > _POOR else ""),
        evidence={"median_throttle": median, "part_above_half": share}
        | ({"thrust_to_weight": 1.0 / median} if linear else {}),
        source=_RESERVE_SOURCE,
    )
