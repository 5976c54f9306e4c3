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
from pipeline.execution.workload import Workload
from pipeline.results.failure import Failure

Progress = Callable[[str, float], None]
T = TypeVar("T")

_LOG = logging.getLogger("rotorid.pipeline")
# Tracebacks of our bugs are for whoever sets up logging; without that they must not reach the user's terminal.
logging.getLogger("rotorid").addHandler(logging.NullHandler())


#: What stages are called for people, in the order of the work; those that come once for every kind of model stand
#: before the kinds: the bar must not jump for them. The last is done by whoever asked.
STAGES: Mapping[str, str] = MappingProxyType(
    {
        "read": "reading the log",
        "tables": "decoding messages",
        "account": "telling what happened",
        "flight": "looking for the flight",
        "rotation": "measuring how the craft turns",
        "trajectory": "reconstructing the trajectory",
        "experiment": "resampling commands and motion",
        "thrust": "fitting thrust",
        "orders": "scanning numbers of poles and zeros",
        "validation": "validating models on held-out flight",
        "motors": "fitting transfer functions from motor PWM",
        "mixer": "fitting transfer functions from mixer commands",
        "reference": "fitting transfer functions from the position target",
        "rigid_body": "fitting the rigid body",
        "parameters": "comparing physical parameters",
        "coverage": "measuring what was flown",
        "drift": "following parameters over flights",
        "advice": "gathering advice",
        "answer": "summing up",
        "report": "writing the report",
    }
)

#: Reported before the stages of each flight of a log, with the part of the whole that the flight takes.
NEXT_FLIGHT = "next flight"


class Overall:
    """Turns a stage's name and the fraction of it that is done into its title and the fraction of the whole.

    The fraction is that of the seconds expected. Until somebody says what a log holds, it is taken for a usual one.
    `loaded` are seconds that were spent before, on loading packages.
    """

    def __init__(self, progress: Progress, loaded: float = 0.0) -> None:
        self._progress, self._loaded = progress, loaded
        self._begun = self._part = self._furthest = self._done = 0.0
        self._expected = Workload().seconds()

    def expect(self, seconds: dict[str, float]) -> None:
        """Set the seconds expected of each stage of this flight; only their ratios count."""
        self._expected = seconds

    def __call__(self, name: str, fraction: float) -> None:
        """Note progress within a stage."""
        expected = self._expected
        if name == NEXT_FLIGHT:
            self._loaded = 0.0 if self._part else self._loaded
            self._begun, self._part = self._begun + self._part, fraction
            self._expected, self._done = Workload().seconds(), 0.0
            return
        before = sum(expected.get(stage, 0.0) for stage in takewhile(lambda stage: stage != name, STAGES))
        self._done = max(self._done, before + expected.get(name, 0.0) * fraction)
        within = (self._loaded + self._done) / (self._loaded + max(sum(expected.values()), self._done))
        # Some stages come once for every kind of model; the bar must not go back for them.
        self._furthest = max(self._furthest, self._begun + (self._part or 1.0) * within)
        self._progress(STAGES[name], self._furthest)


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
