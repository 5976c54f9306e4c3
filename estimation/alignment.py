"""Where the filter starts: position, velocity and attitude at the first IMU sample, and how wrong they may be."""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from core.attitude import euler_from_quat, matrix_from_quat, quat_from_euler, turned_by
from core.units import STANDARD_GRAVITY
from estimation.filter import Filtered
from estimation.observations import reported, usable_field, usable_fixes, usable_ranges
from estimation.place import LocalFrame
from estimation.states import (
    ACCEL_BIAS,
    ATTITUDE,
    BARO_BIAS,
    FIELD,
    GYRO_BIAS,
    HARD_IRON,
    POSITION,
    SIZE,
    TERRAIN,
    VELOCITY,
    WANDERING,
    SensorNoise,
)
from estimation.timing import ACCEL, GYRO, usable
from logparse import Tables

#: A craft counts as standing still while its rates and forces stay this near their medians, rad/s and m/s^2.
STILL_RATE, STILL_FORCE = 0.03, 0.4
#: Seconds of standing still that are averaged, and the least that is trusted.
STILL_LONGEST, STILL_SHORTEST = 5.0, 1.0
#: Motors above this carry the craft (spin-up ends near 1150 us, hover is above 1300 us); GPS noise on the ground is
#: below this speed, m/s.
RUNNING_PWM, GROUND_SPEED = 1250.0, 1.0
#: A force at rest that differs so much from the autopilot's attitude is biased, rad.
TILT_DOUBTED = np.radians(5.0)
#: Attitude of a start that is lost, 1-sigma, rad.
LOST = 1.0
#: Share of a sensor error's first uncertainty that a hole in the log brings back: what happened in it is not known.
UNSEEN_SHARE = 0.1


@dataclass(frozen=True, slots=True)
class Alignment:
    """The start of one segment."""

    #: shape (29,): Nominal state: position, velocity, quaternion, sensor errors in the order of `states`.
    x: np.ndarray
    P: np.ndarray  #: shape (28, 28): Covariance of its error.
    still: bool  #: Found standing still before flight.
    yaw_source: str  #: ``"magnetometer"``, ``"autopilot"``, ``"movement"`` or ``"unknown"``.
    levelled: bool  #: Whether tilt was read off the accelerometer, and is as wrong as its bias makes it.


