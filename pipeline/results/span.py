"""A time span of a log."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from core.lazy import lazy

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt
    import pandas as pd

    from logparse import Flight
else:
    np = lazy("numpy")  # a report is read without it


@dataclass(frozen=True, slots=True)
class Span:
    """A time span on the log's boot clock, s."""

    start: float
    stop: float

    @property
    def duration(self) -> float:
        """Length in seconds."""
        return self.stop - self.start

    def rows(self, index: pd.Index[float]) -> slice:
        """Return the rows of an ordered index that lie within; looking labels up leaves a hash table of long ones."""
        times = index.to_numpy()
        return slice(int(times.searchsorted(self.start)), int(times.searchsorted(self.stop, side="right")))


def within(t: npt.NDArray[np.float64], spans: Iterable[Span]) -> npt.NDArray[np.bool_]:
    """Return which times lie in one of the spans, bounds included."""
    inside = np.zeros(len(t), dtype=bool)
    for span in spans:
        inside |= (t >= span.start) & (t <= span.stop)
    return inside


def around(flight: Span | None, flights: Iterable[Span | Flight]) -> Span:
    """Return from when to when a log is about one of its flights: with half of the time on the ground beside it."""
    if flight is None:
        return Span(-math.inf, math.inf)
    before = max((other.stop for other in flights if other.stop <= flight.start), default=-math.inf)
    after = min((other.start for other in flights if other.start >= flight.stop), default=math.inf)
    return Span(0.5 * (before + flight.start), 0.5 * (flight.stop + after))
