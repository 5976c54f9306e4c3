"""Controllers: the PID cascade with allocation of Elhesasy 2024, and the LQR about hover of Kim 2017."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_continuous_are

from simulation._parameters import CascadeParameters
from simulation.vehicle import Multirotor

Gains = tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Cascade:
    """Position P, velocity PID, angle P, rate PID; defaults are Table 1 of Elhesasy 2024.

    The paper flew these gains on ArduPilot, and they only make sense in its units: the rate loops put out torque
    normalised to -1..1 of the mixer's range, the vertical velocity loop thrust normalised to 0..1, the
    horizontal velocity loop acceleration in m/s^2 that is turned into lean angles. Attitude control runs five times
    as often as position control.
    """

    angle_p: Gains = (6.5, 6.5, 2.5)  #: Roll, pitch, yaw, 1/s.
    #: P, I, D: normalised torque per rad/s, per rad, per rad/s^2.
    roll_rate: Gains = (0.1, 0.02, 0.001)
    pitch_rate: Gains = (0.1, 0.02, 0.001)
    yaw_rate: Gains = (0.5, 0.01, 0.001)
    position_p: Gains = (2.0, 2.0, 4.0)  #: North, east, down, 1/s.
    horizontal_velocity: Gains = (2.5, 0.4, 0.01)  #: P, I, D: m/s^2 per m/s, per m, per m/s^2.
    vertical_velocity: Gains = (0.45, 0.01, 0.005)  #: P, I, D: normalised thrust per m/s, per m, per m/s^2.
    tilt_limit_deg: float = 30.0
    #: Limits of the velocity target, m/s.
    speed_horizontal: float = 10.0
    speed_up: float = 2.5
    speed_down: float = 1.5
    filter_frequency: float = 20.0  #: Corner of the gyro and accelerometer low-pass, Hz.

    def kernel_parameters(self, vehicle: Multirotor, hover_thrust: float) -> CascadeParameters:
        """Return the numbers that the flight loop reads; `hover_thrust` is the fraction of thrust that hovers."""
        return CascadeParameters(
            mixer=mixer(vehicle),
            angle_p=np.array(self.angle_p),
            rate_pid=np.array((self.roll_rate, self.pitch_rate, self.yaw_rate)),
            position_p=np.array(self.position_p),
            velocity_pid=np.array((self.horizontal_velocity, self.horizontal_velocity, self.vertical_velocity)),
            hover_thrust=hover_thrust,
            tilt_limit=math.radians(self.tilt_limit_deg),
            speed_limit=np.array((self.speed_horizontal, self.speed_up, self.speed_down)),
            filter_frequency=self.filter_frequency,
        )


def mixer(vehicle: Multirotor) -> np.ndarray:
    """Roll, pitch and yaw factor of each motor, the largest of each scaled to 0.5 as ArduPilot does; shape (n, 3).

    By where motors sit on their frame: an autopilot does not know where the centre of gravity is.
    """
    places = np.array([m.position for m in vehicle.rotors])
    forward, right, _ = (places - places.mean(axis=0)).T
    factors = np.column_stack([-right, forward, [-float(m.spin) for m in vehicle.rotors]])
    largest = np.abs(factors).max(axis=0)
    factors[np.abs(factors) < 1e-9 * largest.max()] = 0.0
    return np.ascontiguousarray(0.5 * factors / largest)


def hover_linearisation(vehicle: Multirotor, speeds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Linearise attitude about hover with the given rotor speeds (Kim 2017, eq. 17)."""
    moments = np.empty((3, len(vehicle.rotors)))
    for k, (mount, speed) in enumerate(zip(vehicle.rotors, speeds, strict=True)):
        forward, right, _ = mount.position
        k_w, b_w = (2.0 * speed * part(1.0) for part in (mount.rotor.thrust, mount.rotor.torque))
        moments[:, k] = -right * k_w, forward * k_w, -mount.spin * b_w
    A = np.zeros((5, 5))
    A[0, 2] = A[1, 3] = 1.0
    return A, np.vstack((np.zeros((2, len(speeds))), np.linalg.solve(vehicle.inertia, moments)))


def lqr(A: np.ndarray, B: np.ndarray, Q: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Gain K of ``u = -K x`` that minimises the integral of ``x'Qx + u'Ru``; shape (inputs, states)."""
    gain: np.ndarray = np.linalg.solve(R, B.T @ solve_continuous_are(A, B, Q, R))
    return gain
