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

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pipeline.config import AnalysisConfig
    from rotorid import fit, plot
    from rotorid.analysis import Craft, Fleet, analyze, compare
    from rotorid.flight_log import FlightLog, load
    from rotorid.simulated_flight import simulate
    from rotorid.validation import Comparison, validate
    from sysid import frequency, loops
    from sysid.loops import prove, tune
    from sysid.records.experiment import Experiment

#: Where each name lives; None for a module of its own.
_HOME = {
    "AnalysisConfig": ("pipeline.config", "AnalysisConfig"),
    "Comparison": ("rotorid.validation", "Comparison"),
    "Craft": ("rotorid.analysis", "Craft"),
    "Experiment": ("sysid.records.experiment", "Experiment"),
    "Fleet": ("rotorid.analysis", "Fleet"),
    "FlightLog": ("rotorid.flight_log", "FlightLog"),
    "analyze": ("rotorid.analysis", "analyze"),
    "compare": ("rotorid.analysis", "compare"),
    "fit": ("rotorid.fit", None),
    "frequency": ("sysid.frequency", None),
    "loops": ("sysid.loops", None),
    "load": ("rotorid.flight_log", "load"),
    "plot": ("rotorid.plot", None),
    "prove": ("sysid.loops", "prove"),
    "simulate": ("rotorid.simulated_flight", "simulate"),
    "tune": ("sysid.loops", "tune"),
    "validate": ("rotorid.validation", "validate"),
}

__all__ = [
    "AnalysisConfig",
    "Comparison",
    "Craft",
    "Experiment",
    "Fleet",
    "FlightLog",
    "analyze",
    "compare",
    "fit",
    "frequency",
    "load",
    "loops",
    "plot",
    "prove",
    "simulate",
    "tune",
    "validate",
]


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module 'rotorid' has no attribute {name!r}")
    module, attribute = _HOME[name]
    home = import_module(module)
    globals()[name] = value = home if attribute is None else getattr(home, attribute)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
