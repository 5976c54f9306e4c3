"""What a log lacks for identification, and how to log better next time."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import pandas as pd

from core.findings import Finding, Severity, info, warning
from logparse.craft.log_settings import Need, bits_of, how_to_log, log_setting
from logparse.craft.pwm_range import pwm_range
from logparse.flights import LONGEST_GAP
from logparse.formats import TELEMETRY
from logparse.heights import heights
from logparse.rest import at_rest, calibration

if TYPE_CHECKING:
    from logparse.flights import Flight
    from logparse.log import FlightLog

#: Tables that identification needs: what each is called, what becomes of its lack, and how much that matters.
_NEEDED = (
    ("motors", "motor outputs", "no model from motors to motion", Need.MOTORS, Severity.ERROR),
    ("imu", "gyro and accelerometer", "the motion is known at 10 Hz at best", Need.IMU, Severity.WARNING),
    ("gps", "GPS", "there is no position to fit", Need.GPS, Severity.ERROR),
    ("baro", "barometer", "the height is less sure", Need.BARO, Severity.WARNING),
    ("mag", "magnetometer", "heading drifts by some ten degrees", Need.COMPASS, Severity.WARNING),
    ("attitude", "attitude", "it must come from the IMU alone", Need.ATTITUDE, Severity.WARNING),
    ("battery", "battery voltage", "thrust cannot be related to it", Need.BATTERY, Severity.INFO),
)

#: Rates [Hz] below which a table is too slow for its purpose.
_MOTORS_RATE, _IMU_RATE = 5.0, 20.0
#: Gap [s] in flight that estimation notices.
_GAP = 1.0


def check(log: "FlightLog") -> tuple[Finding, ...]:
    """Judge a log for identification."""
    flight = log.flight
    findings = list(_advised(log, list(_lacking(log))))
    findings += calibration(at_rest(log.tables, log.flights), log.parameters)
    if flight is None and not log.vehicle.other_craft:
        findings.append(
            Finding(
                "no-flight",
                Severity.ERROR,
                "The log shows no flight: " + _why_no_flight(log),
                "Use a log of a flight of at least a minute with movement in all directions.",
            )
        )
    if flight is not None:
        findings += _gaps(log, flight)
    return tuple(findings)


def _lacking(log: "FlightLog") -> Iterator[tuple[Need, Finding]]:
    """Find what the log lacks, and what it needs for it; without advice, which takes all needs together."""
    if any(each.id == "message-layout" and each.severity is Severity.ERROR for each in log.findings):
        # With its beginning the log lost what it would have to tell.
        return
    yield from _missing(log)
    if log.flight is not None:
        yield from _rates(log)


def _advised(log: "FlightLog", lacking: Sequence[tuple[Need, Finding]]) -> Iterator[Finding]:
    """Add to each finding how to log what is lacking: one final value of one parameter for all of them."""
    vehicle, needs = log.vehicle, {need for need, _ in lacking}
    setting = log_setting(vehicle, log.format, log.parameters, needs)
    said = False
    for need, finding in lacking:
        evidence = dict(finding.evidence)
        bit = bits_of(vehicle).get(need)
        advice = how_to_log(need, setting, vehicle, log.format, said=said)
        said = said or (setting is not None and setting.sentence() in advice)
        if setting is not None and bit is not None and not setting.has(bit):
            evidence |= {"parameter": setting.parameter, "bit": bit.number, "name": bit.name}
            if setting.present is not None and setting.wanted is not None:
                evidence |= {"present": setting.present, "wanted": setting.wanted}
        yield replace(finding, advice=advice, evidence=evidence)


def _missing(log: "FlightLog") -> Iterator[tuple[Need, Finding]]:
    unknown = any(each.id == "frame-unknown" and each.severity is Severity.ERROR for each in log.findings)
    for table, called, so, need, severity in _NEEDED:
        if table == "motors" and unknown:
            # The outputs are there; which of them are motors is another matter and told already.
            continue
        if not log.tables.has(table):
            yield need, Finding("not-logged", severity, f"No {called} in the log: {so}.", evidence={"what": table})


def _why_no_flight(log: "FlightLog") -> str:
    """Report in a clause what speaks against a flight."""
    motors = log.tables.motors
    if motors is None:
        rises = "the height never rises while armed" if any(heights(log.tables)) else "so is every height"
        return f"motor outputs are missing and {rises}."
    values = motors.to_numpy()
    if not np.isfinite(values).any():
        return "the motors get no pulses."
    top = float(np.nanmax(values))
    levels = pwm_range(log.parameters)
    if top <= levels.pwm(max(levels.spin_arm, levels.spin_min)) + 1.0:
        return f"the motors never run above idle ({top:.0f} us)."
    times = motors.index.to_numpy(np.float64)
    step = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    if step > LONGEST_GAP:
        return f"motor outputs are {step:.0f} s apart: log them faster; or the clock of this log is wrong."
    return "the motors run, but the craft neither rises nor moves."


def rate_of(table: pd.DataFrame) -> float:
    """Usual sample rate [Hz]: that of the median interval; NaN for less than two rows."""
    return _rate(table.index.to_numpy())


def longest_step(rate: float) -> float:
    """Return the longest time between rows of this rate [Hz] that is no gap, s: of five usual ones, and a second."""
    return max(_GAP, 5.0 / rate)


def _rate(t: npt.NDArray[np.float64]) -> float:
    return 1.0 / float(np.median(np.diff(t))) if len(t) > 1 else float("nan")


def _rates(log: "FlightLog") -> Iterator[tuple[Need, Finding]]:
    tables = log.tables
    if tables.motors is not None and (rate := rate_of(tables.motors)) < _MOTORS_RATE:
        yield (
            Need.FAST_MOTORS,
            warning(
                "not-logged",
                f"Motor outputs come at {rate:.1f} Hz: what the motors do between samples is lost.",
                what="fast motors",
                rate=rate,
            ),
        )
    rotation = tables.column("rates", "out_roll")
    slow_rotation = rotation is None or not rotation.notna().any() or _rate(rotation.index.to_numpy()) < 40.0
    if (t := tables.times("imu")) is not None and (rate := _rate(t)) < _IMU_RATE:
        yield (
            Need.FAST_IMU,
            warning(
                "not-logged",
                f"The IMU comes at {rate:.1f} Hz, "
                + (
                    "which is coarse to integrate."
                    if rate > 9.0
                    else "too slow to integrate; the autopilot's attitude counts."
                ),
                what="fast imu",
                rate=rate,
            ),
        )
    if slow_rotation:
        yield (
            Need.FAST_RATES,
            info(
                "not-logged",
                "Rate controller outputs are missing or slower than 40 Hz: no fit of fast rotational dynamics.",
                what="fast rates",
            ),
        )


def _gaps(log: "FlightLog", flight: "Flight") -> Iterator[Finding]:
    telemetry, damaged = log.format in TELEMETRY, any(each.id == "file-damaged" for each in log.findings)
    for name in ("motors", "imu", "gps", "attitude"):
        whole = log.tables.times(name)
        if whole is None:
            continue
        first, last = np.searchsorted(whole, flight.start), np.searchsorted(whole, flight.stop, side="right")
        t = np.concatenate(([flight.start], whole[first:last], [flight.stop]))
        gaps = np.diff(t)
        limit = longest_step(_rate(whole)) if telemetry else _GAP
        count = int(np.count_nonzero(gaps > limit))
        if count:
            where = float(t[int(np.argmax(gaps))])
            yield warning(
                "log-gaps",
                f"The table {name} has {count} gap{'s' if count > 1 else ''} in flight, the longest of "
                f"{gaps.max():.1f} s at t = {where:.1f} s.",
                "Copy the log again: what is missing may be in the original."
                if damaged
                else "The telemetry link lost frames; use the autopilot's own log."
                if telemetry
                else "Use a faster card or log fewer topics."
                if log.format == "ulog"
                else "Use a faster card or log fewer messages (DSF.Dp counts what the autopilot dropped).",
                count=count,
                longest=float(gaps.max()),
                t=where,
            )
