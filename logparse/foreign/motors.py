"""Whether motor columns are the motors of this craft: their magnitudes, their lift, and their order.

Units of the vertical axis and of motors show in nothing but how thrust changes with the motors; the order of the
motors in nothing but how they turn the craft.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import uniform_filter1d

from core.findings import Finding, Severity
from core.robust import robust_sigma
from logparse.foreign.columns import ColumnMap
from logparse.foreign.consistency import ResampledMotion, alike, mean_over, ratio
from logparse.foreign.files import TableError, table_finding

Floats = npt.NDArray[np.float64]

#: Ranges that multirotors keep to: rotor speeds [rad/s], PWM [us], commands.
_SPEEDS, _PULSES, _COMMANDS = (10.0, 8000.0), (500.0, 2500.0), (-0.2, 1.3)
#: The same, narrower, of what else a value could be.
_LIKELY = {"command": (0.01, 1.3), "rad/s": (50.0, 5000.0), "pwm": (900.0, 2100.0)}

#: Part of the others' movement below which a motor hardly moves.
_QUIET = 0.1

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

#: Part of the changes of rates that motors must explain to show their order, and what part of the best order's the one
#: declared must explain; motors whose orders are all tried.
_TURNING, _BEHIND, _ORDERED = 0.15, 0.6, (3, 4)


def check_units(declared: ColumnMap, columns: Mapping[str, Floats], label: str) -> list[Finding]:
    """Compare magnitudes, by quantity in SI, with what such a craft can have; TableError for what cannot be."""
    motors, quantity = columns["motors"], declared.motors.quantity
    names = ", ".join(declared.motors.columns)
    usual = float(np.median(np.abs(motors)))
    low, high = {"pwm": _PULSES, "command": _COMMANDS}.get(quantity, _SPEEDS)
    if not low <= usual <= high or (quantity == "command" and np.max(motors) > 5.0):
        raw = usual / declared.motors.factor
        guesses = [what for what, (a, b) in _LIKELY.items() if a <= raw <= b and what != quantity] or ["rpm or erpm"]
        raise TableError(
            f"{label}: columns {names}: the usual value {raw:.4g} cannot be {quantity}; is it {' or '.join(guesses)}?"
        )
    middle, spread = np.median(motors, axis=0), motors.std(axis=0)

    def named(chosen: npt.NDArray[np.bool_]) -> str:
        return ", ".join(name for name, one in zip(declared.motors.columns, chosen, strict=True) if one)

    if quantity != "command" and (below := named(middle < 0.0)):
        raise TableError(
            f"{label}: column {below}: {quantity} is below zero; give its size, and the sense of the rotor's turning "
            "in its place"
        )
    if still := named(np.ptp(motors, axis=0) == 0.0):
        raise TableError(f"{label}: column {still}: the motor never moves; is it a motor of this craft?")
    if "rates" in columns and declared.rates is not None and (top := float(np.std(columns["rates"]))) > 40.0:
        raise TableError(
            f"{label}: columns {', '.join(declared.rates.columns)}: rates of {top:.3g} rad/s in the mean are beyond "
            "any such craft; are they in deg/s?"
        )
    unlike = named((quantity != "pwm") & ((middle < 0.5 * usual) | (middle > 2.0 * usual)))
    quiet = named(spread < _QUIET * float(np.median(spread)))
    return [
        table_finding(column, text, "check unit and column of this motor")
        for column, text in (
            (unlike, "less than half or more than twice what the other motors have"),
            (quiet, "hardly moves while the other motors do"),
        )
        if column
    ]


def _mean_square(motors: Floats, width: int) -> Floats:
    """Sum of the motors' squares, mean over `width` samples from each on; shape (N - width,)."""
    return mean_over((motors**2).sum(axis=1, keepdims=True), width)[:, 0]


def _following(pull: Floats, strength: Floats, dt: float) -> tuple[float, float, bool]:
    """Compare thrust for mass [m/s^2] with the mean square of the motors within seconds.

    Returns the highest correlation of all shifts, the relative change of thrust for one of the motors there, and
    whether thrust changes enough to tell.
    """
    span = max(round(_SPAN / dt), 3)
    if len(pull) <= span:
        return -1.0, 0.0, False
    quick, driving = (_without_knocks(values - uniform_filter1d(values, span)) for values in (pull, strength))
    likeness, change = -1.0, 0.0
    for shift in _SHIFTS:
        a = quick[max(shift, 0) : len(quick) + min(shift, 0)]
        b = driving[max(-shift, 0) : len(driving) - max(shift, 0)]
        if (found := alike(a, b)) > likeness:
            likeness, change = found, ratio(a, b) * float(strength.mean()) / max(float(pull.mean()), 1e-300)
    return likeness, change, float(quick.std()) > _STILL


def _without_knocks(values: Floats) -> Floats:
    """Limit values to some robust deviations, as of a touch-down."""
    most = _KNOCK * robust_sigma(values)
    return np.clip(values, -most, most) if most > 0.0 else values


def not_lifting(declared: ColumnMap, motion: ResampledMotion, reach: int) -> str:
    """Explain that thrust does not grow with the motors, over 2 * reach samples; empty where it does."""
    pull = -motion.specific_force(reach)[:, 2]
    likeness, _, moved = _following(pull, _mean_square(motion.motors, 2 * reach), motion.dt)
    if not moved or likeness >= _UNLIKE:
        return ""
    return (
        f"columns {', '.join(declared.motors.columns)}: thrust does not grow with the motors (correlation "
        f"{likeness:+.2f}): are they the motors of this record?"
    )


