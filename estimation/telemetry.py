"""Rows of telemetry that the low-rate filter fuses: receiver, autopilot's positions and velocities, barometer.

A least-squares smoother follows a wild reading of the barometer on its first pass, and bends what lies about it: so
what is far off the running median is left out of that pass (Hampel 1974).
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from core.findings import warning
from estimation.observations import observe_gps, reported, usable_fixes
from estimation.place import LocalFrame
from estimation.states import SensorNoise
from estimation.timing import usable
from logparse import Finding, Geodetic, Tables
from logparse.craft.vehicle import is_simulated

#: Readings further than this from the running median are spikes, m; and how many that is of.
SPIKE, NEIGHBOURS = 10.0, 11


def steady_heights(alt: pd.Series) -> np.ndarray:
    """Return which readings of a barometer are no spikes, shape (n,)."""
    usual = alt.rolling(NEIGHBOURS, center=True, min_periods=1).median()
    return (alt - usual).abs().to_numpy(float) < SPIKE


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
    origin = tables.origin
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
    if ekf is not None:
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
        steady = steady_heights(baro["alt"])
        for when, alt, good in zip(baro.index.to_numpy(float), baro["alt"].to_numpy(float), steady, strict=True):
            rows.append(Measured(when, "baro", H, np.array([alt]), np.array([noise.baro**2]), bool(good)))
    rows.sort(key=lambda row: row.t)
    return origin or Geodetic(float("nan"), float("nan"), 0.0), rows, gps_sigma, " and ".join(sources)


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
