"""Stretches of time in which a condition holds."""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]


def stretches(t: Array, on: Mask, *, join: float, shortest: float = 0.0) -> list[tuple[float, float]]:
    """Return the stretches in which `on` holds, as (first, last) time.

    Parameters
    ----------
    t : ndarray, shape (n,)
        s, increasing.
    on : ndarray of bool, shape (n,)
    join : float
        Interruptions up to this long do not end a stretch, s.
    shortest : float
        Stretches shorter than this from first to last sample are left out, s.
    """
    times = t[on]
    if not len(times):
        return []
    cuts = np.flatnonzero(np.diff(times) > join)
    firsts = times[np.concatenate(([0], cuts + 1))]
    lasts = times[np.concatenate((cuts, [len(times) - 1]))]
    return [(float(a), float(b)) for a, b in zip(firsts, lasts, strict=True) if b - a >= shortest]


def within(t: Array, spans: "list[tuple[float, float]]") -> Mask:
    """Return which times lie in one of the spans, bounds included."""
    inside = np.zeros(len(t), dtype=bool)
    for first, last in spans:
        inside |= (t >= first) & (t <= last)
    return inside
