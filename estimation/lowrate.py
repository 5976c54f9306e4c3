"""A trajectory from telemetry: attitude and positions at a few hertz, no IMU worth integrating.

The autopilot's attitude is taken as it is. It tells which way the thrust points, and with the height nearly steady how
large the horizontal part of it is; what that leaves out (drag, wind, climbing) is a slowly varying acceleration to be
estimated. So the problem is linear with a known input, and filtered by filterpy's `KalmanFilter`. filterpy's own
smoothers know no input, and of its two the module's function pairs the wrong F where F varies; so the
Rauch-Tung-Striebel recursion stands here, on the priors that the filter itself made.
"""

from dataclasses import replace

import numpy as np
import pandas as pd
import scipy
from filterpy.kalman import KalmanFilter

from core.attitude import continuous, matrix_from_quat, multiply, quat_from_euler
from core.findings import warning
from core.units import STANDARD_GRAVITY
from estimation.consistency import SensorStatistics
from estimation.states import SensorNoise
from estimation.telemetry import SIZE, Measured, measurements_of, reversed_climb
from estimation.timing import TICK, segments, usable
from estimation.trajectory import SIGMA_COLUMNS, STATE_COLUMNS, Trajectory
from estimation.trust import contradicted_receiver, doubtful_sensors, only_one_withdrawal
from logparse import MissingDataError, Tables

#: Correlation time of the acceleration that attitude does not tell, s: horizontally (drag and gusts, twice) and
#: vertically (climbs).
TIMES = (3.0, 3.0, 1.0)
#: Correlation time of the GPS error here, s. Velocities at telemetry rate are too coarse to tell a wander of the GPS
#: over minutes from a wander of the craft, so it is held to be nearly constant: known in size, not in course. Heights
#: have the barometer to tell them from (`SensorNoise.gps_height_time`), where there is one.
GPS_ERROR_TIME = 1000.0
#: What lasts of its velocity's error: 1-sigma at least, m/s, and for how long, s. Taken for white, an error of 0.1 m/s
#: over minutes outvoted a receiver by 80 m.
EKF_LASTING, EKF_TIME = 0.2, 30.0
#: Readings of the barometer whose median is its height at the start: any one may be a spike.
FIRST_HEIGHTS = 9
#: So many nodes at a time, for the sake of memory.
PIECE = 1000


