"""What can be wrong with a simulation: its parameters, or where they lead."""

import math
from collections.abc import Sequence

from logparse import RotoridError


class ParameterError(RotoridError):
    """A vehicle, mission, place or setting that cannot exist; the message says which number and why."""


class ArrivalError(RotoridError):
    """The simulated craft did not reach its target; the message says how far it came."""


class DivergenceError(RotoridError):
    """The simulated craft left every sensible state; the message says when and in which state."""


def require_positive(part: str, parameters: object, names: Sequence[str]) -> None:
    """Check that attributes of a part of the craft are positive and finite."""
    for name in names:
        value = getattr(parameters, name)
        if not (math.isfinite(value) and value > 0.0):
            raise ParameterError(f"{part}: {name} must be positive, not {value:g}")
