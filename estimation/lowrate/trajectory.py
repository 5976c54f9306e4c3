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

from core.units import STANDARD_GRAVITY
from estimation.attitude import continuous, matrix_from_quat, multiply, quat_from_euler
from estimation.consistency import SensorStatistics
from estimation.lowrate.measurements import Measured, measurements_of, reversed_climb
from estimation.lowrate.smoother import EKF_LASTING, GPS_ERROR_TIME, filter_telemetry
from estimation.lowrate.weights import DISTURBANCE, alike, driven_by, judged_rows, rescaled, softened
from estimation.states import SensorNoise
from estimation.timing import TICK, segments, usable
from estimation.trajectory import SIGMA_COLUMNS, STATE_COLUMNS, Trajectory
from estimation.trust import contradicted_receiver, doubtful_sensors, only_one_withdrawal
from logparse import Finding, MissingDataError, Severity, Tables

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
        findings=(finding, *wrong, *only_one_withdrawal(doubts)),
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
