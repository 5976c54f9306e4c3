"""Motors that failed, weakened or dropped out."""

from __future__ import annotations

from collections.abc import Iterator

from core.findings import Finding
from pipeline.flight.account.readings import Readings


def motor_happenings(readings: Readings, until: float) -> Iterator[Finding]:
    """Yield motors at fault before `until`, the first blow or the touch-down."""
    yield from ()
