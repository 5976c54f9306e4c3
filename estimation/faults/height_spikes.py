"""Which readings of a barometer are spikes, before any filter has seen them.

A least-squares smoother follows a wild reading on its first pass, and bends what lies about it, so that good readings
look wrong. A short running median of the barometer alone removes single spikes, but bursts that overlap outvote their
neighbours in it. Against the height of the GPS the barometer differs by an offset that changes slowly, whatever the
craft does; a median of that over a minute is wrong only where most readings of a minute are (Hampel 1974). What GPS
heights are too coarse for shows beside the neighbours: no craft leaves the line between them faster than it falls.
"""

import numpy as np
import pandas as pd

from core.units import STANDARD_GRAVITY

#: Readings further than this from the running median are spikes, m.
SPIKE = 10.0
#: Over what the offset between barometer and GPS is held to be constant, s.
OFFSET_TIME = 60.0
#: Readings in the median at least, and where no height but the barometer's is known.
NEIGHBOURS = 11
#: Further than this from a GPS height, s, the craft may have climbed so fast, m/s.
LONGEST_GAP, CLIMB = 1.5, 10.0
#: A reading leaves the line between its neighbours by this and a fall at most, for noise and gusts, m.
UNEVEN = 1.0
#: A burst lasts no longer than so many readings, and its edges are so many times what lies beside them.
LONGEST_BURST, SHARPNESS = 10, 2.0
#: How well the autopilot knows how fast it climbs, m/s.
CLIMB_KNOWN = 0.5


def steady_heights(alt: pd.Series, reference: pd.Series, climb: pd.Series | None = None) -> np.ndarray:
    """Return which readings of a barometer are no spikes, shape (n,)."""
    t = alt.index.to_numpy(float)
    alone = _deviation(alt.to_numpy(float), NEIGHBOURS)
    if len(reference) < 2 or len(t) < 2:
        return _even(t, alt.to_numpy(float), alone < SPIKE, climb)
    when = reference.index.to_numpy(float)
    after = np.clip(np.searchsorted(when, t), 1, len(when) - 1)
    away = np.minimum(np.abs(t - when[after]), np.abs(t - when[after - 1]))
    offset = alt.to_numpy(float) - np.interp(t, when, reference.to_numpy(float))
    window = max(NEIGHBOURS, round(OFFSET_TIME / float(np.median(np.diff(t)))))
    between = np.maximum(away - LONGEST_GAP, 0.0)
    steady = _deviation(offset, window) < SPIKE + CLIMB * between
    return _even(t, alt.to_numpy(float), steady & ((between == 0.0) | (alone < SPIKE)), climb)


def _deviation(values: np.ndarray, window: int) -> np.ndarray:
    """Return the distance of each of `values` from the median of `window` of them about it."""
    usual = pd.Series(values).rolling(window, center=True, min_periods=1).median().to_numpy(float)
    return np.asarray(np.abs(values - usual))


def _even(t: np.ndarray, values: np.ndarray, steady: np.ndarray, climb: pd.Series | None) -> np.ndarray:
    """Remove from the readings that are `steady` what stands out beside its neighbours."""
    return _without_single(t, values, _without_bursts(t, values, steady, climb))


def _without_bursts(t: np.ndarray, values: np.ndarray, steady: np.ndarray, climb: pd.Series | None) -> np.ndarray:
    """Remove from the readings that are `steady` those between jumps that no craft does and that lead back.

    A jump is what the height changes by between two readings, beyond what the autopilot says that the craft climbs; or
    beyond its usual change, and then a craft that falls, and brakes as hard, does g/4 dt^2 of it.
    """
    kept = np.flatnonzero(steady)
    even = steady.copy()
    if len(kept) < NEIGHBOURS:
        return even
    step = np.diff(t[kept])
    climbed, told = _climbed(t[kept], climb)
    rate = (np.diff(values[kept]) - climbed) / np.maximum(step, 1e-9)
    usual = pd.Series(rate).rolling(NEIGHBOURS, center=True, min_periods=1).median().to_numpy(float)
    jump = (rate - usual) * step
    limit = UNEVEN + np.where(told, CLIMB_KNOWN * step, 0.25 * STANDARD_GRAVITY * step**2)
    edges = np.flatnonzero(np.abs(jump) > limit)
    begun = 0
    while begun < len(edges):
        first = edges[begun]
        within = edges[(edges > first) & (edges <= first + LONGEST_BURST)]
        for last in within.tolist():
            inside = edges[(edges >= first) & (edges <= last)]
            beside = np.delete(np.arange(max(first - 2, 0), min(last + 3, len(jump))), inside - max(first - 2, 0))
            sharp = np.abs(jump[inside]).min() > SHARPNESS * np.abs(jump[beside]).max(initial=0.0)
            if sharp and abs(jump[first : last + 1].sum()) < limit[inside].min():
                even[kept[first + 1 : last + 1]] = False
                begun = int(np.searchsorted(edges, last))
                break
        begun += 1
    return even


def _climbed(t: np.ndarray, climb: pd.Series | None) -> tuple[np.ndarray, np.ndarray]:
    """Return what the craft climbed from each of `t` to the next, m, and whether that is known there."""
    if climb is None or len(climb) < 2:
        return np.zeros(len(t) - 1), np.zeros(len(t) - 1, np.bool_)
    when, speed = climb.index.to_numpy(float), climb.to_numpy(float)
    height = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(when))])
    # Known where rows follow each other closely, by a share of the time that is not.
    gaps = np.concatenate([[0.0], np.cumsum(np.where(np.diff(when) > LONGEST_GAP, np.diff(when), 0.0))])
    known = (np.diff(np.interp(t, when, gaps)) == 0.0) & (t[:-1] >= when[0]) & (t[1:] <= when[-1])
    return np.where(known, np.diff(np.interp(t, when, height)), 0.0), known


def _without_single(t: np.ndarray, values: np.ndarray, steady: np.ndarray) -> np.ndarray:
    """Remove from the readings that are `steady` those farther off the line between their neighbours than a craft gets.

    The neighbours of a spike look wrong too, by half of it: only the farthest of three in a row is one.
    """
    kept = np.flatnonzero(steady)
    if len(kept) < 3:
        return steady
    at, known = t[kept], values[kept]
    before, after = np.diff(at)[:-1], np.diff(at)[1:]
    line = (known[:-2] * after + known[2:] * before) / np.maximum(before + after, 1e-9)
    away = np.zeros(len(kept))
    away[1:-1] = np.abs(known[1:-1] - line) / (UNEVEN + 0.5 * STANDARD_GRAVITY * before * after)
    farthest = pd.Series(away).rolling(3, center=True, min_periods=1).max().to_numpy(float)
    even = steady.copy()
    even[kept[(away > 1.0) & (away >= farthest)]] = False
    return even
