"""What to do next: one or two sentences, of the gravest first."""

from __future__ import annotations

from pipeline.results.failure import Failure
from pipeline.results.flight import FlightResult


def next_step(result: FlightResult) -> str:
    """Return what to inspect before the next flight, else how to fly or log better."""
    account = result.account
    if not isinstance(account, Failure) and account.story:
        return account.story[0].advice or account.story[-1].advice
    first = next(iter(result.advice), None)
    if first is None:
        return ""
    return f"{first.do}: {first.gain}."
