"""What to do next: one or two sentences, of the gravest first."""

from __future__ import annotations

from pipeline.results.failure import Failure
from pipeline.results.flight import FlightResult


def next_step(result: FlightResult) -> str:
    """Return what to inspect before the next flight, else how to fly or log better."""
    account = result.account
    if not isinstance(account, Failure):
        told = next((each.advice for each in (*account.story, *account.notable) if each.advice), "")
        if told:
            return told
    first = next(iter(result.advice), None)
    return "" if first is None else f"{first.do.rstrip('.')}."
