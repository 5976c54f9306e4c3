"""The stages of one analysis: each is timed, reports its progress, and may fail without taking the others along."""

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import accumulate
from time import perf_counter
from types import MappingProxyType
from typing import TypeVar

from logparse import Finding, RotoridError, Severity
from pipeline.execution.memory import trim_heap
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
        "health": Stage("checking the log", 0.01),
        "flight": Stage("looking for the flight", 0.0),
        "rotation": Stage("measuring how the craft turns", 0.05),
        "loops": Stage("looking at the control loops", 0.0),
        "trajectory": Stage("reconstructing the trajectory", 0.08),
        "experiment": Stage("resampling commands and motion", 0.02),
        "thrust": Stage("fitting thrust", 0.01),
        "orders": Stage("scanning numbers of poles and zeros", 0.0),
        "validation": Stage("judging models on unseen flight", 0.0),
        "motors": Stage("fitting transfer functions from motor PWM", 0.34),
        "mixer": Stage("fitting transfer functions from mixer commands", 0.18),
        "reference": Stage("fitting transfer functions from the position target", 0.05),
        "rigid_body": Stage("fitting the rigid body", 0.09),
        "parameters": Stage("comparing physical parameters", 0.03),
        "coverage": Stage("counting out what was flown", 0.02),
        "drift": Stage("following parameters over flights", 0.0),
        "advice": Stage("gathering advice", 0.0),
        "answer": Stage("summing up", 0.01),
        "report": Stage("writing the report", 0.07),
    }
)


#: Reported before the stages of each flight of a log, with the part of the whole that the flight takes.
NEXT_FLIGHT = "next flight"


def overall(progress: Progress) -> Progress:
    """Turn a stage's name and the fraction of it that is done into its title and the fraction of the whole."""
    begins = dict(zip(STAGES, accumulate((stage.share for stage in STAGES.values()), initial=0.0), strict=False))
    begun, share, furthest = 0.0, 0.0, 0.0

    def report(name: str, fraction: float) -> None:
        nonlocal begun, share, furthest
        if name == NEXT_FLIGHT:
            begun, share = begun + share, fraction
            return
        # Some stages come once for every kind of model; the bar must not go back for them.
        furthest = max(furthest, begun + (share or 1.0) * (begins[name] + STAGES[name].share * fraction))
        progress(STAGES[name].title, furthest)

    return report


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