def still_span(imu: pd.DataFrame) -> float:
    """Return the seconds from the first row for which the craft stands as still as on the ground."""
    t = imu.index.to_numpy(float)
    head = imu[t <= t[0] + STILL_LONGEST]
    gyro, force = head[GYRO].to_numpy(float), head[ACCEL].to_numpy(float)
    first = slice(0, max(3, len(head) // 5))
    moving = (np.abs(gyro - np.median(gyro[first], axis=0)) > STILL_RATE).any(axis=1)
    moving |= (np.abs(force - np.median(force[first], axis=0)) > STILL_FORCE).any(axis=1)
    moving |= (np.abs(gyro) > 0.2).any(axis=1)
    end = int(np.argmax(moving)) if moving.any() else len(head)
    return float(t[max(end - 1, 0)] - t[0])


def align(
    tables: Tables,
    imu: pd.DataFrame,
    frame: LocalFrame | None,
    field: np.ndarray | None,
    noise: SensorNoise,
    *,
    heading_known: bool = True,
) -> Alignment:
    """Find the start of a segment from its first seconds."""
    start = float(imu.index[0])
    span = still_span(imu)
    still = span >= STILL_SHORTEST and not _under_way(tables, start, start + span)
    head = imu[imu.index <= imu.index[0] + (span if still else 1.0)]
    force = head[ACCEL].to_numpy(float).mean(axis=0)
    sigma = np.zeros(SIZE)
    x = np.zeros(SIZE + 1)

    logged = _logged_attitude(tables, start)
    roll = np.arctan2(-force[1], -force[2])
    pitch = np.arctan2(force[0], np.hypot(force[1], force[2]))
    tilt_sigma = np.radians(2.0)
    levelled = logged is None or (still and np.hypot(logged[0] - roll, logged[1] - pitch) < TILT_DOUBTED)
    if still and not levelled and logged is not None:
        # The autopilot has been corrected by more than these seconds of a force that may be biased.
        roll, pitch, tilt_sigma = logged[0], logged[1], np.radians(5.0)
    if not still:
        # In flight the force of a multirotor is along its own axis whatever the tilt, so it says little.
        tilt_sigma = np.radians(15.0)
        if logged is not None:
            roll, pitch = logged[0], logged[1]
            tilt_sigma = np.radians(5.0)
    yaw, yaw_sigma, yaw_source = _initial_yaw(tables, start, roll, pitch, logged if heading_known else None, field)
    x[6:10] = quat_from_euler(roll, pitch, yaw)
    sigma[ATTITUDE : ATTITUDE + 3] = tilt_sigma, tilt_sigma, yaw_sigma
    if still:
        x[10:13] = head[GYRO].to_numpy(float).mean(axis=0)
    sigma[GYRO_BIAS : GYRO_BIAS + 3] = min(noise.gyro_bias, 0.003) if still else noise.gyro_bias
    sigma[ACCEL_BIAS : ACCEL_BIAS + 3] = noise.accel_bias

    _place(tables, start, still, frame, noise, x, sigma)
    if field is not None:
        x[FIELD + 1 : TERRAIN + 1] = field
        sigma[HARD_IRON : HARD_IRON + 3] = noise.hard_iron
        sigma[FIELD : FIELD + 3] = noise.field
    P = np.diag(sigma**2)
    if levelled:
        _levelled(P, x, yaw_source, P[ATTITUDE:GYRO_BIAS, ATTITUDE:GYRO_BIAS].copy())
    return Alignment(x, P, still, yaw_source, levelled)


def _attitude_of_bias(x: np.ndarray, yaw_source: str) -> np.ndarray:
    """Return the attitude error that accelerometer biases make in a craft that was levelled by its forces.

    At rest ``exp([phi]x) R (f - b) = -g``: to first order phi is R b turned by 90 degrees, over g. A magnetometer that
    is levelled so turns heading by the tilt about magnetic north times the tangent of the dip. Shape (3, 3).
    """
    R = matrix_from_quat(x[6:10])
    J = np.array([R[1], -R[0], np.zeros(3)]) / STANDARD_GRAVITY
    m_n, m_e, m_d = x[FIELD + 1 : TERRAIN + 1]
    if yaw_source == "magnetometer":
        J[2] = m_d * (m_n * J[0] + m_e * J[1]) / (m_n**2 + m_e**2)
    return J


def _levelled(P: np.ndarray, x: np.ndarray, yaw_source: str, own: np.ndarray) -> None:
    """Fill a covariance with the attitude error that goes with the accelerometer's bias, and its `own`, in place."""
    attitude, bias = slice(ATTITUDE, ATTITUDE + 3), slice(ACCEL_BIAS, ACCEL_BIAS + 3)
    J = _attitude_of_bias(x, yaw_source)
    P[attitude, bias] = J @ P[bias, bias]
    P[bias, attitude] = P[attitude, bias].T
    P[attitude, attitude] = own + J @ P[bias, bias] @ J.T


def _own(P: np.ndarray, x: np.ndarray, yaw_source: str) -> np.ndarray:
    """Return the covariance of attitude less what the accelerometer's bias adds to it, shape (3, 3)."""
    attitude, bias = slice(ATTITUDE, ATTITUDE + 3), slice(ACCEL_BIAS, ACCEL_BIAS + 3)
    J = _attitude_of_bias(x, yaw_source)
    return np.asarray(P[attitude, attitude] - J @ P[bias, bias] @ J.T)


def _under_way(tables: Tables, start: float, stop: float) -> bool:
    """Return whether motors or GPS speak against standing still: a calm hover can be as steady as the ground."""
    if tables.motors is not None:
        running = tables.motors.loc[start:stop].to_numpy(float)
        running = running[np.isfinite(running)]
        if running.size and np.median(running) > RUNNING_PWM:
            return True
    fixes = usable_fixes(tables.gps)
    if fixes is None:
        return False
    velocity = fixes.loc[start:stop, ["v_n", "v_e"]].to_numpy(float)
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    speed = speed[np.isfinite(speed)]
    return bool(speed.size and np.median(speed) > GROUND_SPEED)


def turned(aligned: Alignment, yaw: float, yaw_sigma: float) -> Alignment:
    """Return an alignment with another heading and its 1-sigma, rad."""
    x, P = aligned.x.copy(), aligned.P.copy()
    roll, pitch, _ = euler_from_quat(x[6:10])
    x[6:10] = quat_from_euler(roll, pitch, yaw)
    own = _own(P, aligned.x, aligned.yaw_source) if aligned.levelled else P[ATTITUDE:GYRO_BIAS, ATTITUDE:GYRO_BIAS]
    own[2, 2] = yaw_sigma**2
    if aligned.levelled:
        _levelled(P, x, "movement", own)
    return replace(aligned, x=x, P=P, yaw_source="movement")


def lost(aligned: Alignment) -> Alignment:
    """Return an alignment of whose attitude next to nothing is known."""
    P, attitude = aligned.P.copy(), slice(ATTITUDE, ATTITUDE + 3)
    P[attitude] = P[:, attitude] = 0.0
    P[attitude, attitude] = np.eye(3) * LOST**2
    return replace(aligned, P=P, levelled=False)


def with_priors(aligned: Alignment, before: SensorNoise, noise: SensorNoise) -> Alignment:
    """Return a start with the sensor errors' priors of other noise settings than it was made with `before`."""
    factors = np.ones(SIZE)
    factors[GYRO_BIAS : GYRO_BIAS + 3] = noise.gyro_bias / before.gyro_bias
    factors[ACCEL_BIAS : ACCEL_BIAS + 3] = noise.accel_bias / before.accel_bias
    factors[HARD_IRON : HARD_IRON + 3] = noise.hard_iron / before.hard_iron
    factors[WANDERING] = noise.wander_sizes() / before.wander_sizes()
    P = aligned.P * np.outer(factors, factors)
    if aligned.levelled:
        _levelled(P, aligned.x, aligned.yaw_source, _own(aligned.P, aligned.x, aligned.yaw_source))
    return replace(aligned, P=P)


def carried_over(aligned: Alignment, last: Filtered, gap: float, noise: SensorNoise, *, same_imu: bool) -> Alignment:
    """Start a segment with what the one before learned of the sensors' errors, made less sure by the hole between."""
    first = GYRO_BIAS if same_imu else BARO_BIAS
    kept = np.arange(first, TERRAIN)
    block = np.ix_(kept, kept)
    stay = np.ones(SIZE)
    stay[WANDERING] = np.exp(-gap / noise.wander_times())
    prior = np.diag(aligned.P)
    grown = gap * noise.random_walks() + UNSEEN_SHARE**2 * prior
    grown[WANDERING] += (1.0 - stay[WANDERING] ** 2) * prior[WANDERING]
    x, P = aligned.x.copy(), aligned.P.copy()
    x[kept + 1] = stay[kept] * last.last_state[kept + 1]
    own = _own(P, x, aligned.yaw_source) if aligned.levelled else None
    P[block] = np.outer(stay, stay)[block] * last.last_covariance[block] + np.diag(grown[kept] * (prior[kept] > 0.0))
    if own is not None and same_imu:
        # The force that levelled it has a bias that is known by now.
        x[6:10] = turned_by(x[6:10], _attitude_of_bias(x, aligned.yaw_source) @ x[13:16])
        _levelled(P, x, aligned.yaw_source, own)
    return replace(aligned, x=x, P=P)


def _logged_attitude(tables: Tables, start: float) -> np.ndarray | None:
    """Return the autopilot's attitude near the start [rad], None when it is not logged there."""
    attitude = usable(tables.attitude, ["roll", "pitch", "yaw"])
    if attitude is None:
        return None
    t = attitude.index.to_numpy(float)
    near = int(np.argmin(np.abs(t - start)))
    return attitude[["roll", "pitch", "yaw"]].to_numpy(float)[near] if abs(t[near] - start) < 1.0 else None


def _initial_yaw(
    tables: Tables,
    start: float,
    roll: float,
    pitch: float,
    logged: np.ndarray | None,
    field: np.ndarray | None,
) -> tuple[float, float, str]:
    """Heading from the levelled magnetometer, else from the autopilot, else unknown; with 1-sigma, rad."""
    mag = usable_field(tables.mag)
    if mag is not None and field is not None:
        t = mag.index.to_numpy(float)
        near = np.argsort(np.abs(t - start), kind="stable")[:10]
        near = near[np.abs(t[near] - start) < 2.0]
        if near.size:
            measured = mag[["mag_x", "mag_y", "mag_z"]].to_numpy(float)[near].mean(axis=0)
            level = matrix_from_quat(quat_from_euler(roll, pitch, 0.0)) @ measured
            yaw = np.arctan2(field[1], field[0]) - np.arctan2(level[1], level[0])
            return float(np.arctan2(np.sin(yaw), np.cos(yaw))), np.radians(15.0), "magnetometer"
    if logged is not None:
        return float(logged[2]), np.radians(15.0), "autopilot"
    # Anything between -180 and 180 degrees.
    return 0.0, np.pi / np.sqrt(3.0), "unknown"


def _place(
    tables: Tables,
    start: float,
    still: bool,
    frame: LocalFrame | None,
    noise: SensorNoise,
    x: np.ndarray,
    sigma: np.ndarray,
) -> None:
    """Fill position, velocity, baro, hard iron and GPS error of the start and their sigmas, in place."""
    position, velocity = slice(POSITION, POSITION + 3), slice(VELOCITY, VELOCITY + 3)
    sigma[position] = 1.0
    sigma[velocity] = 0.1 if still else 5.0
    accuracies = np.zeros(5)
    fixes = usable_fixes(tables.gps)
    if fixes is not None and frame is not None:
        later = fixes[fixes["t_valid"] >= start]
        first = (later if len(later) else fixes).iloc[0]
        lag = abs(float(first["t_valid"]) - start)
        x[0:3] = frame.to_ned(*(np.array([first[c]]) for c in ("lat", "lon", "alt")))[0]
        sigma[position] = 10.0 + (0.0 if still else 10.0 * lag)
        speed = first[["v_n", "v_e", "v_d"]].to_numpy(float)
        if not still and lag < 2.0:
            x[3:6] = np.where(np.isfinite(speed), speed, 0.0)
            sigma[velocity] = 1.0 + 3.0 * lag
        if not still and lag >= 2.0:
            sigma[velocity] = 10.0
        h_acc, v_acc, s_acc = (
            float(np.median(reported(fixes, name, getattr(noise, name)))) for name in ("h_acc", "v_acc", "s_acc")
        )
        accuracies[:4] = h_acc, h_acc, v_acc, s_acc
    baro = usable(tables.baro, ["alt"])
    if baro is not None:
        near = int(np.argmin(np.abs(baro.index.to_numpy(float) - start)))
        x[16] = float(baro["alt"].iloc[near]) + x[2]
        sigma[BARO_BIAS] = noise.baro_bias
        accuracies[4] = 1.0
    sigma[WANDERING] = accuracies * noise.wander_sizes()
    ranges = usable_ranges(tables.rangefinder)
    if ranges is not None:
        x[TERRAIN + 1] = -x[2] - float(ranges["distance"].iloc[0])
        sigma[TERRAIN] = noise.terrain
