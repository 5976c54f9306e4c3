"""What rows weigh: which are left out, which are weighed less, and how the craft was driven."""

from dataclasses import replace

import numpy as np

from estimation.lowrate.measurements import Measured
from estimation.lowrate.smoother import EKF_LASTING, nodes_of

#: Acceleration that attitude does not tell: 1-sigma at least, m/s^2, horizontally (twice) and vertically; and over
#: what the log sets it, s.
DISTURBANCE, SPAN = np.array([0.7, 0.7, 1.0]), 20.0
#: What a row may differ by from all the others without being refused whatever its own noise, m and m/s: attitude at
#: telemetry rate tells no more of what lies between two rows.
TOLERANCE = 0.5
#: How well the time of a telemetry row is known, s: a fast craft's rows differ by that times its speed.
LATENESS = 0.2
#: A sensor's variance is raised by this at most, if so many of its rows are fused; for how long its errors last, s.
LARGEST_FACTOR, FEWEST_ROWS, LASTING = 100.0, 20, 3.0
#: The gate of a sensor narrows from its farthest reading over this. Nothing bounds the pull of a spike on the first
#: pass, so that the readings between are moved with it, and come back later.
NARROWING = 3.0
#: A reading of the barometer that is fused and lies further off than so many of its sigmas is weighed as if it lay
#: there: between them and the gate it would pull the more, the wilder it is.
HONEST = 2.0
#: Passes end when no variance changes by more than this part.
SETTLED = 0.3


def alike(one: Measured, other: Measured) -> bool:
    """Whether two passes use a row alike."""
    close = np.abs(np.log(one.variance / other.variance)).max(initial=0.0) < SETTLED
    return one.admitted == other.admitted and bool(close)


def softened(measured: list[Measured], t: np.ndarray, x: np.ndarray, P: np.ndarray) -> list[Measured]:
    """Raise the variance of readings of the barometer that are off by more than `HONEST` of their sigmas.

    Iterated, this is the estimate by a loss that stops growing there (reweighted least squares: Holland & Welsch 1977).
    """
    node = nodes_of(t, measured)
    out = []
    for m, at in zip(measured, node, strict=True):
        if m.admitted and m.sensor == "baro":
            expected = m.variance + _spread(m, P[at]) + TOLERANCE**2
            beyond = np.maximum((m.z - m.H @ x[at]) ** 2 / HONEST**2 - expected, 0.0)
            out.append(replace(m, variance=m.variance + beyond))
        else:
            out.append(m)
    return out


def judged_rows(
    given: list[Measured], measured: list[Measured], t: np.ndarray, x: np.ndarray, P: np.ndarray, gate: float
) -> list[Measured]:
    """Leave out of the rows `given` what is far from the smoothed states, and take back what is not.

    As `admission.admit` does; `measured` are the rows that made the states. What is out of `given` already comes back
    only where it weighs in full.
    """
    node = nodes_of(t, measured)
    worst = np.zeros(len(measured))
    speed = _measured_speed(measured)
    for k, (m, at) in enumerate(zip(given, node, strict=True)):
        late = (LATENESS * speed[k]) ** 2
        variance = m.variance + _spread(m, P[at]) + TOLERANCE**2 + late
        worst[k] = np.sqrt(np.max((m.z - m.H @ x[at]) ** 2 / variance, initial=0.0))
    sensors = np.array([m.sensor for m in measured])
    fused = np.array([m.admitted for m in measured])
    limit = np.where([m.admitted for m in given], gate, HONEST)
    for sensor in np.unique(sensors):
        mine = (sensors == sensor) & fused
        limit[mine] = max(gate, float(worst[mine].max(initial=0.0)) / NARROWING)
    return [replace(m, admitted=bool(w <= most)) for m, w, most in zip(given, worst, limit, strict=True)]


