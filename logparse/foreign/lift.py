"""Whether thrust changes as much as the motors say: units of the vertical axis and of motors show in nothing else."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation

from core.findings import Finding, Severity
from core.units import STANDARD_GRAVITY
from logparse.foreign.columns import ColumnMap
from logparse.foreign.differences import mean_over, slopes

Floats = npt.NDArray[np.float64]

#: Time, s, within which changes are compared: over longer ones drag takes what thrust gives, as in a steady climb.
_SPAN = 4.0

#: Correlation of thrust and motors below which they are not of one record, below which that is doubtful, and from which
#: on the size of their changes is compared: 0.6-0.99 on most real flights, 0.25 on short and rough ones.
_UNLIKE, _DOUBTFUL, _CLEAR = 0.15, 0.3, 0.4

#: Change of thrust, m/s^2, below which there is nothing to compare; and the deviations beyond which it is a knock.
_STILL, _KNOCK = 0.2, 3.0

#: Relative change of thrust for one of the mean square of rotor speeds, 1 by momentum theory (0.9-1.2 on real flights);
#: and of commands, which lie between thrust and speed, with an idle that may be declared wrong (0.4-0.7).
_BY_SPEEDS, _BY_COMMANDS = (0.6, 1.6), (0.2, 1.25)

#: Samples by which thrust may follow the motors, or telemetry of the motors the thrust.
_SHIFTS = range(-3, 13)


def specific_force(velocity: Floats, rotation: Rotation, dt: float, reach: int) -> Floats:
    """Acceleration less gravity in body axes (FRD), m/s^2, over 2 * reach samples; shape (N - 2 reach, 3)."""
    pushed = slopes(velocity, dt, reach) - np.array([0.0, 0.0, STANDARD_GRAVITY])
    return rotation[reach:-reach].apply(pushed, inverse=True)


@dataclass(frozen=True, slots=True)
class Following:
    """How thrust follows the motors."""

    likeness: float  #: Highest correlation, of all shifts.
    change: float  #: Relative change of thrust for a relative change of the motors' mean square, there.
    moved: bool  #: Whether thrust changes enough to tell.

    @property
    def unlike(self) -> bool:
        """Whether they cannot be of one record."""
        return self.moved and self.likeness < _UNLIKE


def following(pull: Floats, strength: Floats, dt: float) -> Following:
    """Compare thrust with the motors within seconds."""
    span = max(round(_SPAN / dt), 3)
    quick, driving = (_without_knocks(each - uniform_filter1d(each, span)) for each in (pull, strength))
    likeness, change = -1.0, 0.0
    for shift in _SHIFTS:
        a = quick[max(shift, 0) : len(quick) + min(shift, 0)]
        b = driving[max(-shift, 0) : len(driving) - max(shift, 0)]
        size = float(a.std() * b.std())
        alike = float(np.mean((a - a.mean()) * (b - b.mean()))) / size if size > 0.0 else 0.0
        if alike > likeness:
            likeness = alike
            change = float(a.std() / max(b.std(), 1e-300) * strength.mean() / max(pull.mean(), 1e-300))
    return Following(likeness, change, len(pull) > span and float(quick.std()) > _STILL)


def _without_knocks(values: Floats) -> Floats:
    """Limit values to some robust deviations, as of a touch-down."""
    most = _KNOCK * 1.4826 * float(np.median(np.abs(values)))
    return np.clip(values, -most, most) if most > 0.0 else values


def check_lift(declared: ColumnMap, pull: Floats, motors: Floats, width: int, dt: float) -> list[Finding]:
    """Name the columns where thrust hardly follows the motors, or changes more or less than it can with them."""
    quantity = declared.motors.quantity
    low, high = _BY_COMMANDS if quantity in {"pwm", "command"} else _BY_SPEEDS
    idle, full = declared.motors.pwm if quantity == "pwm" else (0.0, 1.0)
    found = following(pull, mean_square((motors - idle) / (full - idle), width), dt)
    likeness, change = found.likeness, found.change
    vertical = ", ".join(signal.columns[2] for signal in (declared.position, declared.velocity) if signal is not None)
    if found.moved and likeness < _DOUBTFUL:
        odd = f"hardly follows them (correlation {likeness:+.2f})"
        advice = "check that these are the motors of this record, and the noise of its motion"
    # Noise of either: the slope lies between those of the two regressions.
    elif found.moved and likeness > _CLEAR and not (likeness * change < high and change / likeness > low):
        odd = (
            f"changes {change:.2g} times as much as the squares of {quantity} do, and {low:.2g} to {high:.2g} is what "
            "rotors do"
        )
        advice = f"check the unit of {vertical} (ft for m is 3.3), and that the motors are {quantity}"
    else:
        return []
    names = ", ".join(declared.motors.columns)
    text = f"columns {names}: thrust, by the motion along {vertical}, {odd}"
    evidence: dict[str, str | int | float | bool | None] = {
        "column": vertical,
        "motors": names,
        "change": change,
        "likeness": likeness,
    }
    return [Finding("table-doubtful", Severity.WARNING, text, advice, evidence)]


def mean_square(motors: Floats, width: int) -> Floats:
    """Sum of the motors' squares, mean over `width` samples from each on; shape (N - width,)."""
    return mean_over((motors**2).sum(axis=1, keepdims=True), width)[:, 0]
