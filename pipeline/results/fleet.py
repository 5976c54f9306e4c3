"""Results over several logs: which train and which judge, a craft identified jointly, and logs that gave nothing."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

from core.summary import Summarised, listed
from pipeline.names import file_name
from pipeline.results.failure import Failure, reasons

if TYPE_CHECKING:
    from logparse import Finding, Vehicle
    from pipeline.results.answer import Advice
    from pipeline.results.coverage import Envelope
    from pipeline.results.drift import Drift
    from pipeline.results.flight import FlightResult, ModelResult
    from sysid import PhysicalParameters, ThrustModel
    from sysid.autopilot import AutopilotValues


@dataclass(frozen=True, slots=True)
class LogFailure:
    """A log that gave nothing, and why, in a sentence for the person who has the log."""

    source: str  #: Path or URL.
    reason: str
    lasting: bool = False  #: It would be the same again with the same log, settings and software.
    full: bool = False  #: Nothing more can be stored.

    @property
    def file(self) -> str:
        """The file's name, without its folder, as text that can be shown."""
        return file_name(self.source)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class GroupResult(Summarised):
    """All flights of one craft, identified jointly."""

    name: str  #: The craft in words, such as ``"octa x, ArduCopter"``.
    vehicle: Vehicle
    #: Names of the flights fitted and of those kept to judge.
    training: tuple[str, ...]
    held_out: tuple[str, ...]
    split: str  #: How the two were chosen, in a sentence.
    models: tuple[ModelResult, ...] = ()  #: Side by side, fitted to the training flights and judged on the others.
    thrust: ThrustModel | Failure
    parameters: PhysicalParameters | Failure  #: By every method, from the training flights.
    #: What the flights covered, and where those that judge leave the range of those fitted.
    coverage: Envelope | Failure | None
    drift: Drift | Failure | None  #: The craft's parameters from flight to flight.
    autopilot: AutopilotValues | None = None  #: What the flights propose to the autopilot; None of nothing.
    advice: tuple[Advice, ...] = ()  #: How to log and fly better next time, most useful first.
    findings: tuple[Finding, ...] = ()
    timings: Mapping[str, float] = field(default_factory=dict)  #: Seconds spent in each stage.

    def summary(self) -> Mapping[str, str]:
        """Return the few facts by which a reader knows this result."""
        return {
            "craft": self.name,
            "training": listed(self.training),
            "held out": listed(self.held_out),
            "models": listed([each.title for each in self.models if not isinstance(each.model, Failure)]) or "none",
        }

    @property
    def missing(self) -> Mapping[str, str]:
        """Why there is no thrust and the like, by the stage that failed; a model says so itself."""
        return reasons(self.thrust, self.parameters, self.coverage, self.drift)


#: ``publish(result, folder)`` writes what people and programs read of a result. Without a result it draws the pages of
#: a folder anew, or raises FileNotFoundError where the folder does not hold what that takes.
Publish = Callable[["FlightResult | GroupResult | None", Path], object]


class Exclusion(StrEnum):
    """Why a flight is excluded from training."""

    POSITION_UNKNOWN = "position-unknown"
    POSITION_POOR = "position-poor"
    EXCITATION_UNKNOWN = "excitation-unknown"
    LITTLE_EXCITATION = "little-excitation"


@dataclass(frozen=True, slots=True)
class TrainingExclusion:
    """A flight that must not train: the kind of reason, and the reason with its numbers, as a clause."""

    exclusion: Exclusion
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Split:
    """Names of flights that train and that judge, in order of name."""

    training: tuple[str, ...]
    held_out: tuple[str, ...]
    judging: tuple[str, ...]  #: Those held out that models are judged on.
    unused: Mapping[str, str] = field(default_factory=dict)  #: Flights that do neither, and why.
    never_train: Mapping[str, TrainingExclusion] = field(default_factory=dict)  #: Flights that judge only, and why.
    sentence: str = ""  #: How the two were chosen, with the numbers.
