"""What a motor's logged signal says about its thrust: the autopilot's curve for PWM, the square of a rotor's speed.

Two laws turn a logged signal into a number s that thrust is proportional to, ``T = k s``::

    command:  s = (rho / 1.225) V^2 [(1 - e) c + e c^2]      c: PWM between idle and full spin, 0 .. 1 (ArduPilot
                                                             AP_MotorsMulticopter); V: voltage over the reference
    speed:    s = (rho / 1.225) w^2                          w: rotor speed, rad/s (Kim 2017 eq. 13, Refinement 2020)

so that k is the thrust at full command [N], or the coefficient of the rotor [N s^2], in sea-level air.

At one output a motor's speed goes nearly with the voltage, and thrust with its power 1.8 to 1.9 (a DC motor against
its propeller; 2 in ArduPilot's simulator). The autopilot's own compensation, which has V beside c within the curve
(`sysid.records.mixer` inverts it), would make that 1.2 to 1.5, because c is counted from where motors begin to spin.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum

import numpy as np
import scipy

from core.robust import robust_sigma
from logparse import Vehicle
from sysid.records.experiment import Experiment, Floats
from sysid.records.filtering import lfilter
from sysid.records.motor_scaling import curve, motor_commands

#: Density to which coefficients refer, kg/m^3.
REFERENCE_DENSITY = 1.225

#: Part by which commands must vary (standard deviation over mean) before their ratio to speeds says anything.
VARYING = 0.03


class Law(StrEnum):
    """How the signal of a motor becomes thrust."""

    COMMAND = "command"
    SPEED = "speed"


def column(record: Experiment, name: str) -> Floats:
    """Return a column of the record's context; NaN where the log does not tell."""
    if record.context is None or name not in record.context:
        return np.full(len(record.t), np.nan)
    return record.context[name].to_numpy(np.float64)


def attitude(record: Experiment) -> Floats:
    """Rotation from body to NED, (N, 3, 3), by quaternions where the record has them; NaN where unknown."""
    rotations = scipy.spatial.transform.Rotation
    quaternions = np.column_stack([column(record, name) for name in ("q_w", "q_x", "q_y", "q_z")])
    if np.isfinite(quaternions).all():
        return np.asarray(rotations.from_quat(quaternions, scalar_first=True).as_matrix())
    angles = np.column_stack([column(record, name) for name in ("yaw", "pitch", "roll")])
    return np.asarray(rotations.from_euler("ZYX", angles).as_matrix())


def velocity_n(record: Experiment) -> Floats:
    """Velocity over the ground, NED, m/s, (N, 3); NaN where unknown."""
    return np.column_stack([column(record, name) for name in ("v_n", "v_e", "v_d")])


def body_velocity(record: Experiment) -> Floats:
    """Velocity over the ground along body axes (forward, right, down), m/s, (N, 3); NaN where unknown."""
    return np.asarray(np.einsum("nji,nj->ni", attitude(record), velocity_n(record)))


def relative_density(record: Experiment) -> Floats:
    """Density of the air over that of the sea level; 1 where unknown."""
    density = column(record, "density") / REFERENCE_DENSITY
    return np.where(np.isfinite(density), density, 1.0)


def squared_voltage(record: Experiment, voltage: float | None) -> Floats:
    """Square of the battery's voltage over a reference, (N,); 1 where either is unknown."""
    ratio = column(record, "voltage") / voltage if voltage is not None else np.array(np.nan)
    return np.asarray(ratio**2) if np.isfinite(ratio).all() else np.ones(len(record.t))


def reference_voltage(records: Sequence[Experiment]) -> float | None:
    """Median voltage of the records, V; None when one of them does not tell."""
    voltages = np.concatenate([column(record, "voltage") for record in records])
    return float(np.median(voltages)) if np.isfinite(voltages).all() else None


def rotor_speeds(record: Experiment, vehicle: Vehicle) -> Floats | None:
    """Return the speeds that the ESCs report for the record's motors, rad/s, (N, motors).

    None unless all report, and where what they report is the command: so does ArduPilot's simulator.
    """
    speeds = np.column_stack([column(record, f"rotor_speed_{name.removeprefix('m')}") for name in record.input_names])
    commands = motor_commands(record.u, vehicle)
    turning = (commands > 0.05) & (commands < 1.0) & (speeds > 0.0)
    if not np.isfinite(speeds).all() or not turning.any():
        return None
    ratio = speeds[turning] / commands[turning]
    varied = float(np.std(commands[turning]) / np.mean(commands[turning]))
    # A speed goes with some 0.7th power of the command: its ratio to it varies by a third of what the command does.
    apart = robust_sigma(ratio / np.median(ratio) - 1.0)
    return None if varied > VARYING and apart < 0.1 * varied else speeds


def law_of(records: Sequence[Experiment], vehicle: Vehicle) -> Law:
    """Return what thrust goes with: rotor speeds where every record has them."""
    return Law.SPEED if all(rotor_speeds(record, vehicle) is not None for record in records) else Law.COMMAND


def thrust_signals(
    record: Experiment, law: Law, vehicle: Vehicle, voltage: float | None, expo: float | None = None
) -> Floats:
    """Return s of the module's text for each motor, (N, motors)."""
    density = relative_density(record)
    if law is Law.SPEED:
        speeds = rotor_speeds(record, vehicle)
        if speeds is None:
            raise ValueError(f"{record.name}: rotor speeds are not logged")
        return np.asarray(density[:, None] * speeds**2)
    command = np.clip(motor_commands(record.u, vehicle), 0.0, 1.0)
    strength = (density * squared_voltage(record, voltage))[:, None]
    return np.asarray(strength * curve(command, vehicle.thrust_expo if expo is None else expo))


def lagged(signals: Floats, time_constant: float, dt: float) -> Floats:
    """Pass signals through a first-order lag from its steady state, exact for inputs linear between samples.

    `signals` (N, k) or (N,).
    """
    if time_constant <= 1e-6 * dt:
        return signals
    a = float(np.exp(-dt / time_constant))
    new = 1.0 - (1.0 - a) * time_constant / dt
    old = 1.0 - a - new
    # State of the direct form II transposed filter that makes the output begin at the first sample.
    start = (1.0 - new) * signals[:1]
    return np.asarray(lfilter([new, old], [1.0, -a], signals, start))
