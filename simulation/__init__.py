"""Simulation: vehicles with known truth, flown, sensed and logged.

World axes NED, body axes FRD, SI units and radians; `t` in seconds from the start of the simulation, which a log
shifts to its boot clock. All noise comes from one seed, and a seed gives the same log, to the last bit, on
any Linux machine with an x86-64 processor; elsewhere another mathematical library may round differently.
"""

from simulation.cases import CASES, Case, find, write_case, write_sample_logs
from simulation.errors import ArrivalError, DivergenceError, ParameterError
from simulation.fly import Flight, Setup, fly, propagate

__all__ = [
    "CASES",
    "ArrivalError",
    "Case",
    "DivergenceError",
    "Flight",
    "ParameterError",
    "Setup",
    "find",
    "fly",
    "propagate",
    "write_case",
    "write_sample_logs",
]
