"""Rotations between body (FRD) and NED: quaternions scalar first, Euler angles yaw-pitch-roll."""

import numpy as np
import scipy


def quat_from_euler(roll: np.ndarray | float, pitch: np.ndarray | float, yaw: np.ndarray | float) -> np.ndarray:
    """Body-to-NED quaternion of Euler angles [rad] (rotations about z, then y, then x), shape (..., 4)."""
    cr, sr = np.cos(np.asarray(roll) / 2), np.sin(np.asarray(roll) / 2)
    cp, sp = np.cos(np.asarray(pitch) / 2), np.sin(np.asarray(pitch) / 2)
    cy, sy = np.cos(np.asarray(yaw) / 2), np.sin(np.asarray(yaw) / 2)
    return np.stack(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ],
        axis=-1,
    )


def euler_from_quat(quat_nb: np.ndarray) -> np.ndarray:
    """Roll, pitch, yaw [rad] of body-to-NED quaternions of any length, shape (..., 3)."""
    w, x, y, z = np.moveaxis(quat_nb / np.linalg.norm(quat_nb, axis=-1, keepdims=True), -1, 0)
    return np.stack(
        [
            np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
            np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0)),
            np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
        ],
        axis=-1,
    )


def matrix_from_quat(quat_nb: np.ndarray) -> np.ndarray:
    """Body-to-NED matrices of unit quaternions, shape (..., 3, 3)."""
    w, x, y, z = np.moveaxis(np.asarray(quat_nb, float), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def continuous(quat_nb: np.ndarray) -> np.ndarray:
    """Flip signs of successive quaternions (n, 4), of which both mean the same attitude, so that none jumps."""
    turns_over = (quat_nb[1:] * quat_nb[:-1]).sum(axis=1) < 0.0
    signs = np.cumprod(np.where(np.concatenate([[False], turns_over]), -1.0, 1.0))
    return quat_nb * signs[:, None]


def multiply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Hamilton product of quaternions, shape (..., 4)."""
    aw, ax, ay, az = np.moveaxis(np.asarray(a, float), -1, 0)
    bw, bx, by, bz = np.moveaxis(np.asarray(b, float), -1, 0)
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def turned_by(quat_nb: np.ndarray, phi: np.ndarray) -> np.ndarray:
    """Turn an attitude by a rotation vector about NED axes, rad; shape (4,)."""
    turn = scipy.spatial.transform.Rotation.from_rotvec(phi).as_quat(scalar_first=True)
    return multiply(turn, quat_nb)


def error_rotation(quat_nb: np.ndarray, true_quat_nb: np.ndarray) -> np.ndarray:
    """Rotation vector about NED axes that takes an estimated attitude to the true one, rad, shape (..., 3)."""
    conjugate = np.asarray(quat_nb, float) * np.array([1.0, -1.0, -1.0, -1.0])
    error = multiply(true_quat_nb, conjugate)
    error = np.where(error[..., :1] < 0.0, -error, error)
    sine = np.linalg.norm(error[..., 1:], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, error[..., :1])
    return error[..., 1:] * np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 2.0)
