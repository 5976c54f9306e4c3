"""What limits the worth of records: too few samples a second, motors at their limits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from core.findings import info, warning
from logparse import Finding, FlightLog, Severity
from logparse.craft.log_settings import Need, bit_to_set
from sysid.frequency.records import AxisRecord
from sysid.frequency.response import FrequencyResponse
from sysid.records.motor_scaling import motor_pwm

#: Rate [Hz] of samples below which the loop's own frequencies fold.
FOLDING = 25.0

#: Part of the time with a motor at a limit, and distance [us] from it.
_SATURATED, _AT_LIMIT = 0.02, 3.0


def limits_of(records: Sequence[AxisRecord], logs: Sequence[FlightLog]) -> list[Finding]:
    """Return what a reader of the responses should know of the records they come from."""
    findings = []
    slowest = max(record.dt for record in records)
    if 1.0 / slowest < FOLDING:
        findings.append(
            warning(
                "not-logged",
                f"The rate loop was logged at {1.0 / slowest:.0f} Hz: what happens above {0.5 / slowest:.0f} Hz folds "
                "into the frequencies below.",
                _sentence(Need.FAST_RATES, logs[0]) if logs else "",
                what="fast rates",
                rate_hz=1.0 / slowest,
            )
        )
    for log in logs:
        if log.tables.motors is None or not len(log.tables.motors):
            unknown = "RCOU" in log.messages and not log.vehicle.motors
            findings.append(
                info(
                    "not-logged",
                    f"{log.path.name} {'does not tell which outputs are motors' if unknown else 'has no motor outputs'}"
                    ": whether motors were at their limits, which makes gains "
                    "too small, is not known.",
                    "Log parameters (FRAME_CLASS)." if unknown else _sentence(Need.MOTORS, log),
                )
            )
            continue
        share = share_at_limits(log, records)
        if share > _SATURATED:
            findings.append(
                warning(
                    "motors-at-limits",
                    f"In {100.0 * share:.0f} % of the samples of {log.path.name} a motor was at a limit, where it "
                    "gives less than the controller asks for: gains are too small.",
                    "Use a smaller SID_MAGNITUDE, or fly with less weight.",
                    share=share,
                )
            )
    return findings


def reversed_answer(frf: FrequencyResponse) -> list[Finding]:
    """Report that an axis turns against its command, which no craft that flies does; nothing where it does not."""
    hz, answer = frf.hz[frf.usable], frf.response[frf.usable]
    slow = slice(None, max(len(hz) // 3, 1))  # delays have not turned it yet
    if len(hz) < 8 or not np.median((answer[slow] * 2j * np.pi * hz[slow]).real) < 0.0:
        return []
    return [
        Finding(
            "motor-order",
            Severity.ERROR,
            f"The {frf.axis} rate turns against the {frf.axis} output: a craft that flies cannot do that.",
            "Check the sign of the rate, and which axis it is of.",
            {"axis": frf.axis},
        )
    ]


def share_at_limits(log: FlightLog, records: Sequence[AxisRecord]) -> float:
    """Return the part of a log's records in which a motor was at its lowest or highest output."""
    motors = log.tables.motors
    if motors is None:
        return 0.0
    t = motors.index.to_numpy(np.float64)
    within = np.zeros(len(t), dtype=bool)
    for record in records:
        if record.name.startswith(log.path.name):
            within |= (t >= record.start) & (t <= record.start + record.duration)
    if not within.any():
        return 0.0
    values = motors.to_numpy(np.float64)[within]
    lowest, highest = (motor_pwm(command, log.vehicle) for command in (0.0, 1.0))
    with np.errstate(invalid="ignore"):
        limited = (values <= lowest + _AT_LIMIT) | (values >= highest - _AT_LIMIT)
    return float(np.mean(limited.any(axis=1)))


def _sentence(need: Need, log: FlightLog) -> str:
    clause = bit_to_set(need, log)
    return f"{clause[0].upper()}{clause[1:]}."
