"""Result of one log: facts of the file, trajectory, models and what they are worth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import TYPE_CHECKING

from core.summary import Summarised, listed
from pipeline.config import AnalysisConfig
from pipeline.results.failure import Failure, present, reasons
from pipeline.results.span import Span

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd
    from numpy.typing import NDArray

    from estimation import Trajectory
    from logparse import Finding, Tables, Vehicle
    from pipeline.results.account import Account
    from pipeline.results.answer import Advice, Answer
    from pipeline.results.coverage import Coverage
    from pipeline.results.model import ModelReport
    from pipeline.results.rotation import RotationResult
    from pipeline.results.signals import FlightSignals
    from sysid import Experiment, Model, PhysicalParameters, ThrustModel, Validation
    from sysid.autopilot import AutopilotValue
    from sysid.rotors.steady_trims import SteadyTrims


@dataclass(frozen=True, slots=True, kw_only=True)
class LogFacts:
    """What the file is, whether or not anything could be identified from it, as report.json has it."""

    file: str  #: Its name, without its folder.
    bytes: int
    sha256: str  #: Of the file's content; names the log whatever its file is called.
    format: str  #: ``"dataflash"``, ``"dataflash-text"``, ``"tlog"``, ``"mavlink-raw"`` or ``"ulog"``.
    duration_s: float | None  #: Seconds on the boot clock that the log covers.
    start_utc: str | None  #: UTC at t = 0, ISO 8601.
    boots: int  #: Power-ups in the file.
    flights: tuple[Span, ...]  #: Airborne intervals of the power-up that the flight is of.
    #: Which flight of the file this is, 1 for the first, and how many it has; both 1 where only the longest was asked
    #: for.
    flight_number: int
    flight_count: int

    @property
    def started(self) -> datetime | None:
        """When the boot clock was at 0."""
        return None if self.start_utc is None else datetime.fromisoformat(self.start_utc)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prediction:
    """A free-run simulation beside the data it should reproduce."""

    experiment: Experiment  #: The stretch of flight: time, motor commands and measured position.
    #: shape (N, p): Position predicted from the motor commands and the initial state only, m.
    y_hat: NDArray[np.float64]
    training: bool  #: True where the model was fitted to this stretch.
    #: shape (N, p): Half the width of the band that should hold nine tenths of the errors, m, NaN where the run is not
    #: free; None for models that do not know.
    drift: NDArray[np.float64] | None = None

    @property
    def span(self) -> Span:
        """Where the stretch lies on the boot clock."""
        return Span(float(self.experiment.t[0]), float(self.experiment.t[-1]))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class ModelResult(Summarised):
    """One of several models of the same motion: what it is worth, and what exports and plots take besides."""

    report: ModelReport  #: What report.json has of it.
    model: Model | Failure
    #: On the data fitted and on those held out (column ``trained`` of its table), without the free runs, which are
    #: `predictions`; None where nothing was to be judged.
    validation: Validation | Failure | None = None
    predictions: tuple[Prediction, ...] = ()  #: Free runs over the same stretches.

    @property
    def key(self) -> str:
        """Which kind of model, as `pipeline.flight.kinds.KINDS` has it, such as ``"motors"``."""
        return self.report.key

    @property
    def title(self) -> str:
        """The kind in words, such as ``"motor PWM → position"``."""
        return self.report.title

    def summary(self) -> Mapping[str, str]:
        """Return the key facts of this result."""
        judged = present(self.validation)
        fitted = "fitted" if self.validation is None else "fitted and validated"
        summary = {"model": self.title, "is": self.report.missing or fitted}
        if judged is not None:
            summary["free-run RMSE"] = ", ".join(f"{output} {value:.3g}" for output, value in judged.average.items())
        return summary


#: In the place of what is made of all the rest.
NOT_YET = Failure("answer", "not summed up yet")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class FlightResult(Summarised):
    """One log, analysed as far as its content allows.

    A stage that could not be done leaves a `Failure` in the place of its result, that of the stage before where it
    could not even begin.
    """

    name: str  #: File name without its extension and, of several flights of a log, the number; unique within a fleet.
    log: LogFacts
    vehicle: Vehicle
    craft: str  #: Equal for logs of the same craft, see `pipeline.flight.craft.fingerprint`.
    #: Gains and filters of the autopilot's loops and its firmware, see `pipeline.flight.craft.tune_of`.
    tune: Mapping[str, str | float] = field(default_factory=dict)
    board: str | None = None  #: The autopilot's own id; None where it was not logged, or made up by a simulator.
    config: AnalysisConfig
    flight: Span | Failure  #: The analysed airborne interval.
    #: Canonical tables as logged, for plots.
    motors: pd.DataFrame | None = None
    modes: pd.DataFrame | None = None
    gps: pd.DataFrame | None = None
    tables: Tables | None = None  #: All canonical tables, for the datasets.
    trajectory: Trajectory | Failure
    #: The airborne segment at `AnalysisConfig.rate`, by the key of the kind of model that it serves.
    experiments: Mapping[str, Experiment] = field(default_factory=dict)
    #: Side by side, fitted to the first part of the flight and judged on the rest; empty without an experiment.
    models: tuple[ModelResult, ...] = ()
    thrust: ThrustModel | Failure  #: Fitted to the first part of the flight.
    parameters: PhysicalParameters | Failure  #: By every method, from the first part of the flight.
    #: How fast, how high, in which wind it flew, how it moved and how well that was logged.
    coverage: Coverage | Failure
    #: What the controller steadily asked of the motors; None where the log does not tell.
    trims: SteadyTrims | None = None
    account: Account | Failure  #: What happened, what was read, and which part of the flight serves models.
    signals: FlightSignals | Failure  #: Lines of the analysed flight for plots.
    #: How the craft turns: frequency responses, attitude following, margins of the loops; axis by axis.
    rotation: RotationResult | Failure
    answer: Answer | Failure = NOT_YET  #: What all of it comes to, by purpose.
    autopilot: tuple[AutopilotValue, ...] = ()  #: What its models and raw gyro propose to the autopilot, or why not.
    advice: tuple[Advice, ...] = ()  #: How to log and fly better next time, most useful first.
    findings: tuple[Finding, ...] = ()  #: Of every stage, in the order of the work.
    timings: Mapping[str, float] = field(default_factory=dict)  #: Seconds spent in each stage.

    def summary(self) -> Mapping[str, str]:
        """Return the key facts of this result."""
        flown = "none" if isinstance(self.flight, Failure) else f"{self.flight.duration:.0f} s"
        return {
            "log": f"{self.name} ({self.log.format}, {self.log.duration_s or 0.0:.0f} s)",
            "flight": flown,
            "trajectory": "none" if isinstance(self.trajectory, Failure) else self.trajectory.method,
            "models": listed([model.title for model in self.models if not isinstance(model.model, Failure)]) or "none",
            "findings": listed(list(dict.fromkeys(finding.id for finding in self.findings))) or "none",
            "missing": "; ".join(f"{stage}: {reason}" for stage, reason in self.missing.items()) or "nothing",
        }

    @property
    def experiment(self) -> Experiment | Failure:
        """The airborne segment, with the inputs of the first kind of model that it can serve."""
        for experiment in self.experiments.values():
            return experiment
        needed = (self.flight, self.trajectory, self.thrust)
        reasons_given = (failure.reason for failure in needed if isinstance(failure, Failure))
        return Failure("experiment", next(reasons_given, "no kind of model was asked for"))

    @property
    def missing(self) -> Mapping[str, str]:
        """Why there is no flight, trajectory and the like, by the stage that failed; a model says so itself."""
        return reasons(
            self.flight,
            self.account,
            self.rotation,
            self.trajectory,
            self.experiment,
            self.thrust,
            self.parameters,
            self.coverage,
            self.answer,
        )

    @property
    def position_known(self) -> bool:
        """Whether there is a horizontal position, and not only what inertial navigation without GPS drifted to."""
        if isinstance(self.trajectory, Failure):
            return False
        span = present(self.flight)
        t = self.trajectory.states.index
        start, stop = (t[0], t[-1]) if span is None else (span.start, span.stop)
        return not self.trajectory.unknown_position(start, stop)
