"""From Pixhawk/ArduPilot flight logs to identified models of the craft, and what they are worth.

::

    import rotorid as ro

    log = ro.load("FLIGHT.bin")
    data = log.experiment(rate=50.0)
    train, unseen = data.split(0.7)
    body = ro.fit.rigid_body(train, mass=1.6)
    ro.validate(body, unseen)

Every name is imported when it is first used, so that ``import rotorid`` is quick.
"""

from typing import TYPE_CHECKING

from core.lazy import exports

if TYPE_CHECKING:
    from core.errors import RotoridError
    from pipeline.config import AnalysisConfig
    from pipeline.fleet.result import Craft
    from pipeline.fleet.result import FleetResult as Fleet
    from rotorid import fit, plot
    from rotorid.analysis import analyze, compare
    from rotorid.flight_log import FlightLog, inspect, load
    from rotorid.simulated_flight import simulate
    from rotorid.validation import Comparison, validate
    from sysid import frequency, loops
    from sysid.loops import prove, tune
    from sysid.records.experiment import Experiment

__all__ = [
    "AnalysisConfig",
    "Comparison",
    "Craft",
    "Experiment",
    "Fleet",
    "FlightLog",
    "RotoridError",
    "analyze",
    "compare",
    "fit",
    "frequency",
    "inspect",
    "load",
    "loops",
    "plot",
    "prove",
    "simulate",
    "tune",
    "validate",
]


__getattr__, __dir__ = exports(__name__, __file__)
