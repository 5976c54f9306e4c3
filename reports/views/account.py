"""The account of a flight as tables: what happened, gravest first, and what was only reported."""

from __future__ import annotations

from collections.abc import Iterator

from core.findings import Finding
from core.quantity import duration, number
from core.table import Cell, Row, Table
from pipeline.results.account import Account


def happened(account: Account | None) -> Table | None:
    """Lay out what happened; an advice that was given in a row before is not repeated."""
    return None if account is None or not account.notable else _table(account, _advised(account))


def reported(account: Account | None) -> Table | None:
    """Lay out what was only reported."""
    quiet = [] if account is None else [each for each in account.happenings if not each.notable]
    # Most rows of what was only reported.
    return None if account is None or not quiet else _table(account, ((each, "") for each in quiet[:40]))


def _advised(account: Account) -> Iterator[tuple[Finding, str]]:
    given: set[str] = set()
    for each in account.notable:
        yield each, "" if each.advice in given else each.advice
        given.add(each.advice)


def _table(account: Account, rows: Iterator[tuple[Finding, str]]) -> Table:
    heads = ["log (s)", "for", "what", "evidence and what to do"]
    return Table("in flight", heads, [_row(account, *row) for row in rows], texts=(2, 3), style="events")


def _row(account: Account, happening: Finding, advice: str) -> Row:
    t, end = happening.t or 0.0, happening.end or 0.0
    flight, severity = account.flight, happening.severity
    return Row(
        "" if flight is None or t < flight.start else duration(t - flight.start),
        [
            f"{t:.1f}",
            f"{number(end - t, 2)} s" if end - t > 0.05 else "",
            Cell(happening.id.replace("-", " "), severity, badge=severity.word),
            Cell(happening.reason, under=advice),
        ],
    )
