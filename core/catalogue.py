"""The catalogue of findings: name, severity, meaning and advice of each, kept in ``findings.toml``."""

import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from core.findings import Happening, Severity
from core.serialization import restored


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """What the catalogue says of one finding."""

    id: str  #: As `core.findings.Finding.id` has it.
    severities: tuple[Severity, ...]  #: That it may have, worst first.
    meaning: str
    advice: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """Findings of one subject."""

    title: str
    text: str = ""
    findings: tuple[Entry, ...]


@dataclass(frozen=True, slots=True)
class Catalogue:
    """Every finding that rotorid raises, by subject."""

    text: str
    sections: tuple[Section, ...]

    def as_markdown(self) -> str:
        """Write the text of docs/findings.md."""
        parts = ["# Findings: what they mean and how to cure them", self.text.strip()]
        for section in self.sections:
            head = "| finding | severity | what it means | what to do |\n|---|---|---|---|\n"
            rows = (
                f"| `{entry.id}` | {', '.join(entry.severities)} | {entry.meaning} | {entry.advice} |"
                for entry in section.findings
            )
            parts += [f"## {section.title}", *filter(None, [section.text.strip()]), head + "\n".join(rows)]
        return "\n\n".join(parts) + "\n"


def read_catalogue() -> Catalogue:
    """Read the catalogue."""
    file = Path(__file__).parent / "findings.toml"
    return restored(tomllib.loads(file.read_text(encoding="utf-8")), Catalogue)


@cache
def _entries() -> dict[str, Entry]:
    """Return the entries of the catalogue by id."""
    return {entry.id: entry for section in read_catalogue().sections for entry in section.findings}


def finding(
    name: str,
    reason: str,
    *,
    t: float,
    end: float | None = None,
    severity: Severity | None = None,
    advice: str | None = None,
    **evidence: str | float | bool | None,
) -> Happening:
    """Make a finding of something that happened at a time; by default with the catalogue's severity and advice."""
    entry = _entries()[name]
    return Happening(
        id=name,
        severity=entry.severities[0] if severity is None else severity,
        reason=reason,
        advice=entry.advice if advice is None else advice,
        evidence=evidence,
        t=t,
        end=t if end is None else end,
    )
