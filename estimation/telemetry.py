"""Rows of telemetry that the low-rate filter fuses: receiver, autopilot's positions and velocities, barometer.

A least-squares smoother follows a wild reading of the barometer on its first pass, and bends what lies about it. A
short running median of the barometer alone removes single spikes, but bursts that overlap outvote their neighbours.
Against the height of the GPS the barometer differs by an offset that changes slowly, whatever the craft does; a median
of that over a minute is wrong only where most readings of a minute are (Hampel 1974). What GPS heights are too coarse
for shows beside the neighbours: no craft leaves the line between them faster than it falls.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from core.findings import warning
from core.units import STANDARD_GRAVITY
from estimation.observations import find_origin, observe_gps, reported, usable_fixes
from estimation.place import LocalFrame
from estimation.states import SensorNoise
from estimation.timing import usable
from logparse import Finding, Geodetic, Tables
from logparse.craft.vehicle import is_simulated

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
    climbed, known = _climbed(t[kept], climb)
    rate = (np.diff(values[kept]) - climbed) / np.maximum(step, 1e-9)
    usual = pd.Series(rate).rolling(NEIGHBOURS, center=True, min_periods=1).median().to_numpy(float)
    jump = (rate - usual) * step
    limit = UNEVEN + np.where(known, CLIMB_KNOWN * step, 0.25 * STANDARD_GRAVITY * step**2)
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


#: States: position, velocity, disturbance, GPS error (three each), baro offset, autopilot's velocity error (three).
SIZE = 16
#: White 1-sigma of the autopilot's own position and velocity estimate, m and m/s.
EKF_POSITION, EKF_VELOCITY = 0.05, 0.1
#: The autopilot's positions are used where GPS fixes are further away than this, s.
FILL_AFTER = 1.0
#: Old firmware sends the vertical speed with the wrong sign: it is turned round if the autopilot's height goes against
#: it with this correlation, and left out with less; judged where the r.m.s. of the speed is above this, m/s.
OPPOSITE, CLIMBS = 0.8, 0.3


@dataclass(frozen=True, slots=True)
class Measured:
    """One row of measurements: time [s], sensor, rows of H, values, variances, and whether it may be fused."""

    t: float
    sensor: str
    H: np.ndarray
    z: np.ndarray
    variance: np.ndarray
    admitted: bool = True


def measurements_of(tables: Tables, noise: SensorNoise) -> tuple[Geodetic, list[Measured], np.ndarray, str]:
    """Return origin, measurements in order of time, 1-sigma of the GPS error (3,) and what the positions came from."""
    fixes = usable_fixes(tables.gps)
    ekf = usable(tables.ekf, ["p_n", "p_e", "p_d", "v_n", "v_e", "v_d"])
    rows: list[Measured] = []
    gps_sigma = np.array([noise.h_acc, noise.h_acc, noise.v_acc])
    if fixes is not None:
        h, v = reported(fixes, "h_acc", noise.h_acc), reported(fixes, "v_acc", noise.v_acc)
        gps_sigma = np.array([np.median(h), np.median(h), np.median(v)])
    gps_sigma = gps_sigma * noise.gps_error_share
    origin = find_origin(tables)
    selector = np.zeros((6, SIZE))
    selector[:3, 0:3] = selector[:3, 9:12] = np.eye(3)
    selector[3:, 3:6] = np.eye(3)
    sources = []
    fixed = np.array([-np.inf])
    if fixes is not None:
        assert origin is not None  # made from the first fix if not logged
        frame = LocalFrame.at(origin, spherical=is_simulated(tables.parameters))
        (_, fixed, level, p_variance), (_, _, height, _), (_, _, speed, v_variance), (_, _, climb, _) = observe_gps(
            fixes, frame, noise
        )
        both = (
            np.hstack([level[:, :2], height[:, 2:], speed[:, :2], climb[:, 2:]]),
            np.hstack([p_variance, v_variance]),
        )
        for when, z, variance in zip(fixed, *both, strict=True):
            there = np.isfinite(z)
            rows.append(Measured(when, "gps_position", selector[there], z[there], variance[there]))
        sources.append("GPS fixes")
    if ekf is not None and (tables.origin is not None or fixes is None):
        t = ekf.index.to_numpy(float)
        z = ekf[["p_n", "p_e", "p_d", "v_n", "v_e", "v_d"]].to_numpy(float)
        variance = np.repeat([EKF_POSITION**2, EKF_VELOCITY**2], 3)
        # The autopilot's positions hold the GPS already, later and smoothed: they only fill where fixes are missing.
        lonely = _distance(t, fixed) > FILL_AFTER
        sign = _climb_sign(ekf)
        z = z * np.array([1.0, 1.0, 1.0, 1.0, 1.0, sign])
        last = 5 if sign == 0.0 else 6
        seen = selector.copy()
        seen[3:, 13:16] = np.eye(3)
        for when, row, alone in zip(t, z, lonely, strict=True):
            part = slice(0 if alone else 3, last)
            rows.append(Measured(when, "autopilot", seen[part], row[part], variance[part]))
        sources.append("the autopilot's " + ("positions" if lonely.any() else "velocities"))
    baro = usable(tables.baro, ["alt"])
    if baro is not None:
        H = np.zeros((1, SIZE))
        H[0, 2], H[0, 12] = -1.0, 1.0
        # A spike does not even enter the first pass, which nothing protects.
        steady = steady_heights(baro["alt"], _other_height(fixes, ekf), _climb(ekf))
        for when, alt, good in zip(baro.index.to_numpy(float), baro["alt"].to_numpy(float), steady, strict=True):
            rows.append(Measured(when, "baro", H, np.array([alt]), np.array([noise.baro**2]), bool(good)))
    rows.sort(key=lambda row: row.t)
    return origin or Geodetic(float("nan"), float("nan"), 0.0), rows, gps_sigma, " and ".join(sources)


def _other_height(fixes: pd.DataFrame | None, ekf: pd.DataFrame | None) -> pd.Series:
    """Return the height by GPS, or else by the autopilot, m; which may itself hold the barometer's spikes."""
    if fixes is not None:
        return fixes["alt"].dropna()
    return -ekf["p_d"] if ekf is not None else pd.Series(dtype=float)


