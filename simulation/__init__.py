"""Simulation: vehicles with known truth, flown, sensed and logged.

World axes NED, body axes FRD, SI units and radians; `t` in seconds from the start of the simulation, which a log
shifts to its boot clock. All noise comes from one seed, and a seed gives the same log, to the last bit, on
any Linux machine with an x86-64 processor; elsewhere another mathematical library may round differently.
"""

from simulation.cases import CASES, GROUPS, Case, find
from simulation.cases import parse as parse_settings
from simulation.cases import read as read_settings
from simulation.errors import ArrivalError, DivergenceError, ParameterError
from simulation.fly import Setup, SimulatedFlight, fly, propagate
from simulation.outcome import CaseOutcome, write
from simulation.sample_logs import FLIGHTS, write_sample_logs

__all__ = [
    "CASES",
    "FLIGHTS",
    "GROUPS",
    "ArrivalError",
    "Case",
    "CaseOutcome",
    "DivergenceError",
    "ParameterError",
    "Setup",
    "SimulatedFlight",
    "find",
    "fly",
    "parse_settings",
    "propagate",
    "read_settings",
    "write",
    "write_sample_logs",
]
