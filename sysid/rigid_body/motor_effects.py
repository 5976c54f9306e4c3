"""What each motor by itself does to the craft's rotation, where motors move independently enough to tell.

For each axis the angular acceleration is regressed on the thrust commands of all motors at once, as
`sysid.rigid_body.rotation`
does on their sum. Coefficients over lever and common gain give each motor's thrust relative to all; those about the
yaw axis its torque. A controller moves many motors in four ways only (thrust, roll, pitch, yaw): with more than four,
single motors stay hidden.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from logparse import Vehicle
from sysid.records.experiment import Experiment
from sysid.rigid_body.model_record import MotorEffect
from sysid.rigid_body.rotation import (
    AXES,
    COHERENT,
    RotationFit,
    levers,
    logged_motors,
    regress_stretches,
    rotation_spectra,
    thrust_commands,
)

#: Condition number of the motors' commands, scaled, above which they are not told apart.
SEPARABLE = 1e3

#: Lever below which an axis tells nothing of a motor, in arms.
_LEVER = 0.3


def fit_motor_effects(
    records: Sequence[Experiment], vehicle: Vehicle, voltage: float | None, turning: RotationFit
) -> Mapping[str, MotorEffect]:
    """Distinguish motors by the rotation that each causes."""
    names, motors = records[0].input_names, logged_motors(records[0], vehicle)
    commands = [thrust_commands(record, vehicle, voltage) for record in records]
    rates = [
        record.context[["w_x", "w_y", "w_z"]].to_numpy(np.float64) for record in records if record.context is not None
    ]
    spectra = rotation_spectra(commands, rates, records[0].dt)
    if spectra is None:
        return {name: _unknown("the flight is too short") for name in names}
    omega, q, w = spectra
    shaped = q * (np.exp(-1j * omega * turning.delay) / (1.0 + 1j * omega * turning.lag))[None, :, None]
    flat = shaped.reshape(-1, len(names))
    gram = np.real(flat.conj().T @ flat)
    size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    condition = float(np.linalg.cond(gram / np.outer(size, size)))
    if not condition < SEPARABLE:
        why = f"the motors move together (condition number {condition:.1e})"
        return {name: _unknown(f"{why}; the controller gives them four commands only") for name in names}
    fits = {
        axis: regress_stretches(
            np.dstack([shaped * (1.0 + 1j * omega * turning.axes[axis].lead)[None, :, None], -w[:, :, k]]),
            1j * omega * w[:, :, k],
        )
        for k, axis in enumerate(AXES)
    }
    coherent = min(fits["roll"][2], fits["pitch"][2])
    if coherent < COHERENT:
        why = f"the motor outputs explain only {100.0 * max(coherent, 0.0):.0f} % of the angular acceleration"
        return {name: _unknown(f"{why}; log them faster and move all axes") for name in names}
    arms, result = levers(motors), {}
    for j, name in enumerate(names):
        shares, weights = [], []
        for axis in ("roll", "pitch"):
            scale = turning.axes[axis].gain * arms[axis][j]
            if abs(arms[axis][j]) > _LEVER:
                shares.append(fits[axis][0][j] / scale)
                weights.append((scale / fits[axis][1][j]) ** 2)
        weight = np.array(weights)
        known = fits["yaw"][2] >= COHERENT
        result[name] = MotorEffect(
            thrust=float(np.array(shares) @ weight / weight.sum()),
            thrust_sigma=float(1.0 / np.sqrt(weight.sum())),
            torque=float(fits["yaw"][0][j] * arms["yaw"][j]) if known else None,
            torque_sigma=float(fits["yaw"][1][j]) if known else None,
            reason="" if known else "the yaw axis was hardly moved",
        )
    return result


def _unknown(reason: str) -> MotorEffect:
    return MotorEffect(thrust=None, thrust_sigma=None, torque=None, torque_sigma=None, reason=reason)