def filter_telemetry(
    t: np.ndarray,
    thrust: scipy.interpolate.Akima1DInterpolator,
    measured: list[Measured],
    gps_sigma: np.ndarray,
    noise: SensorNoise,
    driven: np.ndarray,
    *,
    smoothed: bool = True,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Run filterpy's filter over the nodes, and smooth back: x (n, 16), P (n, 16, 16), and the nis of each row."""
    kf = KalmanFilter(dim_x=SIZE, dim_z=1, dim_u=3)
    kf.x = np.zeros((SIZE, 1))
    first = next((m for m in measured if len(m.z) >= 5), measured[0])
    kf.x[:3, 0] = first.z[:3]
    offsets = [m for m in measured if len(m.z) == 1 and m.admitted]
    if offsets:
        kf.x[12, 0] = np.median([m.z[0] for m in offsets[:FIRST_HEIGHTS]]) + first.z[2]
    kf.P = np.diag(
        np.concatenate([np.full(3, 10.0), np.full(3, 10.0), driven[0, :3], gps_sigma, [10.0], driven[0, 3:]]) ** 2
    )
    nodes = nodes_of(t, measured)
    x, P = np.empty((len(t), SIZE)), np.empty((len(t), SIZE, SIZE))
    nis = np.full(len(measured), np.nan)
    prior_x, prior_P = np.empty_like(x), np.empty_like(P)
    pieces = [slice(begin, begin + PIECE + 1) for begin in range(0, len(t) - 1, PIECE)]
    steps = (
        step for piece in pieces for step in zip(*transitions(t[piece], driven[piece], gps_sigma, noise), strict=True)
    )
    # Mean input of each step by Simpson's rule.
    edge = np.clip(t, thrust.x[0], thrust.x[-1])
    at, middle = thrust(edge), thrust(0.5 * (edge[1:] + edge[:-1]))
    mean_push = (at[:-1] + 4.0 * middle + at[1:]) / 6.0
    done = 0
    for k in range(len(t)):
        if k:
            F, B, Q = next(steps)
            kf.predict(u=mean_push[k - 1][:, None], F=F, B=B, Q=Q)
        prior_x[k], prior_P[k] = kf.x[:, 0], kf.P
        while done < len(measured) and nodes[done] == k:
            m = measured[done]
            done += 1
            if not m.admitted:
                continue
            kf.update(m.z[:, None], R=np.diag(m.variance), H=m.H)
            nis[done - 1] = np.mean(kf.y[:, 0] ** 2 / np.diag(kf.S))
        x[k], P[k] = kf.x[:, 0], kf.P
    for piece in reversed(pieces) if smoothed else ():
        F, _, _ = transitions(t[piece], driven[piece], gps_sigma, noise)
        gains = np.linalg.solve(prior_P[piece][1:], F @ P[piece][:-1]).transpose(0, 2, 1)
        for k, gain in reversed(list(enumerate(gains, start=piece.start))):
            x[k] += gain @ (x[k + 1] - prior_x[k + 1])
            P[k] += gain @ (P[k + 1] - prior_P[k + 1]) @ gain.T
    return x, P, nis


def transitions(
    t: np.ndarray, driven: np.ndarray, gps_sigma: np.ndarray, noise: SensorNoise
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """F, B and Q from node to node: disturbance and errors of GPS and autopilot are Gauss-Markov, the rest follows."""
    step, driven = np.diff(t), driven[1:]
    n = len(step)
    F, B, Q = np.tile(np.eye(SIZE), (n, 1, 1)), np.zeros((n, SIZE, 3)), np.zeros((n, SIZE, SIZE))
    lasts = np.exp(-step / EKF_TIME)
    lasting = (GPS_ERROR_TIME, GPS_ERROR_TIME, noise.gps_height_time)
    # White noise drives d; steps are short against the correlation time, so the leading terms do.
    powers = step[:, None, None] ** np.array([[5, 4, 3], [4, 3, 2], [3, 2, 1]])
    spread = powers / np.array([[20.0, 8.0, 6.0], [8.0, 3.0, 2.0], [6.0, 2.0, 1.0]])
    for axis, time in enumerate(TIMES):
        p, v, d, e, autopilot = axis, 3 + axis, 6 + axis, 9 + axis, 13 + axis
        a, stay = np.exp(-step / time), np.exp(-step / lasting[axis])
        # Exact integrals of a disturbance that decays with a.
        to_v = time * (1.0 - a)
        to_p = time * (step - to_v)
        F[:, p, v], F[:, p, d], F[:, v, d], F[:, d, d], F[:, e, e] = step, to_p, to_v, a, stay
        B[:, p, axis], B[:, v, axis] = 0.5 * step**2, step
        density = 2.0 * driven[:, axis] ** 2 / time
        Q[:, p : d + 1 : 3, p : d + 1 : 3] = density[:, None, None] * spread
        Q[:, e, e] = (1.0 - stay**2) * gps_sigma[axis] ** 2
        F[:, autopilot, autopilot] = lasts
        Q[:, autopilot, autopilot] = (1.0 - lasts**2) * driven[:, 3 + axis] ** 2
    Q[:, 12, 12] = noise.baro_walk**2 * step
    return F, B, Q


def nodes_of(t: np.ndarray, measured: list[Measured]) -> np.ndarray:
    """Return at which of the times `t` each row was measured; both lie on ticks."""
    return np.searchsorted(np.round(t / TICK), np.round(np.array([m.t for m in measured]) / TICK))


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
    squares = x**2 + np.diagonal(P, axis1=1, axis2=2)
    total = np.concatenate([np.zeros((1, 3)), np.cumsum(squares[:, 6:9], axis=0)])
    first, last = np.searchsorted(t, t - SPAN / 2), np.searchsorted(t, t + SPAN / 2, side="right")
    mean = (total[last] - total[first]) / (last - first)[:, None]
    lasting = np.tile(squares[:, 13:16].mean(axis=0), (len(t), 1))
    least = np.append(DISTURBANCE, np.full(3, EKF_LASTING))
    return np.asarray(np.maximum(np.sqrt(np.hstack([mean, lasting])), least))


def rescaled(measured: list[Measured], t: np.ndarray, x: np.ndarray, P: np.ndarray) -> list[Measured]:
    """Return rows whose variances are raised to what their residuals show (variance factors: Koch 1999, 3.6).

    A sensor that contradicts the others by more than its noise makes sigma too small, which shows where rows are left
    out: states then move by more than it. No variance is lowered: errors that last do not show in residuals.
    """
    node = nodes_of(t, measured)
    innovations: dict[tuple[str, int], tuple[list[float], list[float], list[float]]] = {}
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
            when, residuals, variances = innovations.setdefault(key, ([], [], []))
            when.append(m.t)
            residuals.append(float(one))
            variances.append(float(variance))
    factor = {
        key: variance_factor(*map(np.array, rows)) for key, rows in innovations.items() if len(rows[0]) >= FEWEST_ROWS
    }
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


#: 1-sigma of an autopilot's attitude, rad: tilt and yaw.
TILT_SIGMA, YAW_SIGMA = np.radians(0.7), np.radians(3.0)
#: The filter steps at least so often, s; a hole in the data longer than this splits the trajectory, s.
LONGEST_STEP, LONGEST_HOLE = 0.25, 20.0
#: Passes over a stretch of telemetry at most, each leaving out what disagrees with all the rest.
PASSES = 6


def estimate_low_rate(
    tables: Tables, *, rate: float, start: float | None, stop: float | None, noise: SensorNoise, smoothed: bool
) -> Trajectory:
    """Filter and smooth telemetry."""
    attitude = usable(tables.attitude, ["roll", "pitch", "yaw"])
    assert attitude is not None  # the caller asked for it
    origin, measured, gps_sigma, source = measurements_of(tables, noise)
    if usable(tables.baro, ["alt"]) is None:
        noise = replace(noise, gps_height_time=GPS_ERROR_TIME)
    wrong = reversed_climb(tables)
    parts = []
    for piece in segments(attitude, LONGEST_HOLE):
        begin = max(float(piece.index[0]), -np.inf if start is None else start)
        end = min(float(piece.index[-1]), np.inf if stop is None else stop)
        t = np.arange(np.ceil(begin * rate), np.floor(end * rate) + 1) / rate
        within = [m for m in measured if piece.index[0] <= m.t <= piece.index[-1]]
        if len(piece) < 4 or len(within) < 2 or t.size == 0:
            continue
        parts.append(_estimate_segment(piece, within, t, gps_sigma, noise, smoothed))
    if not parts:
        raise MissingDataError(
            "attitude and positions are logged, but at no time both for long enough to make a trajectory: raise the "
            "telemetry rates of position and attitude to 4 Hz or more"
        )
    states = pd.concat([part[0] for part in parts])
    sigma = pd.concat([part[1] for part in parts])
    innovations = _innovations([part[3] for part in parts])
    doubts = [*doubtful_sensors(innovations), *contradicted_receiver(tables, states, origin, 0.0, velocities=False)]
    finding = warning(
        "not-logged",
        "No IMU fast enough to integrate: the trajectory comes from the autopilot's attitude and "
        f"{source} at telemetry rate; accelerations faster than about 1 Hz are missing.",
        "Analyse the .bin log of the same flight where there is one.",
        attitude_rate_hz=float(1.0 / np.median(np.diff(attitude.index.to_numpy(float)))),
    )
    return Trajectory(
        states=states,
        sigma=sigma,
        covariance=np.concatenate([part[2] for part in parts]),
        origin=origin,
        method="low-rate",
        diagnostics={
            "position_source": source,
            "segments": [(float(s.index[0]), float(s.index[-1])) for s, *_ in parts],
            "innovations": innovations,
        },
        findings=(finding, *wrong, *only_one_withdrawal(doubts)),
    )


def _innovations(stretches: list[dict[str, np.ndarray]]) -> dict[str, SensorStatistics]:
    """Sum up over the stretches of a log what of each sensor was fused and refused, and how far it was off."""
    statistics: dict[str, SensorStatistics] = {}
    for sensor in sorted({name for part in stretches for name in part}):
        nis = np.concatenate([part[sensor] for part in stretches if sensor in part])
        fused = nis[np.isfinite(nis)]
        statistics[sensor] = {
            "count": fused.size,
            "refused": nis.size - fused.size,
            "nis": float(fused.mean()) if fused.size else float("nan"),
        }
    return statistics


def _estimate_segment(
    attitude: pd.DataFrame,
    measured: list[Measured],
    t: np.ndarray,
    gps_sigma: np.ndarray,
    noise: SensorNoise,
    smoothed: bool,
) -> tuple[pd.DataFrame, pd.DataFrame, np.ndarray, dict[str, np.ndarray]]:
    """Filter, smooth and lay out one stretch of telemetry.

    Returns states, sigma, covariance (n, 3, 3, 3), and of each sensor's rows the normalised innovations squared.
    """
    when = attitude.index.to_numpy(float)
    quat = quat_from_euler(*attitude[["roll", "pitch", "yaw"]].to_numpy(float).T)
    turning = scipy.interpolate.Akima1DInterpolator(when, continuous(quat))
    down_axis = matrix_from_quat(quat)[:, :, 2]
    # Beyond 60 degrees of tilt the height is not steady, so the tangent is not the acceleration.
    push = -STANDARD_GRAVITY * down_axis[:, :2] / np.maximum(down_axis[:, 2:], 0.5)
    thrust = scipy.interpolate.Akima1DInterpolator(when, np.column_stack([push, np.zeros(len(push))]))

    nodes = np.unique(
        np.concatenate(
            [
                np.round(np.array([m.t for m in measured]) / TICK),
                np.round(np.append(np.arange(when[0], when[-1], LONGEST_STEP), when[-1]) / TICK),
            ]
        )
    )
    node_t = nodes * TICK
    driven = np.tile(np.append(DISTURBANCE, np.full(3, EKF_LASTING)), (len(node_t), 1))
    given = measured
    for _ in range(PASSES if smoothed else 1):
        x, P, nis = filter_telemetry(node_t, thrust, measured, gps_sigma, noise, driven, smoothed=smoothed)
        judged = judged_rows(given, measured, node_t, x, P, noise.gate) if smoothed else measured
        judged = softened(judged, node_t, x, P) if smoothed else judged
        if all(alike(a, b) for a, b in zip(measured, judged, strict=True)):
            break
        measured = judged
    if smoothed:
        driven = driven_by(node_t, x, P)
        x, P, nis = filter_telemetry(node_t, thrust, measured, gps_sigma, noise, driven)
        # Sigma only: weighed anew, states of clean logs would move by more than their sigma, for better or worse.
        _, P, _ = filter_telemetry(node_t, thrust, rescaled(measured, node_t, x, P), gps_sigma, noise, driven)
    t_in = np.clip(t, node_t[0], node_t[-1])
    position = scipy.interpolate.CubicHermiteSpline(node_t, x[:, :3], x[:, 3:6])(t_in)
    at_node = thrust(np.clip(node_t, when[0], when[-1]))
    # Velocity between nodes bends as the attitude says.
    acceleration = x[:, 6:9] + at_node
    velocity = scipy.interpolate.CubicHermiteSpline(node_t, x[:, 3:6], acceleration)(t_in)
    disturbance = np.column_stack([np.interp(t_in, node_t, column) for column in x[:, 6:9].T])
    a = disturbance + thrust(np.clip(t, when[0], when[-1]))
    q = turning(t)
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    q_rate = turning.derivative()(t)
    rate_b = 2.0 * multiply(q * np.array([1.0, -1.0, -1.0, -1.0]), q_rate)[:, 1:]
    force_b = np.einsum("nji,nj->ni", matrix_from_quat(q), a - np.array([0.0, 0.0, STANDARD_GRAVITY]))
    index = pd.Index(t, name="t")
    states = pd.DataFrame(
        np.column_stack([position, velocity, q, rate_b, force_b]), index=index, columns=[*STATE_COLUMNS]
    )
    covariance = np.zeros((len(t), 3, 3, 3))
    flat = P[:, :6, :6].reshape(len(nodes), 36)
    known = np.column_stack([np.interp(t_in, node_t, column) for column in flat.T]).reshape(-1, 6, 6)
    covariance[:, 0], covariance[:, 1] = known[:, :3, :3], known[:, 3:, 3:]
    covariance[:, 2] = np.diag([TILT_SIGMA, TILT_SIGMA, YAW_SIGMA]) ** 2
    variance = np.diagonal(covariance, axis1=2, axis2=3).reshape(-1, 9)
    sigma = pd.DataFrame(np.sqrt(variance), index=index, columns=[*SIGMA_COLUMNS])
    return states, sigma, covariance, _squares(measured, nis)


def _squares(measured: list[Measured], nis: np.ndarray) -> dict[str, np.ndarray]:
    """Return the normalised innovations squared of each sensor's rows, NaN where refused."""
    sensors = np.array([m.sensor for m in measured])
    return {sensor: nis[sensors == sensor] for sensor in np.unique(sensors).tolist()}
