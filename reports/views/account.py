"""The account of a flight as a table: what happened, gravest first, and what was only reported."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from core.findings import Finding
from core.quantity import duration, number
from pipeline.results.account import Account

#: Most rows of what was only reported.
_MOST = 40
_WORDS = {"info": "note"}


@dataclass(frozen=True, slots=True)
class ShownHappening:
    """A happening as people read it: since take-off, on the log's clock, and how long it lasted."""

    since: str
    t: str
    duration: str
    severity: str
    word: str
    name: str
    reason: str
    advice: str


@dataclass(frozen=True, slots=True)
class ShownAccount:
    """What happened, what was only reported, and what the log does not tell."""

    headline: str
    rows: Sequence[ShownHappening]
    quiet: Sequence[ShownHappening]
    unknown: Sequence[str]


def shown_account(account: Account | None) -> ShownAccount | None:
    """Lay an account out; an advice that was given in a row before is not repeated."""
    if account is None:
        return None
    given: set[str] = set()
    rows = []
    for each in account.notable:
        rows.append(_shown(each, account, "" if each.advice in given else each.advice))
        given.add(each.advice)
    quiet = [each for each in account.happenings if not each.notable]
    return ShownAccount(
        headline=account.headline,
        rows=rows,
        quiet=[_shown(each, account, "") for each in quiet[:_MOST]],
        unknown=account.unknown,
    )


def _shown(happening: Finding, account: Account, advice: str) -> ShownHappening:
    t, end = happening.t or 0.0, happening.end or 0.0
    flight = account.flight
    return ShownHappening(
        since="" if flight is None or t < flight.start else duration(t - flight.start),
        t=f"{t:.1f}",
        duration=f"{number(end - t, 2)} s" if end - t > 0.05 else "",
        severity=happening.severity,
        word=_WORDS.get(happening.severity, happening.severity),
        name=happening.id.replace("-", " "),
        reason=happening.reason,
        advice=advice,
    )
