"""Pipeline: one log to the result of its flights, a folder to the result of a fleet.

Names are imported when they are first used, so that ``rotorid --help`` need not load the numerical packages.
"""

from typing import TYPE_CHECKING

from core.lazy import exports

if TYPE_CHECKING:
    from pipeline.config import AnalysisConfig, ConfigError
    from pipeline.fleet.analysis import analyze_fleet
    from pipeline.fleet.result import FleetResult
    from pipeline.flight.analysis import analyze, analyze_flights
    from pipeline.results.craft import GroupResult
    from pipeline.results.failure import Failure
    from pipeline.results.fleet import LogFailure
    from pipeline.results.flight import FlightResult, LogFacts, ModelResult, Prediction
    from pipeline.results.span import Span

__all__ = [
    "AnalysisConfig",
    "ConfigError",
    "Failure",
    "FleetResult",
    "FlightResult",
    "GroupResult",
    "LogFacts",
    "LogFailure",
    "ModelResult",
    "Prediction",
    "Span",
    "analyze",
    "analyze_fleet",
    "analyze_flights",
]

__getattr__, __dir__ = exports(__name__, __file__)
