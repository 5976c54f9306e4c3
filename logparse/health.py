"""What a log lacks for identification, what is wrong with the flight in it, and how to log better next time."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import pandas as pd

from core.findings import Finding, Severity
from core.units import numbers
from logparse.craft.log_settings import TELEMETRY, Need, bits_of, how_to_log, log_setting
from logparse.craft.pwm_range import pwm_range
from logparse.flights import LONGEST_GAP
from logparse.rest import at_rest, calibration

if TYPE_CHECKING:
    from logparse.flights import LONGEST_GAP, Flight
    from logparse.log import FlightLog

#: Tables that identification needs: finding, what it is called, what it is for, severity when missing.
_NEEDED = (
    ("motors", "no-motor-outputs", "motor outputs", "no model from motors to motion", Need.MOTORS, Severity.ERROR),
    ("imu", "no-imu", "gyro and accelerometer", "the motion is known at 10 Hz at best", Need.IMU, Severity.WARNING),
    ("gps", "no-gps", "GPS", "there is no position to fit", Need.GPS, Severity.ERROR),
    ("baro", "no-baro", "barometer", "height rests on GPS alone", Need.BARO, Severity.WARNING),
    ("mag", "no-mag", "magnetometer", "heading drifts by some ten degrees", Need.COMPASS, Severity.WARNING),
    ("attitude", "no-attitude", "attitude", "it must come from the IMU alone", Need.ATTITUDE, Severity.WARNING),
    ("battery", "no-battery", "battery voltage", "thrust cannot be related to it", Need.BATTERY, Severity.INFO),
)

#: Rates [Hz] below which a table is too slow for its purpose.
_MOTORS_RATE, _IMU_RATE = 5.0, 20.0
#: Gap [s] in flight that estimation notices.
_GAP = 1.0
#: Vibration [m/s^2] above which ArduPilot's documentation calls for action.
_VIBRATION = 30.0


def check(log: "FlightLog") -> tuple[Finding, ...]:
    """Judge a log for identification.

    Parameters
    ----------
    log : FlightLog

    Returns
    -------
    tuple of Finding
        Missing tables with the parameter that logs them, low rates, gaps in flight, GPS quality, saturated or idle
        motors, vibration and clipping, errors that the autopilot reported in flight.
    """
    flight = log.flight
    findings = list(_advised(log, list(_lacking(log))))
    findings += calibration(at_rest(log.tables, log.flights), log.parameters)
    if flight is None:
        findings.append(
            Finding(
                "no-flight",
                Severity.ERROR,
                "The log shows no flight: " + _why_no_flight(log),
                "Use a log of a flight of at least a minute with movement in all directions.",
            )
        )
        return tuple(findings)
    findings += _gaps(log, flight)
    findings += _fixes(log, flight)
    findings += _saturation(log, flight)
    findings += _vibration(log, flight)
    findings += _errors(log, flight)
    return tuple(findings)


def _lacking(log: "FlightLog") -> Iterator[tuple[Need, Finding]]:
    """Find what the log lacks, and what it needs for it; without advice, which takes all needs together."""
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
    for table, name, what, so, need, severity in _NEEDED:
        if table == "motors" and any(finding.id == "frame-unknown" for finding in log.findings):
            # The outputs are there; which of them are motors is another matter and told already.
            continue
        if not log.tables.has(table):
            yield need, Finding(name, severity, f"No {what} in the log: {so}.")


def _why_no_flight(log: "FlightLog") -> str:
    """Report in a clause what speaks against a flight."""
    motors = log.tables.motors
    if motors is None:
        return "motor outputs are missing and the height never rises while armed."
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


def _rate(t: npt.NDArray[np.float64]) -> float:
    return 1.0 / float(np.median(np.diff(t))) if len(t) > 1 else float("nan")


def _rates(log: "FlightLog") -> Iterator[tuple[Need, Finding]]:
    tables = log.tables
    if tables.motors is not None and (rate := rate_of(tables.motors)) < _MOTORS_RATE:
        yield (
            Need.FAST_MOTORS,
            Finding(
                "motors-slow",
                Severity.WARNING,
                f"Motor outputs come at {rate:.1f} Hz: what the motors do between samples is lost.",
                evidence={"rate": rate},
            ),
        )
    rotation = next(tables.columns("rates", ("out_roll",)), None)
    slow_rotation = rotation is None or not rotation.notna().any() or _rate(rotation.index.to_numpy()) < 40.0
    if (t := tables.times("imu")) is not None and (rate := _rate(t)) < _IMU_RATE:
        yield (
            Need.FAST_IMU,
            Finding(
                "imu-slow",
                Severity.WARNING,
                f"The IMU comes at {rate:.1f} Hz, "
                + (
                    "which is coarse to integrate."
                    if rate > 9.0
                    else "too slow to integrate; the autopilot's attitude counts."
                ),
                evidence={"rate": rate},
            ),
        )
    if slow_rotation:
        yield (
            Need.FAST_RATES,
            Finding(
                "no-fast-rates",
                Severity.INFO,
                "Rate controller outputs are missing or slower than 40 Hz: no fit of fast rotational dynamics.",
            ),
        )


def _gaps(log: "FlightLog", flight: "Flight") -> Iterator[Finding]:
    telemetry = log.format in TELEMETRY
    for name in ("motors", "imu", "gps", "attitude"):
        whole = log.tables.times(name)
        if whole is None:
            continue
        first, last = np.searchsorted(whole, flight.start), np.searchsorted(whole, flight.stop, side="right")
        t = np.concatenate(([flight.start], whole[first:last], [flight.stop]))
        gaps = np.diff(t)
        limit = max(_GAP, 5.0 / _rate(whole)) if telemetry else _GAP
        count = int(np.count_nonzero(gaps > limit))
        if count:
            where = float(t[int(np.argmax(gaps))])
            yield Finding(
                f"gap-in-{name}",
                Severity.WARNING,
                f"The table {name} has {count} gap{'s' if count > 1 else ''} in flight, the longest of "
                f"{gaps.max():.1f} s at t = {where:.1f} s.",
                "The telemetry link lost frames; use the autopilot's own log."
                if telemetry
                else "Use a faster card or log fewer topics."
                if log.format == "ulog"
                else "Use a faster card or log fewer messages (DSF.Dp counts what the autopilot dropped).",
                {"count": count, "longest": float(gaps.max()), "t": where},
            )


def _fixes(log: "FlightLog", flight: "Flight") -> Iterator[Finding]:
    gps = log.tables.gps
    if gps is None:
        return
    fixes = gps.loc[flight.start : flight.stop]
    if not len(fixes):
        return
    good = float(((fixes["fix"] >= 3.0) & fixes["lat"].notna()).mean())
    if good < 0.98:
        yield Finding(
            "gps-no-fix",
            Severity.ERROR if good < 0.5 else Severity.WARNING,
            f"GPS has a three-dimensional fix in only {100 * good:.0f} % of the flight.",
            "Wait for a fix before take-off and fly under open sky.",
            {"share": good},
        )
    hdop = float(fixes["hdop"].median())
    if hdop > 2.0:
        yield Finding(
            "gps-poor",
            Severity.WARNING,
            f"The horizontal dilution of precision is {hdop:.1f} in the median: positions wander by metres.",
            "Fly when and where more satellites are in view.",
            {"hdop": hdop},
        )


def _saturation(log: "FlightLog", flight: "Flight") -> Iterator[Finding]:
    motors = log.tables.motors
    if motors is None or log.format == "ulog":
        return
    values = motors.loc[flight.start : flight.stop].to_numpy()
    levels = pwm_range(log.parameters)
    top, bottom = levels.pwm(levels.spin_max), levels.pwm(levels.spin_min)
    span = levels.pwm_max - levels.pwm_min
    with np.errstate(invalid="ignore"):
        high = float((values >= top - 0.01 * span).any(axis=1).mean()) if len(values) else 0.0
        low = float((values <= bottom + 0.005 * span).any(axis=1).mean()) if len(values) else 0.0
    if high > 0.01:
        yield Finding(
            "motors-saturated",
            Severity.WARNING if high > 0.05 else Severity.INFO,
            f"In {100 * high:.0f} % of the flight a motor is at its upper limit ({top:.0f} us): "
            "there the craft does not answer linearly.",
            "Fly less aggressively, lighter, or with a fuller battery.",
            {"share": high, "limit": top},
        )
    if low > 0.05:
        yield Finding(
            "motors-at-idle",
            Severity.INFO,
            f"In {100 * low:.0f} % of the flight a motor is at its lower limit ({bottom:.0f} us).",
            "",
            {"share": low, "limit": bottom},
        )


def vibration(log: "FlightLog", start: float, stop: float) -> dict[str, float] | None:
    """Vibration as the autopilot measures it, worst axis, and how often the accelerometer hit its range.

    Parameters
    ----------
    log : FlightLog
        The log.
    start, stop : float
        The stretch of time, s.

    Returns
    -------
    dict or None
        ``p95`` [m/s^2], ``above`` (part of the time above what calls for action) and ``clips``; None where not logged.
    """
    name, axes = ("VIBE", ("VibeX", "VibeY", "VibeZ"))
    if "VIBRATION" in log.messages:
        name, axes = ("VIBRATION", ("vibration_x", "vibration_y", "vibration_z"))
    if name not in log.messages:
        return None
    frame = log.messages[name]
    frame = frame[(frame.index >= start) & (frame.index <= stop)]
    if not len(frame) or not set(axes) <= set(frame.columns):
        return None
    worst = np.column_stack([numbers(frame, axis) for axis in axes]).max(axis=1)
    worst = worst[np.isfinite(worst)]
    if not len(worst):
        return None
    clips = [column for column in frame.columns if str(column).lower().startswith("clip")]
    # The counters run for each accelerometer by itself.
    by = "IMU" if "IMU" in frame else None
    parts = [part for _, part in frame.groupby(by)] if by else [frame]
    count = max(
        (float(counter[-1] - counter[0]) for part in parts for column in clips if len(counter := _known(part, column))),
        default=0.0,
    )
    return {
        "p95": float(np.percentile(worst, 95.0)),
        "above": float((worst > _VIBRATION).mean()),
        "clips": count,
    }


def _known(rows: pd.DataFrame, column: str) -> npt.NDArray[np.float64]:
    values = numbers(rows, column)
    return values[np.isfinite(values)]


def _vibration(log: "FlightLog", flight: "Flight") -> Iterator[Finding]:
    measured = vibration(log, flight.start, flight.stop)
    if measured is None:
        return
    share, worst, count = measured["above"], measured["p95"], measured["clips"]
    if share > 0.05:
        yield Finding(
            "vibration",
            Severity.WARNING,
            f"Vibration is above {_VIBRATION:.0f} m/s^2 in {100 * share:.0f} % of the flight (95th percentile "
            f"{worst:.0f}): accelerations are biased.",
            "Balance the propellers and soften the mount of the autopilot.",
            {"share": share, "p95": worst},
        )
    if count > 0:
        yield Finding(
            "accelerometer-clipping",
            Severity.WARNING if count > 100 else Severity.INFO,
            f"The accelerometer hit its range {count:.0f} times in flight.",
            "Soften the mount of the autopilot, or look for a crash in the log.",
            {"count": int(count)},
        )


def _errors(log: "FlightLog", flight: "Flight") -> Iterator[Finding]:
    events = log.tables.events
    if events is None:
        return
    errors = events.loc[flight.start : flight.stop]
    errors = errors[(errors["event"] == "ERROR") & ~errors["detail"].str.endswith(" 0")]
    if len(errors):
        kinds = sorted(set(errors["detail"]))
        yield Finding(
            "autopilot-errors",
            Severity.WARNING,
            f"The autopilot reported {len(errors)} error{'s' if len(errors) > 1 else ''} in flight: "
            + ", ".join(kinds[:6])
            + (" ..." if len(kinds) > 6 else "")
            + ".",
            "Leave the time around them out of the fit.",
            {"count": len(errors), "first": float(errors.index[0])},
        )
