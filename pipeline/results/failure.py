"""Why a stage gave no result: a value that stands in the place of the result."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, TypeVar

from logparse import Finding

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Failure:
    """A stage that could not be done."""

    stage: str  #: As `pipeline.execution.stages.STAGES` has it; of several that depend on one another the first.
    reason: str  #: In a sentence for the person who has the log.


def present(value: T | Failure | None) -> T | None:
    """Return a result; None where there is none."""
    return None if isinstance(value, Failure) else value


def reasons(*results: object) -> Mapping[str, str]:
    """Return the reasons of those results that are failures, by stage."""
    return {result.stage: result.reason for result in results if isinstance(result, Failure)}


class _Found(Protocol):
    @property
    def findings(self) -> tuple[Finding, ...]: ...


def findings_of(*results: _Found | Failure | None) -> tuple[Finding, ...]:
    """Return what those results that there are have found."""
    there = (result for result in results if result is not None and not isinstance(result, Failure))
    return tuple(finding for result in there for finding in result.findings)
