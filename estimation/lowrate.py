"""A trajectory from telemetry: attitude and positions at a few hertz, no IMU worth integrating.

The autopilot's attitude is taken as it is. It tells which way the thrust points, and with the height nearly steady how
large the horizontal part of it is; what that leaves out (drag, wind, climbing) is a slowly varying acceleration to be
estimated. So the problem is linear with a known input, and filtered by filterpy's `KalmanFilter`. filterpy's own
smoothers know no input, and of its two the module's function pairs the wrong F where F varies; so the
Rauch-Tung-Striebel recursion stands here, on the priors that the filter itself made.
"""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import scipy
from filterpy.kalman import KalmanFilter

from estimation.attitude import continuous, matrix_from_quat, multiply, quat_from_euler
from estimation.consistency import SensorStatistics
from estimation.height_spikes import steady_heights
from estimation.local_frame import LocalFrame, is_simulated
from estimation.observations import find_origin, observe_gps, reported, usable_fixes
from estimation.states import SensorNoise
from estimation.timing import TICK, segments, usable
from estimation.trajectory import SIGMA_COLUMNS, STATE_COLUMNS, Trajectory
from estimation.trust import contradicted_receiver, doubtful_sensors, only_one_withdrawal
from logparse import Finding, Geodetic, MissingDataError, Severity, Tables
from logparse.units import STANDARD_GRAVITY

#: Acceleration that attitude does not tell: 1-sigma at least [m/s^2] and correlation time [s], horizontally (drag and
#: gusts, twice) and vertically (climbs); and over what the log sets it, s.
DISTURBANCE = np.array([0.7, 0.7, 1.0])
TIMES, SPAN = (3.0, 3.0, 1.0), 20.0
#: 1-sigma of an autopilot's attitude, rad: tilt and yaw.
TILT_SIGMA, YAW_SIGMA = np.radians(0.7), np.radians(3.0)
#: White 1-sigma of the autopilot's own position and velocity estimate, m and m/s.
EKF_POSITION, EKF_VELOCITY = 0.05, 0.1
#: What lasts of its velocity's error: 1-sigma at least, m/s, and for how long, s. Taken for white, an error of 0.1 m/s
#: over minutes outvoted a receiver by 80 m.
EKF_LASTING, EKF_TIME = 0.2, 30.0
#: Correlation time of the GPS error here, s. Velocities at telemetry rate are too coarse to tell a wander of the GPS
#: over minutes from a wander of the craft, so it is held to be nearly constant: known in size, not in course.
GPS_ERROR_TIME = 1000.0
#: The filter steps at least so often, s; a hole in the data longer than this splits the trajectory, s.
LONGEST_STEP, LONGEST_HOLE = 0.25, 20.0
#: The autopilot's positions are used where GPS fixes are further away than this, s.
FILL_AFTER = 1.0
#: What a row may differ by from all the others without being refused whatever its own noise, m and m/s: attitude at
#: telemetry rate tells no more of what lies between two rows.
TOLERANCE = 0.5
#: How well the time of a telemetry row is known, s: a fast craft's rows differ by that times its speed.
LATENESS = 0.2
#: Passes over a stretch of telemetry at most, each leaving out what disagrees with all the rest.
PASSES = 6
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
#: Readings of the barometer whose median is its height at the start: any one may be a spike.
FIRST_HEIGHTS = 9
#: Old firmware sends the vertical speed with the wrong sign: it is turned round if the autopilot's height goes against
#: it with this correlation, and left out with less; judged where the r.m.s. of the speed is above this, m/s.
OPPOSITE, CLIMBS = 0.8, 0.3
#: States: position, velocity, disturbance, GPS error (three each), baro offset, autopilot's velocity error (three).
SIZE = 16


@dataclass(frozen=True, slots=True)
class _Measured:
    """One row of measurements: time [s], sensor, rows of H, values, variances, and whether it may be fused."""

    t: float
    sensor: str
    H: np.ndarray
    z: np.ndarray
    variance: np.ndarray
    admitted: bool = True