def driven_by(t: np.ndarray, x: np.ndarray, P: np.ndarray) -> np.ndarray:
    """Return 1-sigma about each node of the acceleration that attitude does not tell, and of the autopilot's velocity.

    Root of the mean square of what was found and of its variance, as in the expectation-maximisation algorithm
    (Shumway & Stoffer 1982): of accelerations over `SPAN`, for who flies hard in a part of the log may have done so
    where a sensor is missing; of what lasts in the autopilot's velocity over all. Shape (n, 6), m/s^2 and m/s.
    """
    found = x**2 + np.diagonal(P, axis1=1, axis2=2)
    total = np.concatenate([np.zeros((1, 3)), np.cumsum(found[:, 6:9], axis=0)])
    first, last = np.searchsorted(t, t - SPAN / 2), np.searchsorted(t, t + SPAN / 2, side="right")
    mean = (total[last] - total[first]) / (last - first)[:, None]
    lasting = np.tile(found[:, 13:16].mean(axis=0), (len(t), 1))
    least = np.append(DISTURBANCE, np.full(3, EKF_LASTING))
    return np.asarray(np.maximum(np.sqrt(np.hstack([mean, lasting])), least))


def rescaled(measured: list[Measured], t: np.ndarray, x: np.ndarray, P: np.ndarray) -> list[Measured]:
    """Return rows whose variances are raised to what their residuals show (variance factors: Koch 1999, 3.6).

    A sensor that contradicts the others by more than its noise makes sigma too small, which shows where rows are left
    out: states then move by more than it. No variance is lowered: errors that last do not show in residuals.
    """
    node = nodes_of(t, measured)
    found: dict[tuple[str, int], tuple[list[float], list[float], list[float]]] = {}
    keys = []
    for m, at in zip(measured, node, strict=True):
        keys.append([(m.sensor, int(np.flatnonzero(row)[0])) for row in m.H])
        if not m.admitted:
            continue
        # What lasts in the autopilot's velocity counts, though it is a state: where another sensor is lost nothing
        # tells it from a climb.
        residual = m.z - m.H[:, :13] @ x[at, :13]
        expected = m.variance - _spread(m, P[at])
        for key, one, variance in zip(keys[-1], residual, expected, strict=True):
            when, residuals, variances = found.setdefault(key, ([], [], []))
            when.append(m.t)
            residuals.append(float(one))
            variances.append(float(variance))
    factor = {key: variance_factor(*map(np.array, rows)) for key, rows in found.items() if len(rows[0]) >= FEWEST_ROWS}
    return [
        replace(m, variance=m.variance * np.array([factor.get(key, 1.0) for key in mine]))
        for m, mine in zip(measured, keys, strict=True)
    ]


def variance_factor(t: np.ndarray, residuals: np.ndarray, expected: np.ndarray) -> float:
    """Factor on a sensor's variance by its residuals and the variance that they should have.

    What contradicts other sensors does so for a while (lags, propeller wash), which averaging does not take away: the
    variance is that of white noise as strong at low frequencies as the residuals (Newey & West 1987).
    """
    squares = float(residuals @ residuals)
    total = squares
    lags = min(int(LASTING / np.median(np.diff(t))), len(t) - 1)
    for lag in range(1, lags + 1):
        total += 2.0 * (1.0 - lag / (lags + 1)) * float(residuals[lag:] @ residuals[:-lag])
    return min(max(1.0, max(squares, total) / max(float(expected.sum()), 1e-12)), LARGEST_FACTOR)


def _spread(row: Measured, P: np.ndarray) -> np.ndarray:
    """Return the variance of what the states say of a row."""
    return np.asarray(((row.H @ P) * row.H).sum(axis=1))


def _measured_speed(measured: list[Measured]) -> np.ndarray:
    """Return the speed about each row by what receiver and autopilot measured, m/s; the states may have a spike's."""
    known = [(m.t, float(np.linalg.norm(m.z[m.H[:, 3:6].any(axis=1)]))) for m in measured if m.H[:, 3:6].any()]
    if not known:
        return np.zeros(len(measured))
    t, speed = np.array(known).T
    return np.asarray(np.interp([m.t for m in measured], t, speed))
