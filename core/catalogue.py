"""The catalogue of findings: name, severity, meaning and advice of each, kept in ``findings.toml``."""

import tomllib
from dataclasses import dataclass
from pathlib import Path

from core.findings import Severity
from core.serialization import restored


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """One line of the catalogue."""

    ids: tuple[str, ...]  #: Names that mean the same, as `logparse.Finding.id` has them.
    severities: tuple[Severity, ...]  #: Which a log may give them, worst first.
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
        """Write the catalogue as docs/findings.md has it."""
        parts = ["# Findings: what they mean and how to cure them", self.text.strip()]
        for section in self.sections:
            head = "| finding | severity | what it means | what to do |\n|---|---|---|---|\n"
            rows = (
                f"| {', '.join(f'`{name}`' for name in each.ids)} | {', '.join(each.severities)} | {each.meaning} "
                f"| {each.advice} |"
                for each in section.findings
            )
            parts += [f"## {section.title}", *filter(None, [section.text.strip()]), head + "\n".join(rows)]
        return "\n\n".join(parts) + "\n"


def read_catalogue() -> Catalogue:
    """Read the catalogue."""
    file = Path(__file__).parent / "findings.toml"
    return restored(tomllib.loads(file.read_text(encoding="utf-8")), Catalogue)
