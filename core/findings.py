"""Verdicts on a log, a flight, a trajectory or a fit, as values: never a print, never a silent drop."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum


class Severity(StrEnum):
    """How much a finding matters."""

    INFO = "info"
    WARNING = "warning"
    ERROR = "error"

    @property
    def word(self) -> str:
        """What readers are shown."""
        return "note" if self is Severity.INFO else self.value


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
    #: What it was gathered from, where several findings are of one kind.
    parts: tuple["Finding", ...] = ()

    @property
    def notable(self) -> bool:
        """Whether a healthy flight has no such finding."""
        return self.severity is not Severity.INFO


@dataclass(frozen=True, slots=True, kw_only=True)
class Happening(Finding):
    """A finding of something that happened in a flight."""

    #: First and last moment, s on the log's boot clock.
    t: float
    end: float


def info(identifier: str, reason: str, advice: str = "", **evidence: str | int | float | bool | None) -> Finding:
    """Make a finding that a healthy log has too."""
    return Finding(identifier, Severity.INFO, reason, advice, evidence)


def warning(identifier: str, reason: str, advice: str = "", **evidence: str | int | float | bool | None) -> Finding:
    """Make a finding that should be looked into."""
    return Finding(identifier, Severity.WARNING, reason, advice, evidence)


def gathered(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return one finding of each kind, gravest first, with the sentences and advice of all of the kind, each once."""
    kinds: dict[str, dict[str, list[Finding]]] = {}
    for finding in sorted(apart(findings), key=lambda finding: WORST_FIRST.index(finding.severity)):
        # What differs in numbers only, or is of the same thing, is said once.
        alike = str(finding.evidence.get("what") or _NUMBER.sub("", finding.reason))
        kinds.setdefault(finding.id, {}).setdefault(alike, []).append(finding)
    return tuple(_one_of(kind.values()) for kind in kinds.values())


def sentence(text: str) -> str:
    """Make a clause a sentence: a capital first letter, unless the word is a name such as ``m1``, and a full stop."""
    first, _, _ = text.partition(" ")
    if first.islower() and first.isalpha():
        text = text[0].upper() + text[1:]
    return text if not text or text[-1] in ".!?" else f"{text}."


def apart(findings: Iterable[Finding]) -> Iterator[Finding]:
    """Yield the parts of which gathered findings were made."""
    for finding in findings:
        yield from finding.parts or (finding,)


def _one_of(alike: Iterable[Sequence[Finding]]) -> Finding:
    several = list(alike)
    parts = tuple(finding for same in several for finding in same)
    if len(parts) == 1:
        return parts[0]
    reasons = (sentence(same[0].reason.rstrip(".") + _more(same)) for same in several)
    advice = dict.fromkeys(sentence(same[0].advice) for same in several if same[0].advice)
    return replace(parts[0], reason=" ".join(reasons), advice=" ".join(advice), parts=parts)


def _more(same: Sequence[Finding]) -> str:
    others = {finding.reason for finding in same if _NUMBER.sub("", finding.reason) == _NUMBER.sub("", same[0].reason)}
    return f"; {len(others) - 1} more such" if len(others) > 1 else ""
