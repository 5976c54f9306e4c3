"""What several methods agree on, of one parameter that all of them found from the same flights.

Methods share the flight, and most of them the curve in the parameters: what it does to one it does to the others, so
that only what it does differently counts when they are compared. What is left must explain their differences; else at
least one of them is wrong by more than it knows, and no average of them is right.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from core.quantity import uncertain
from logparse import Finding, Severity

#: Methods that may be the headline, the ones trusted most first. Left out is the mean of instants, which noise biases.
TRUSTED = ("rigid body", "Refinement 2020, stacked", "Kim 2017", "mean thrust")


@dataclass(frozen=True, slots=True)
class Statement:
    """What a method states of a parameter: value, standard error, and its part from the curve that others share."""

    method: str
    value: float
    sigma: float
    curve: float = 0.0

    @property
    def own(self) -> float:
        """Standard error without the part that others share."""
        return float(np.sqrt(max(self.sigma**2 - self.curve**2, 0.0)))


@dataclass(frozen=True, slots=True)
class Consensus:
    """The value that counts, its standard error, the surest method, and the methods that disagree with it."""

    value: float
    sigma: float
    method: str
    against: tuple[str, ...]


def consensus(statements: Sequence[Statement]) -> Consensus | None:
    """Choose the surest method that at least half of the others agree with; None without a trusted method.

    Where methods disagree, the standard error covers them: half of the distance between the farthest.
    """
    ranked = sorted(
        (statement for statement in statements if statement.method in TRUSTED), key=lambda statement: statement.sigma
    )
    if not ranked:
        return None
    against = [[other for other in ranked if _apart(statement, other)] for statement in ranked]
    place = next((k for k, others in enumerate(against) if 2 * len(others) <= len(ranked) - 1), 0)
    chosen, sigma = ranked[place], ranked[place].sigma
    if any(against):
        values = [statement.value for statement in ranked]
        sigma = float(np.hypot(sigma, 0.5 * (max(values) - min(values))))
    return Consensus(chosen.value, sigma, chosen.method, tuple(statement.method for statement in against[place]))


def disagreement(statements: Mapping[str, Sequence[Statement]]) -> Finding | None:
    """Return a finding that names the parameters on which trusted methods disagree, with their values."""
    disputed = []
    for parameter, stated in statements.items():
        ranked = [statement for statement in stated if statement.method in TRUSTED]
        if any(_apart(one, other) for one in ranked for other in ranked):
            values = ", ".join(
                f"{statement.method} {uncertain(statement.value, statement.own)}" for statement in ranked
            )
            disputed.append((parameter, values))
    if not disputed:
        return None
    return Finding(
        "methods-disagree",
        Severity.WARNING,
        "methods find different values from the same flights: "
        + "; ".join(f"{parameter}: {values}" for parameter, values in disputed)
        + "; their standard errors, without what they share, do not explain it",
        "trust none of them further than they differ; look at wind, motor outputs and battery of the flight, or weigh "
        "and measure on a bench",
        {"parameters": ", ".join(parameter for parameter, _ in disputed)},
    )


def _apart(one: Statement, other: Statement) -> bool:
    """Return whether two statements differ by more than three standard errors."""
    # Of a curve that only one of the two uses, the error is that one's alone.
    parts = one.own, other.own, one.curve - other.curve
    return abs(one.value - other.value) > 3.0 * float(np.linalg.norm(parts))