def check_lift(declared: ColumnMap, motion: ResampledMotion, reach: int) -> list[Finding]:
    """Name the columns where thrust hardly follows the motors, or changes more or less than it can with them."""
    quantity = declared.motors.quantity
    low, high = _BY_COMMANDS if quantity in {"pwm", "command"} else _BY_SPEEDS
    idle, full = declared.motors.pwm if quantity == "pwm" else (0.0, 1.0)
    strength = _mean_square((motion.motors - idle) / (full - idle), 2 * reach)
    likeness, change, moved = _following(-motion.specific_force(reach)[:, 2], strength, motion.dt)
    vertical = ", ".join(signal.columns[2] for signal in (declared.position, declared.velocity) if signal is not None)
    names = ", ".join(declared.motors.columns)
    if moved and likeness < _DOUBTFUL:
        odd = f"hardly follows {names} (correlation {likeness:+.2f})"
        advice = "check that these are the motors of this record, and the noise of its motion"
    # Noise of either: the slope lies between those of the two regressions.
    elif moved and likeness > _CLEAR and not (likeness * change < high and change / likeness > low):
        odd = (
            f"changes {change:.2g} times as much as the squares of {quantity} in {names} do, and {low:.2g} to "
            f"{high:.2g} is what rotors do"
        )
        advice = f"check the unit of {vertical} (ft for m is 3.3), and that the motors are {quantity}"
    else:
        return []
    text = f"thrust, by the motion along it, {odd}"
    return [table_finding(vertical, text, advice, motors=names, change=change, likeness=likeness)]


@dataclass(frozen=True, slots=True)
class Order:
    """How well the motors explain the changes of roll and pitch rate."""

    own: float  #: Part explained in the order declared.
    best: float  #: In the order that explains most.
    names: str  #: Columns in that order.

    @property
    def seen(self) -> bool:
        """Whether the record turns enough to show the order."""
        return self.best >= _TURNING

    @property
    def contradicted(self) -> bool:
        """Whether the order declared cannot be right."""
        return self.seen and self.own <= _BEHIND * self.best


def find_order(declared: ColumnMap, motion: ResampledMotion) -> Order | None:
    """Try the motors in every order; None for more or fewer than three or four, and for short records.

    Changes of the rates over a time are compared with the moments of the motors over it.
    """
    count, motors = len(declared.motors.motors), motion.motors
    if count not in _ORDERED or len(motors) < 200:
        return None
    strengths = motors**2 if declared.motors.quantity not in {"pwm", "command"} else motors
    strengths = strengths / max(float(np.mean(strengths)), 1e-12)
    levers = np.array([[-np.sin(m.angle), np.cos(m.angle)] for m in declared.motors.motors])
    orders = itertools.permutations(range(count))
    explained = {order: _explained(motion.rates, strengths[:, order] @ levers, motion.dt) for order in orders}
    best = max(explained, key=lambda order: explained[order])
    names = ", ".join(declared.motors.columns[k] for k in best)
    return Order(explained[tuple(range(count))], explained[best], names)


def _explained(rates: Floats, moments: Floats, dt: float) -> float:
    """Part of the changes of roll and pitch rates that the moments explain with gains of the right sign."""
    width = max(round(0.1 / dt), 2)
    parts: list[float] = []
    turned = mean_over(rates[:, :2], width)
    for axis in range(2):
        change = rates[width:, axis] - rates[:-width, axis]
        base = np.column_stack([turned[:, axis], np.ones(len(change))])
        without = float(np.sum((change - base @ np.linalg.lstsq(base, change, rcond=None)[0]) ** 2))
        best = 0.0
        for late in sorted({round(late / dt) for late in (0.0, 0.02, 0.04, 0.08)}):
            x = np.column_stack([mean_over(np.roll(moments[:, axis : axis + 1], late, axis=0), width), base])
            solution, *_ = np.linalg.lstsq(x, change, rcond=None)
            if solution[0] > 0.0:
                best = max(best, 1.0 - float(np.sum((change - x @ solution) ** 2)) / max(without, 1e-300))
        parts.append(best)
    return float(np.mean(parts))


def wrong_order(declared: ColumnMap, order: Order | None) -> str:
    """Explain that the motors do not turn the craft as their places say, where another order of the columns fits."""
    if order is None or not order.contradicted:
        return ""
    return (
        f"columns {', '.join(declared.motors.columns)}: the motors do not turn the craft as their places say (they "
        f"explain {100 * order.own:.0f} % of the changes of roll and pitch rate); in the order {order.names} they "
        f"would ({100 * order.best:.0f} %)"
    )


def unchecked_order(declared: ColumnMap, order: Order | None) -> list[Finding]:
    """Explain that a flight does not show the order of its motors: it turns too little, or another fits better."""
    names, advice = ", ".join(declared.motors.columns), "wrong orders show as gains of the wrong sign"
    if order is not None and order.seen:
        if order.best == order.own:
            return []
        text = (
            f"in the order {order.names} the motors would turn the craft better (they would explain "
            f"{100 * order.best:.0f} % of the changes of roll and pitch rate, in the order declared "
            f"{100 * order.own:.0f} %)"
        )
        advice = f"check the order and the places of the motors; {advice}"
        return [table_finding(names, text, advice, own=order.own, best=order.best)]
    count = len(declared.motors.motors)
    text = (
        f"the order of {count} motors is not held against the turns, as there are too many orders to try"
        if count > max(_ORDERED)
        else "this record turns too little to show whether the motors stand in the order declared"
    )
    advice = f"check the order on a record with brisk turns; {advice}"
    return [table_finding(names, text, advice, Severity.INFO)]
