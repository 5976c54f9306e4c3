"""Whether the columns of a table have magnitudes that multirotors have."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from core.findings import Finding, Severity
from logparse.foreign.columns import ColumnMap
from logparse.foreign.files import TableError

Floats = npt.NDArray[np.float64]

#: Ranges that multirotors keep to: rotor speeds [rad/s], PWM [us], commands.
_SPEEDS, _PULSES, _COMMANDS = (10.0, 8000.0), (500.0, 2500.0), (-0.2, 1.3)

#: Part of the others' movement below which a motor hardly moves.
_QUIET = 0.1


def check_units(declared: ColumnMap, columns: Mapping[str, Floats], label: str) -> list[Finding]:
    """Compare magnitudes with what such a craft can have."""
    motors = columns["motors"]
    names = ", ".join(declared.motors.columns)
    usual = float(np.median(np.abs(motors)))
    low, high = {"pwm": _PULSES, "command": _COMMANDS}.get(declared.motors.quantity, _SPEEDS)
    if not low <= usual <= high or (declared.motors.quantity == "command" and np.max(motors) > 5.0):
        raw = usual / declared.motors.factor
        guesses = [
            what
            for what, (a, b) in {"command": (0.01, 1.3), "rad/s": (50.0, 5000.0), "pwm": (900.0, 2100.0)}.items()
            if a <= raw <= b and what != declared.motors.quantity
        ] or ["rpm or erpm"]
        raise TableError(
            f"{label}: columns {names}: the usual value {raw:.4g} cannot be {declared.motors.quantity}; "
            f"is it {' or '.join(guesses)}?"
        )
    below = [name for name, column in zip(declared.motors.columns, motors.T, strict=True) if np.median(column) < 0.0]
    if below and declared.motors.quantity != "command":
        raise TableError(
            f"{label}: column {', '.join(below)}: {declared.motors.quantity} is below zero; give its size, and the "
            "sense of the rotor's turning in its place"
        )
    still = [name for name, column in zip(declared.motors.columns, motors.T, strict=True) if np.ptp(column) == 0.0]
    if still:
        raise TableError(f"{label}: column {', '.join(still)}: the motor never moves; is it a motor of this craft?")
    if "rates" in columns and declared.rates is not None and (top := float(np.std(columns["rates"]))) > 40.0:
        raise TableError(
            f"{label}: columns {', '.join(declared.rates.columns)}: rates of {top:.3g} rad/s in the mean are beyond "
            "any such craft; are they in deg/s?"
        )
    spread = motors.std(axis=0)
    quiet = [
        name
        for name, own in zip(declared.motors.columns, spread, strict=True)
        if own < _QUIET * float(np.median(spread))
    ]
    unlike = [
        name
        for name, column in zip(declared.motors.columns, motors.T, strict=True)
        if declared.motors.quantity != "pwm" and not 0.5 * usual <= np.median(column) <= 2.0 * usual
    ]
    return [
        Finding(
            "table-doubtful",
            Severity.WARNING,
            f"column {', '.join(names)}: {text}",
            "check unit and column of this motor",
            {"column": ", ".join(names)},
        )
        for names, text in (
            (unlike, "less than half or more than twice what the other motors have"),
            (quiet, "hardly moves while the other motors do"),
        )
        if names
    ]