def estimate_low_rate(
    tables: Tables, *, rate: float, start: float | None, stop: float | None, noise: SensorNoise, smoothed: bool
) -> Trajectory:
    """Filter and smooth telemetry.

    Parameters
    ----------
    tables : Tables
        Of a log with attitude and positions.
    rate : float
        Rows of the trajectory per second.
    start, stop : float or None
        Span of time to give, s; None for all of it.
    noise : SensorNoise
        What to believe of the sensors.
    smoothed : bool
        False gives the forward filter.
    """
    attitude = usable(tables.attitude, ["roll", "pitch", "yaw"])
    assert attitude is not None  # the caller asked for it
    origin, measured, gps_sigma, source = _measurements(tables, noise)
    reversed_climb = _reversed_climb(tables)
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
    doubts = doubtful_sensors(innovations) + contradicted_receiver(tables, states, origin, 0.0, velocities=False)
    finding = Finding(
        "low-rate-trajectory",
        Severity.WARNING,
        "No IMU fast enough to integrate: the trajectory comes from the autopilot's attitude and "
        f"{source} at telemetry rate; accelerations faster than about 1 Hz are missing.",
        "Analyse the .bin log of the same flight where there is one.",
        {"attitude_rate_hz": float(1.0 / np.median(np.diff(attitude.index.to_numpy(float))))},
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
        findings=(finding, *reversed_climb, *only_one_withdrawal(doubts)),
    )


def _innovations(stretches: list[dict[str, np.ndarray]]) -> dict[str, SensorStatistics]:
    """Sum up over the stretches of a log what of each sensor was fused and refused, and how far it was off."""
    found: dict[str, SensorStatistics] = {}
    for sensor in sorted({name for part in stretches for name in part}):
        nis = np.concatenate([part[sensor] for part in stretches if sensor in part])
        fused = nis[np.isfinite(nis)]
        found[sensor] = {
            "count": fused.size,
            "refused": nis.size - fused.size,
            "nis": float(fused.mean()) if fused.size else float("nan"),
        }
    return found


def _measurements(tables: Tables, noise: SensorNoise) -> tuple[Geodetic, list[_Measured], np.ndarray, str]:
    """Return origin, measurements in order of time, 1-sigma of the GPS error (3,) and what the positions came from."""
    fixes = usable_fixes(tables.gps)
    ekf = usable(tables.ekf, ["p_n", "p_e", "p_d", "v_n", "v_e", "v_d"])
    rows: list[_Measured] = []
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
        (_, fixed, position, p_variance), (_, _, velocity, v_variance) = observe_gps(fixes, frame, noise)
        both = np.hstack([position, velocity]), np.hstack([p_variance, v_variance])
        for when, z, variance in zip(fixed, *both, strict=True):
            there = np.isfinite(z)
            rows.append(_Measured(when, "gps_position", selector[there], z[there], variance[there]))
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
            rows.append(_Measured(when, "autopilot", seen[part], row[part], variance[part]))
        sources.append("the autopilot's " + ("positions" if lonely.any() else "velocities"))
    baro = usable(tables.baro, ["alt"])
    if baro is not None:
        H = np.zeros((1, SIZE))
        H[0, 2], H[0, 12] = -1.0, 1.0
        # A spike does not even enter the first pass, which nothing protects.
        steady = steady_heights(baro["alt"], _other_height(fixes, ekf), _climb(ekf))
        for when, alt, good in zip(baro.index.to_numpy(float), baro["alt"].to_numpy(float), steady, strict=True):
            rows.append(_Measured(when, "baro", H, np.array([alt]), np.array([noise.baro**2]), bool(good)))
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


def _reversed_climb(tables: Tables) -> tuple[Finding, ...]:
    """Return a finding if the autopilot's vertical speed has the wrong sign."""
    ekf = usable(tables.ekf, ["p_n", "p_e", "p_d", "v_n", "v_e", "v_d"])
    sign = 1.0 if ekf is None else _climb_sign(ekf)
    if sign == 1.0:
        return ()
    used = "is used with its sign reversed" if sign < 0.0 else "is not used"
    return (
        Finding(
            "autopilot-climb-wrong",
            Severity.WARNING,
            f"The autopilot's height changes against its vertical speed, which therefore {used}; firmware of 2013 "
            "sends it with the wrong sign.",
            "Analyse the .bin log of the same flight, or update the firmware.",
        ),
    )


