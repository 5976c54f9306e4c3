"""Motors that gave less thrust than their outputs asked for."""

from __future__ import annotations

from collections.abc import Iterator

from core.catalogue import finding
from core.findings import Happening, Severity
from logparse import MissingDataError
from pipeline.flight.account.readings import Readings
from sysid.rotors.motor_faults import MotorFault, find_motor_faults

#: Part of the thrust above which a motor that fails is said to have lost all of it.
_ALL = 0.95


def motor_happenings(readings: Readings, until: float) -> Iterator[Happening]:
    """Yield motors at fault before `until`, the first blow or touch-down; none where frame or outputs are missing."""
    try:
        faults = find_motor_faults(readings.tables, readings.vehicle, readings.flight.start, until)
    except MissingDataError:
        return
    for fault in faults:
        again = sum(other.motor == fault.motor and other.kind == "pulse" for other in faults)
        yield finding(
            "motor-fault",
            f"{_sentence(fault, again)}: {fault.evidence}.",
            severity=Severity.WARNING if fault.kind == "pulse" else Severity.ERROR,
            advice=f"Inspect motor {fault.motor}, its propeller, ESC and joints.",
            t=fault.t,
            end=fault.end,
            motor=fault.motor,
            kind=fault.kind,
            thrust_loss=fault.loss,
            thrust_loss_sigma=fault.sigma,
            output_loss=1.0 - fault.output,
        )


def _sentence(fault: MotorFault, again: int) -> str:
    others = f" (or {', '.join(map(str, fault.alternatives))})" if fault.alternatives else ""
    thrust = f"{100.0 * fault.loss:.0f} ± {max(100.0 * fault.sigma, 1.0):.0f} % of its thrust"
    if fault.kind == "pulse":
        times = f", one of {again} times" if again > 1 else ""
        return f"Motor {fault.motor} lacked {thrust} for {fault.end - fault.t:.1f} s{times}"
    if fault.loss > _ALL:
        return f"Motor {fault.motor}{others} lost all its thrust"
    output = f" ({100.0 * (1.0 - fault.output):.0f} % of its output)" if fault.kind == "step" else ""
    return f"Motor {fault.motor}{others} lost {thrust}{output}"
