"""Verdicts on a log, a trajectory or a fit, as values: never a print, never a silent drop."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum


class Severity(StrEnum):
    """How much a finding matters to the models that come out."""

    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


#: For sorting.
WORST_FIRST = (Severity.ERROR, Severity.WARNING, Severity.INFO)


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that a reader of the result should know."""

    id: str  #: Stable kebab-case name, such as ``"truncated-tail"``.
    severity: Severity  #: How much it matters.
    reason: str  #: What was found, in a sentence for the person who must act.
    advice: str = ""  #: What to do about it; empty when there is nothing to do.
    #: The numbers behind the reason (byte offsets, counts, seconds).
    evidence: Mapping[str, str | int | float | bool | None] = field(default_factory=dict)
