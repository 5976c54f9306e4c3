"""The stages of one analysis: each is timed, reports its progress, and may fail without taking the others along."""

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import takewhile
from time import perf_counter
from types import MappingProxyType
from typing import TypeVar

from logparse import Finding, RotoridError, Severity
from pipeline.execution.machine import trim_heap
from pipeline.results.failure import Failure

Progress = Callable[[str, float], None]
T = TypeVar("T")

_LOG = logging.getLogger("rotorid.pipeline")
# Tracebacks of our bugs are for whoever sets up logging; without that they must not reach the user's terminal.
logging.getLogger("rotorid").addHandler(logging.NullHandler())


@dataclass(frozen=True, slots=True)
class Stage:
    """What a stage is called for people, and the part of one log's analysis that it usually takes."""

    title: str
    share: float


#: In the order of the work, as parts of the time that flights with models took. Stages that come once for every kind of
#: model count with the kinds and stand before them: the bar must not jump for them. The last is done by whoever asked.
STAGES: Mapping[str, Stage] = MappingProxyType(
    {
        "read": Stage("reading the log", 0.02),
        "tables": Stage("decoding messages", 0.02),
        "account": Stage("telling what happened", 0.01),
        "flight": Stage("looking for the flight", 0.0),
        "rotation": Stage("measuring how the craft turns", 0.05),
        "trajectory": Stage("reconstructing the trajectory", 0.08),
        "experiment": Stage("resampling commands and motion", 0.02),
        "thrust": Stage("fitting thrust", 0.01),
        "orders": Stage("scanning numbers of poles and zeros", 0.0),
        "validation": Stage("validating models on held-out flight", 0.0),
        "motors": Stage("fitting transfer functions from motor PWM", 0.34),
        "mixer": Stage("fitting transfer functions from mixer commands", 0.18),
        "reference": Stage("fitting transfer functions from the position target", 0.05),
        "rigid_body": Stage("fitting the rigid body", 0.09),
        "parameters": Stage("comparing physical parameters", 0.03),
        "coverage": Stage("measuring what was flown", 0.02),
        "drift": Stage("following parameters over flights", 0.0),
        "advice": Stage("gathering advice", 0.0),
        "answer": Stage("summing up", 0.01),
        "report": Stage("writing the report", 0.07),
    }
)


#: Seconds of each stage of a log of which nothing is known yet.
_GUESS = {name: 4.0 * stage.share for name, stage in STAGES.items()}

#: Reported before the stages of each flight of a log, with the part of the whole that the flight takes.
NEXT_FLIGHT = "next flight"


class Overall:
    """Turns a stage's name and the fraction of it that is done into its title and the fraction of the whole.

    The fraction is that of the seconds expected. Until somebody says how long the stages of a log will take, their
    usual shares count. `loaded` are seconds that were spent before, on loading packages.
    """

    def __init__(self, progress: Progress, loaded: float = 0.0) -> None:
        self._progress, self._loaded = progress, loaded
        self._begun = self._part = self._furthest = self._done = 0.0
        self._expected: Mapping[str, float] = _GUESS

    def expect(self, seconds: Mapping[str, float]) -> None:
        """Set the seconds expected of each stage of this flight; only their ratios count."""
        self._expected = seconds

    def __call__(self, name: str, fraction: float) -> None:
        """Note progress within a stage."""
        expected = self._expected
        if name == NEXT_FLIGHT:
            self._loaded = 0.0 if self._part else self._loaded
            self._begun, self._part = self._begun + self._part, fraction
            self._expected, self._done = _GUESS, 0.0
            return
        before = sum(expected.get(each, 0.0) for each in takewhile(lambda each: each != name, STAGES))
        self._done = max(self._done, before + expected.get(name, 0.0) * fraction)
        within = (self._loaded + self._done) / (self._loaded + max(sum(expected.values()), self._done))
        # Some stages come once for every kind of model; the bar must not go back for them.
        self._furthest = max(self._furthest, self._begun + (self._part or 1.0) * within)
        self._progress(STAGES[name].title, self._furthest)


class OutOfTimeError(RotoridError):
    """A stage took longer than it may; raised from inside its own progress reports."""


def silent(stage: str, fraction: float) -> None:
    """Report progress to nobody."""


@dataclass(slots=True)
class Stages:
    """Runs stages in order and keeps what they had to say."""

    progress: Progress  #: Told the stage's name and how much of it is done, 0 to 1.
    time_limit: float  #: Seconds that one stage may take, as far as it reports progress.
    timings: dict[str, float] = field(default_factory=dict)  #: Seconds, by stage.
    findings: list[Finding] = field(default_factory=list)
    unforeseen: dict[str, Exception] = field(default_factory=dict)  #: Bug met, by stage.

    def take(self, other: "Stages") -> None:
        """Add times and findings of stages that ran in another process."""
        for name, seconds in other.timings.items():
            self.timings[name] = self.timings.get(name, 0.0) + seconds
        self.findings += other.findings

    def raise_unforeseen(self, *names: str) -> None:
        """Raise the error that nobody foresaw in one of these stages, if any: no log is to be blamed for a bug."""
        for name in names:
            if name in self.unforeseen:
                raise self.unforeseen[name]

    def run(self, name: str, work: Callable[[Progress], T]) -> T | Failure:
        """Do `work`, or return why it cannot be done.

        An error that nobody foresaw is a bug in rotorid, but it must not cost the user what the other stages found:
        it is logged with its traceback and becomes a finding.
        """
        start = perf_counter()
        deadline = start + self.time_limit

        def report(_: str, fraction: float) -> None:
            self.progress(name, fraction)
            if perf_counter() > deadline:
                # Two digits of a short limit: "given up after 0 s" would help nobody.
                limit = f"{self.time_limit:.0f}" if self.time_limit >= 10.0 else f"{self.time_limit:.2g}"
                raise OutOfTimeError(f"given up after {limit} s; allow more with --time-limit, or fit fewer poles")

        try:
            self.progress(name, 0.0)
            result = work(report)
        except RotoridError as error:
            return Failure(name, str(error))
        except Exception as error:
            _LOG.exception("unexpected error in stage %s", name)
            what = f"{type(error).__name__}: {error}"
            self.unforeseen[name] = error
            self.findings.append(
                Finding(
                    id="internal-error",
                    severity=Severity.ERROR,
                    reason=f"Stage “{name}” failed in a way that rotorid did not foresee ({what}).",
                    advice="This is a bug in rotorid, not in your log; report it together with the log.",
                )
            )
            return Failure(name, f"unexpected {what}")
        else:
            self.progress(name, 1.0)
            return result
        finally:
            trim_heap()
            self.timings[name] = self.timings.get(name, 0.0) + perf_counter() - start
