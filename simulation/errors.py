"""What can be wrong with a simulation: its parameters, or where they lead."""

from logparse import RotoridError


class ParameterError(RotoridError):
    """A vehicle, mission, place or setting that cannot exist; the message says which number and why."""


class ArrivalError(RotoridError):
    """The simulated craft did not reach its target; the message says how far it came."""


class DivergenceError(RotoridError):
    """The simulated craft left every sensible state; the message says when and in which state."""