def _distance(t: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Time from each of `t` to the nearest of the sorted `others`, s."""
    after = np.clip(np.searchsorted(others, t), 0, len(others) - 1)
    before = np.maximum(after - 1, 0)
    return np.asarray(np.minimum(np.abs(others[after] - t), np.abs(others[before] - t)))


def _estimate_segment(
    attitude: pd.DataFrame,
    measured: list[_Measured],
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
        x, P, nis = _filter(node_t, thrust, measured, gps_sigma, noise, driven, smoothed=smoothed)
        judged = _softened(_judged(given, measured, node_t, x, P, noise.gate), node_t, x, P) if smoothed else measured
        if all(_alike(a, b) for a, b in zip(measured, judged, strict=True)):
            break
        measured = judged
    if smoothed:
        driven = _driven(node_t, x, P)
        x, P, nis = _filter(node_t, thrust, measured, gps_sigma, noise, driven)
        # Sigma only: weighed anew, states of clean logs would move by more than their sigma, for better or worse.
        _, P, _ = _filter(node_t, thrust, _rescaled(measured, node_t, x, P), gps_sigma, noise, driven)
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


def _nodes(t: np.ndarray, measured: list[_Measured]) -> np.ndarray:
    """Return at which of the times `t` each row was measured; both lie on ticks."""
    return np.searchsorted(np.round(t / TICK), np.round(np.array([m.t for m in measured]) / TICK))


def _alike(one: _Measured, other: _Measured) -> bool:
    """Whether two passes use a row alike."""
    close = np.abs(np.log(one.variance / other.variance)).max(initial=0.0) < SETTLED
    return one.admitted == other.admitted and bool(close)


def _softened(measured: list[_Measured], t: np.ndarray, x: np.ndarray, P: np.ndarray) -> list[_Measured]:
    """Raise the variance of readings of the barometer that are off by more than `HONEST` of their sigmas.

    Iterated, this is the estimate by a loss that stops growing there (reweighted least squares: Holland & Welsch 1977).
    """
    node = _nodes(t, measured)
    out = []
    for m, at in zip(measured, node, strict=True):
        if m.admitted and m.sensor == "baro":
            expected = m.variance + np.einsum("ij,jk,ik->i", m.H, P[at], m.H) + TOLERANCE**2
            beyond = np.maximum((m.z - m.H @ x[at]) ** 2 / HONEST**2 - expected, 0.0)
            out.append(replace(m, variance=m.variance + beyond))
        else:
            out.append(m)
    return out


def _judged(
    given: list[_Measured], measured: list[_Measured], t: np.ndarray, x: np.ndarray, P: np.ndarray, gate: float
) -> list[_Measured]:
    """Leave out of the rows `given` what is far from the smoothed states, and take back what is not.

    As `admission.admit` does; `measured` are the rows that made the states. What is out of `given` already comes back
    only where it weighs in full.
    """
    node = _nodes(t, measured)
    worst = np.zeros(len(measured))
    speed = _measured_speed(measured)
    for k, (m, at) in enumerate(zip(given, node, strict=True)):
        late = (LATENESS * speed[k]) ** 2
        variance = m.variance + np.einsum("ij,jk,ik->i", m.H, P[at], m.H) + TOLERANCE**2 + late
        worst[k] = np.sqrt(np.max((m.z - m.H @ x[at]) ** 2 / variance, initial=0.0))
    sensors = np.array([m.sensor for m in measured])
    fused = np.array([m.admitted for m in measured])
    limit = np.where([m.admitted for m in given], gate, HONEST)
    for sensor in np.unique(sensors):
        mine = (sensors == sensor) & fused
        limit[mine] = max(gate, float(worst[mine].max(initial=0.0)) / NARROWING)
    return [replace(m, admitted=bool(w <= most)) for m, w, most in zip(given, worst, limit, strict=True)]


def _driven(t: np.ndarray, x: np.ndarray, P: np.ndarray) -> np.ndarray:
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


def _rescaled(measured: list[_Measured], t: np.ndarray, x: np.ndarray, P: np.ndarray) -> list[_Measured]:
    """Return rows whose variances are raised to what their residuals show (variance factors: Koch 1999, 3.6).

    A sensor that contradicts the others by more than its noise makes sigma too small, which shows where rows are left
    out: states then move by more than it. No variance is lowered: errors that last do not show in residuals.
    """
    node = _nodes(t, measured)
    found: dict[tuple[str, int], tuple[list[float], list[float], list[float]]] = {}
    keys = []
    for m, at in zip(measured, node, strict=True):
        keys.append([(m.sensor, int(np.flatnonzero(row)[0])) for row in m.H])
        if not m.admitted:
            continue
        # What lasts in the autopilot's velocity counts, though it is a state: where another sensor is lost nothing
        # tells it from a climb.
        residual = m.z - m.H[:, :13] @ x[at, :13]
        expected = m.variance - np.einsum("ij,jk,ik->i", m.H, P[at], m.H)
        for key, one, variance in zip(keys[-1], residual, expected, strict=True):
            when, residuals, variances = found.setdefault(key, ([], [], []))
            when.append(m.t)
            residuals.append(float(one))
            variances.append(float(variance))
    factor = {key: _factor(*map(np.array, rows)) for key, rows in found.items() if len(rows[0]) >= FEWEST_ROWS}
    return [
        replace(m, variance=m.variance * np.array([factor.get(key, 1.0) for key in mine]))
        for m, mine in zip(measured, keys, strict=True)
    ]


def _factor(t: np.ndarray, residuals: np.ndarray, expected: np.ndarray) -> float:
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


def _measured_speed(measured: list[_Measured]) -> np.ndarray:
    """Return the speed about each row by what receiver and autopilot measured, m/s; the states may have a spike's."""
    known = [(m.t, float(np.linalg.norm(m.z[m.H[:, 3:6].any(axis=1)]))) for m in measured if m.H[:, 3:6].any()]
    if not known:
        return np.zeros(len(measured))
    t, speed = np.array(known).T
    return np.asarray(np.interp([m.t for m in measured], t, speed))


def _squares(measured: list[_Measured], nis: np.ndarray) -> dict[str, np.ndarray]:
    """Return the normalised innovations squared of each sensor's rows, NaN where refused."""
    sensors = np.array([m.sensor for m in measured])
    return {sensor: nis[sensors == sensor] for sensor in np.unique(sensors).tolist()}


def _filter(
    t: np.ndarray,
    thrust: scipy.interpolate.Akima1DInterpolator,
    measured: list[_Measured],
    gps_sigma: np.ndarray,
    noise: SensorNoise,
    driven: np.ndarray,
    *,
    smoothed: bool = True,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Run filterpy's filter over the nodes, to smooth Rauch-Tung-Striebel back.

    Returns x (n, 16), P (n, 16, 16) and the mean normalised innovation squared of each row, NaN where it was refused.
    """
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
    nodes = _nodes(t, measured)
    x, P = np.empty((len(t), SIZE)), np.empty((len(t), SIZE, SIZE))
    nis = np.full(len(measured), np.nan)
    prior_x, prior_P, F = np.empty_like(x), np.empty_like(P), np.empty_like(P)
    # Mean input of each step by Simpson's rule.
    edge = np.clip(t, thrust.x[0], thrust.x[-1])
    at, middle = thrust(edge), thrust(0.5 * (edge[1:] + edge[:-1]))
    mean_push = (at[:-1] + 4.0 * middle + at[1:]) / 6.0
    done = 0
    for k in range(len(t)):
        if k:
            step = t[k] - t[k - 1]
            kf.F, kf.B, kf.Q = _transition(step, driven[k], gps_sigma, noise)
            kf.predict(u=mean_push[k - 1][:, None])
        F[k], prior_x[k], prior_P[k] = kf.F, kf.x[:, 0], kf.P
        while done < len(measured) and nodes[done] == k:
            m = measured[done]
            done += 1
            if not m.admitted:
                continue
            kf.update(m.z[:, None], R=np.diag(m.variance), H=m.H)
            nis[done - 1] = np.mean(kf.y[:, 0] ** 2 / np.diag(kf.S))
        x[k], P[k] = kf.x[:, 0], kf.P
    for k in range(len(t) - 2, -1, -1) if smoothed else ():
        gain = np.linalg.solve(prior_P[k + 1], F[k + 1] @ P[k]).T
        x[k] += gain @ (x[k + 1] - prior_x[k + 1])
        P[k] += gain @ (P[k + 1] - prior_P[k + 1]) @ gain.T
    return x, P, nis


def _transition(
    step: float, driven: np.ndarray, gps_sigma: np.ndarray, noise: SensorNoise
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """F, B and Q over one step: disturbance and errors of GPS and autopilot are Gauss-Markov, the rest follows."""
    F, B, Q = np.eye(SIZE), np.zeros((SIZE, 3)), np.zeros((SIZE, SIZE))
    stay, lasts = np.exp(-step / GPS_ERROR_TIME), np.exp(-step / EKF_TIME)
    for axis, time in enumerate(TIMES):
        p, v, d, e = axis, 3 + axis, 6 + axis, 9 + axis
        a = np.exp(-step / time)
        # Exact integrals of a disturbance that decays with a.
        to_v = time * (1.0 - a)
        to_p = time * (step - to_v)
        F[p, v], F[p, d], F[v, d], F[d, d], F[e, e] = step, to_p, to_v, a, stay
        B[p, axis], B[v, axis] = 0.5 * step**2, step
        # White noise of density q drives d; steps are short against the correlation time, so the leading terms do.
        q = 2.0 * driven[axis] ** 2 / time
        Q[np.ix_([p, v, d], [p, v, d])] = q * np.array(
            [
                [step**5 / 20.0, step**4 / 8.0, step**3 / 6.0],
                [step**4 / 8.0, step**3 / 3.0, step**2 / 2.0],
                [step**3 / 6.0, step**2 / 2.0, step],
            ]
        )
        Q[e, e] = (1.0 - stay**2) * gps_sigma[axis] ** 2
        F[13 + axis, 13 + axis], Q[13 + axis, 13 + axis] = lasts, (1.0 - lasts**2) * driven[3 + axis] ** 2
    Q[12, 12] = noise.baro_walk**2 * step
    return F, B, Q
