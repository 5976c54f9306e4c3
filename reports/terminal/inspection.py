"""What ``rotorid inspect`` shows on a terminal: the log, what is in it, and what is wrong with it."""

from collections.abc import Sequence
from math import isfinite

from rich.console import Group, RenderableType
from rich.text import Text

from core.quantity import duration, number
from core.table import TONES, Cell, Row, Table
from logparse import Finding
from logparse.inspection import Inspection, MessageSummary, TableSummary
from pipeline.results.account import Account
from reports.views import log_words

_TONES = {"error": "bad", "warning": "care", "info": "unknown"}


def overview(log: Inspection, accounts: Sequence[Account] = ()) -> RenderableType:
    """Return an inspection of a log: what happened first, then findings to act on, worst on top."""
    several = len(accounts) > 1
    parts: list[RenderableType] = []
    for place, account in enumerate(accounts, start=1):
        tone = "unknown" if account.flight is None else _TONES[account.severity] if account.gravest else "good"
        parts.append(Text((f"Flight {place}: " if several else "") + account.headline, style=TONES[tone]))
    parts += [Text(), _facts(log)] if accounts else [_facts(log)]
    parts += [Text(), Text("Findings", style="bold"), _findings(log.findings)]
    parts += [Text(), Text("Tables", style="bold"), _tables(log.tables)]
    parts += [Text(), Text("Messages", style="bold"), _messages(log.messages)]
    return Group(*parts)


def _facts(log: Inspection) -> RenderableType:
    start = f", from {log.start_utc[:19].replace('T', ' ')} UTC" if log.start_utc else ""
    boots = f", power-up {log.boot + 1} of {log.boots}" if log.boots > 1 else ""
    flights = ", ".join(
        f"{number(flight.start, 4)} to {number(flight.stop, 4)} s ({duration(flight.duration)})"
        for flight in log.flights
    )
    motors = len(log.vehicle.motors)
    rows = {
        "file": log.file,
        "format": log_words.FORMATS.get(log.format, log.format),
        "length": f"{duration(log.duration)}{start}{boots}",
        "craft": log_words.craft(log.vehicle) + (f", {motors} motors" if motors else ""),
        "flights": flights or "none",
    }
    lines = [Row(Cell(label, "unknown"), [value]) for label, value in rows.items()]
    return Table("", [""], lines, texts=[0]).terminal()


def _findings(findings: Sequence[Finding]) -> RenderableType:
    if not findings:
        return Text("nothing to complain about")
    rows = [
        Row(
            Cell(finding.severity.word, _TONES[finding.severity]),
            [" ".join(log_words.sentence(text) for text in (finding.reason, finding.advice) if text)],
        )
        for finding in findings
    ]
    return Table("", [""], rows, texts=[0]).terminal(fold_labels=False)


def _tables(tables: Sequence[TableSummary]) -> RenderableType:
    if not tables:
        return Text("none")
    rows = [
        Row(
            row.name,
            [
                str(row.rows),
                number(row.rate) if isfinite(row.rate) else "–",
                *(f"{edge:.1f}" if isfinite(edge) else "–" for edge in (row.start, row.stop)),
                str(row.gaps or "–"),
                number(row.longest_gap) if row.gaps else "–",
                Cell(" ".join(row.columns), "unknown"),
            ],
        )
        for row in tables
    ]
    heads = ("rows", "rate (Hz)", "from (s)", "to (s)", "gaps", "longest (s)", "columns")
    return Table("name", heads, rows, texts=[6]).terminal(fold_labels=False)


def _messages(messages: Sequence[MessageSummary]) -> Text:
    """Run all message types on: name, rows and mean rate."""
    text = Text()
    for place, row in enumerate(messages):
        rate = f", {number(row.rate, 2)} Hz" if isfinite(row.rate) else ""
        text.append("   " if place else "")
        text.append(f"{row.name}\N{NO-BREAK SPACE}")
        text.append(f"{row.rows}{rate}".replace(" ", "\N{NO-BREAK SPACE}"), style="dim")
    return text
