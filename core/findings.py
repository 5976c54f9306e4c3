"""Verdicts on a log, a flight, a trajectory or a fit, as values: never a print, never a silent drop."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum


class Severity(StrEnum):
    """How much a finding matters."""

    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


_NUMBER = re.compile(r"\d+(\.\d+)?")

#: For sorting.
WORST_FIRST = (Severity.ERROR, Severity.WARNING, Severity.INFO)


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that a reader of the result should know."""

    id: str  #: Stable kebab-case name, such as ``"file-end"``; docs/findings.md explains each.
    #: INFO for what a healthy flight has too, WARNING for what should be looked into, ERROR for what endangers.
    severity: Severity
    reason: str  #: What was found, in a sentence for the person who must act.
    advice: str = ""  #: What to do about it; empty when there is nothing to do.
    #: The numbers behind the reason (byte offsets, counts, seconds), SI units unless the name says otherwise.
    evidence: Mapping[str, str | int | float | bool | None] = field(default_factory=dict)
    #: First and last moment of what happened in a flight, s on the log's boot clock; None for what has no time.
    t: float | None = None
    end: float | None = None

    @property
    def notable(self) -> bool:
        """Whether a healthy flight has no such finding."""
        return self.severity is not Severity.INFO


def info(identifier: str, reason: str, advice: str = "", **evidence: str | int | float | bool | None) -> Finding:
    """Make a finding that a healthy log has too."""
    return Finding(identifier, Severity.INFO, reason, advice, evidence)


def warning(identifier: str, reason: str, advice: str = "", **evidence: str | int | float | bool | None) -> Finding:
    """Make a finding that should be looked into."""
    return Finding(identifier, Severity.WARNING, reason, advice, evidence)


def once(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return what differs in numbers only once, in order: the first keeps its words and gains a `count`."""
    alike: dict[tuple[str, str], list[Finding]] = {}
    for finding in findings:
        alike.setdefault((finding.id, _NUMBER.sub("", finding.reason)), []).append(finding)
    return tuple(first if not more else _counted(first, len(more)) for first, *more in alike.values())


def _counted(first: Finding, more: int) -> Finding:
    again = f"{first.reason.rstrip('.')}; {more} more such."
    return replace(first, reason=again, evidence={**first.evidence, "count": 1 + more})
