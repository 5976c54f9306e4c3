"""Whether motors turn the craft as their places say, or would in another order."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from core.findings import Finding, Severity
from logparse.foreign.columns import ColumnMap
from logparse.foreign.differences import mean_over

Floats = npt.NDArray[np.float64]

#: Part of the changes of rates that motors must explain to show their order, and what part of the best order's the one
#: declared must explain.
_TURNING, _BEHIND = 0.15, 0.6

#: Most motors whose orders are all tried.
_MOST_ORDERED = 4


def contradicted_order(declared: ColumnMap, rates: Floats, motors: Floats, dt: float) -> list[str]:
    """Explain that the motors do not turn the craft as their places say, where another order of the columns fits.

    Changes of the rates over a time are compared with the moments of the motors over it, for every order.
    """
    found = _orders(declared, rates, motors, dt)
    if found is None or found.best < _TURNING or found.own > _BEHIND * found.best:
        return []
    return [
        f"columns {', '.join(declared.motors.columns)}: the motors do not turn the craft as their places say (they "
        f"explain {100 * found.own:.0f} % of the changes of roll and pitch rate); in the order {found.names} they "
        f"would ({100 * found.best:.0f} %)"
    ]


def unchecked_order(declared: ColumnMap, rates: Floats, motors: Floats, dt: float) -> list[Finding]:
    """Explain that a flight does not show the order of its motors: it turns too little, or another fits better."""
    names = ", ".join(declared.motors.columns)
    found = _orders(declared, rates, motors, dt)
    if found is not None and found.best >= _TURNING:
        if found.best == found.own:
            return []
        return [
            Finding(
                "table-doubtful",
                Severity.WARNING,
                f"columns {names}: in the order {found.names} the motors would turn the craft better (they would "
                f"explain {100 * found.best:.0f} % of the changes of roll and pitch rate, in the order declared "
                f"{100 * found.own:.0f} %)",
                "check the order and the places of the motors; wrong ones show as gains of the wrong sign",
                {"column": names, "own": found.own, "best": found.best},
            )
        ]
    return [
        Finding(
            "table-doubtful",
            Severity.INFO,
            f"columns {names}: "
            + (
                f"the order of {count} motors is not held against the turns, as there are too many orders to try"
                if (count := len(declared.motors.motors)) > _MOST_ORDERED
                else "this record turns too little to show whether the motors stand in the order declared"
            ),
            "check the order on a record with brisk turns; wrong orders show as gains of the wrong sign",
            {"column": names},
        )
    ]


@dataclass(frozen=True, slots=True)
class _Orders:
    """How well the motors explain the changes of roll and pitch rate."""

    own: float  #: Part explained in the order declared.
    best: float  #: In the order that explains most.
    names: str  #: Columns in that order.


def _orders(declared: ColumnMap, rates: Floats, motors: Floats, dt: float) -> _Orders | None:
    """Try the motors in every order; None for more or fewer than three or four, and for short records."""
    count = len(declared.motors.motors)
    if not 3 <= count <= _MOST_ORDERED or len(motors) < 200:
        return None
    levers, strengths = _levers(declared, motors)
    explained = {
        order: _explained(rates, strengths[:, order], levers, dt) for order in itertools.permutations(range(count))
    }
    best = max(explained, key=lambda order: explained[order])
    names = ", ".join(declared.motors.columns[k] for k in best)
    return _Orders(explained[tuple(range(count))], explained[best], names)


def _levers(declared: ColumnMap, motors: Floats) -> tuple[Floats, Floats]:
    """Levers of the motors, (m, 3), and their strengths over the mean, (N, m)."""
    strengths = motors**2 if declared.motors.quantity not in {"pwm", "command"} else motors
    levers = np.array([[-np.sin(m.angle), np.cos(m.angle), -float(m.spin)] for m in declared.motors.motors])
    return levers, np.asarray(strengths / max(float(np.mean(strengths)), 1e-12))


def _explained(rates: Floats, strengths: Floats, levers: Floats, dt: float) -> float:
    """Part of the changes of roll and pitch rates that the moments explain with gains of the right sign."""
    width = max(round(0.1 / dt), 2)
    parts: list[float] = []
    for axis in range(2):
        moment = strengths @ levers[:, axis]
        change = rates[width:, axis] - rates[:-width, axis]
        turned = mean_over(rates[:, axis : axis + 1], width)[:, 0]
        best = 0.0
        for late in _delays(dt):
            moved = np.roll(moment, late)
            total = mean_over(moved[:, None], width)[:, 0]
            x = np.column_stack([total, turned, np.ones(len(total))])
            solution, *_ = np.linalg.lstsq(x, change, rcond=None)
            if solution[0] <= 0.0:
                continue
            without = x[:, 1:] @ np.linalg.lstsq(x[:, 1:], change, rcond=None)[0]
            left, base = np.sum((change - x @ solution) ** 2), np.sum((change - without) ** 2)
            best = max(best, 1.0 - float(left / max(base, 1e-300)))
        parts.append(best)
    return float(np.mean(parts))


def _delays(dt: float) -> Iterable[int]:
    return sorted({round(late / dt) for late in (0.0, 0.02, 0.04, 0.08)})