def _climb(ekf: pd.DataFrame | None) -> pd.Series | None:
    """Return the autopilot's speed upwards, m/s, if it is to be believed."""
    sign = 0.0 if ekf is None else _climb_sign(ekf)
    return None if ekf is None or sign == 0.0 else -sign * ekf["v_d"]


def _climb_sign(ekf: pd.DataFrame) -> float:
    """Return 1 if the autopilot's height changes as its vertical speed says, -1 if as its opposite, else 0."""
    t = ekf.index.to_numpy(float)
    step = np.diff(t)
    speed = ekf["v_d"].to_numpy(float)
    mean = 0.5 * (speed[1:] + speed[:-1])
    close = (step > 0.0) & (step < FILL_AFTER)
    if not close.any() or np.sqrt(np.mean(mean[close] ** 2)) < CLIMBS:
        return 1.0
    moved = np.diff(ekf["p_d"].to_numpy(float))[close] / step[close]
    together = float(moved @ mean[close])
    if together > 0.0:
        return 1.0
    return -1.0 if together < -OPPOSITE * np.linalg.norm(moved) * np.linalg.norm(mean[close]) else 0.0


def reversed_climb(tables: Tables) -> tuple[Finding, ...]:
    """Return a finding if the autopilot's vertical speed has the wrong sign."""
    ekf = usable(tables.ekf, ["p_n", "p_e", "p_d", "v_n", "v_e", "v_d"])
    sign = 1.0 if ekf is None else _climb_sign(ekf)
    if sign == 1.0:
        return ()
    used = "is used with its sign reversed" if sign < 0.0 else "is not used"
    return (
        warning(
            "sensor-doubtful",
            f"The autopilot's height changes against its vertical speed, which therefore {used}; firmware of 2013 "
            "sends it with the wrong sign.",
            "Analyse the .bin log of the same flight, or update the firmware.",
            sensor="autopilot",
        ),
    )


def _distance(t: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Time from each of `t` to the nearest of the sorted `others`, s."""
    after = np.clip(np.searchsorted(others, t), 0, len(others) - 1)
    before = np.maximum(after - 1, 0)
    return np.asarray(np.minimum(np.abs(others[after] - t), np.abs(others[before] - t)))
