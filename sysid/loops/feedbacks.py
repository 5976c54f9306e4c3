"""Feedback of many candidate gains at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sysid.loops.filters import Complexes, Floats
from sysid.loops.settings import LoopSettings


class Feedbacks:
    """Feedback of many candidates: linear in P, I and D, with a filter of the derivative that takes few values."""

    def __init__(self, settings: LoopSettings, hz: Floats) -> None:
        self._settings, self._hz = settings, hz
        self._without = self._feedback()
        self._p, self._i = self._feedback(P=1.0) - self._without, self._feedback(I=1.0) - self._without
        self._d: dict[float, Complexes] = {}

    def of(self, candidates: Sequence[Mapping[str, float]]) -> Complexes:
        """Compute the feedback of each candidate, shape (K, n)."""
        p, i, d = (np.array([each[name] for each in candidates])[:, None] for name in ("P", "I", "D"))
        derivative = np.stack([self._derivative(each["FLTD"]) for each in candidates])
        return np.asarray(self._without + p * self._p + i * self._i + d * derivative)

    def _derivative(self, corner: float) -> Complexes:
        if corner not in self._d:
            self._d[corner] = self._feedback(D=1.0, FLTD=corner) - self._without
        return self._d[corner]

    def _feedback(self, **values: float) -> Complexes:
        return self._settings.changed(**({"P": 0.0, "I": 0.0, "D": 0.0} | values)).feedback(self._hz)


class FeedbackOfEach:
    """Feedback of few candidates that change anything."""

    def __init__(self, settings: LoopSettings, hz: Floats) -> None:
        self._settings, self._hz = settings, hz

    def of(self, candidates: Sequence[Mapping[str, float]]) -> Complexes:
        """Compute the feedback of each candidate, shape (K, n)."""
        return np.stack([self._settings.changed(**each).feedback(self._hz) for each in candidates])
