"""Numbers that the compiled loops read, as named tuples; built by the classes that check and explain them."""

from typing import NamedTuple, Self

import numpy as np


class AirParameters(NamedTuple):
    """Air at the height of the origin, and how it changes above it."""

    density: float
    temperature: float
    lapse_rate: float
    exponent: float


class BladeParameters(NamedTuple):
    """A rotor by blade elements and momentum; see `simulation.drive.BladeElementRotor`."""

    radius: float  # m; 0: the rotors follow the quadratic law instead
    area: float  # m^2
    lift: float  # lift slope times blades times chord, m
    theta0: float  # rad, pitch at the root of the linear twist
    theta1: float  # rad, change of pitch from root to tip
    efficiency: float


class TankParameters(NamedTuple):
    """Mass properties over time; see `simulation.vehicle.Tank`. One entry: they never change."""

    time: np.ndarray  # (k,), s, increasing
    mass: np.ndarray  # (k,)
    inertia: np.ndarray  # (k, 3, 3)


class ResponseParameters(NamedTuple):
    """How a rotor follows its commanded speed; see `simulation.drive.FirstOrder` and `ThirdOrder`."""

    time_constant: float  # s, of the first-order lag; of the catching-up after a limit in the third-order one
    coefficients: np.ndarray  # (4,): T, a1, a2, a3; (0,): first order
    speed_limit: float  # rad/s
    acceleration_limit: float  # rad/s^2


class AirframeParameters(NamedTuple):
    """A multirotor as the equations of motion read it; see `simulation.vehicle.Multirotor`."""

    mass: np.ndarray  # (1,); an array, as the inertias are, because a tank that empties changes it in flight
    gravity: float
    inertia: np.ndarray  # (3, 3)
    inertia_inverse: np.ndarray  # (3, 3)
    tank: TankParameters
    rotor_position: np.ndarray  # (n, 3)
    rotor_spin: np.ndarray  # (n,), +1 clockwise from above
    rotor_inertia: np.ndarray  # (n,), about the axis of rotation, which is vertical
    thrust_coefficient: np.ndarray  # (n,)
    torque_coefficient: np.ndarray  # (n,)
    blade: BladeParameters
    response: ResponseParameters
    drag_linear: np.ndarray  # (3,), N s/m
    drag_area: np.ndarray  # (3,), m^2
    feet: np.ndarray  # (m, 3)
    ground: float  # p_d of the ground, m; +inf where there is none
    foot_stiffness: float
    foot_damping: float
    friction: float


class DriveParameters(NamedTuple):
    """Drives and battery as the flight loop reads them; see `simulation.drive`."""

    speed_max: float
    expo: float
    voltage_reference: float
    pwm_min: float
    pwm_idle: float
    pwm_zero: float
    pwm_full: float
    efficiency: float
    voltage_full: float
    voltage_empty: float
    capacity: float  # A s
    resistance: float
    avionics_power: float


class CascadeParameters(NamedTuple):
    """The PID cascade as the flight loop reads it; see `simulation.controllers.Cascade`."""

    mixer: np.ndarray  # (n, 3): roll, pitch, yaw factors
    angle_p: np.ndarray  # (3,)
    rate_pid: np.ndarray  # (3, 3): rows roll, pitch, yaw; columns P, I, D
    position_p: np.ndarray  # (3,)
    velocity_pid: np.ndarray  # (3, 3): rows north, east, down
    hover_thrust: float
    tilt_limit: float
    speed_limit: np.ndarray  # (3,): horizontal, up, down
    filter_frequency: float  # Hz, of gyro and accelerometer


class AutopilotState(NamedTuple):
    """What the autopilot remembers and last decided; all arrays, changed in place."""

    velocity_memory: np.ndarray  # (3, 3): north, east, down; see `simulation._kernels.pid`
    rate_memory: np.ndarray  # (3, 3): roll, pitch, yaw
    velocity_target: np.ndarray  # (3,), NED
    accel_target: np.ndarray  # (3,), NED
    angle_target: np.ndarray  # (3,), roll, pitch, yaw
    angle: np.ndarray  # (3,), as the autopilot believes them
    rate_target: np.ndarray  # (3,)
    torque: np.ndarray  # (3,), normalised
    thrust: np.ndarray  # (4,): throttle before and after the boost for tilt, the boost, the spool-up factor

    @classmethod
    def at_boot(cls) -> Self:
        """Return a memory of nothing."""
        return cls(*(np.zeros(shape) for shape in ((3, 3), (3, 3), 3, 3, 3, 3, 3, 3, 4)))


class SensorParameters(NamedTuple):
    """Inertial sensors as the flight loop reads them; see `simulation.sensors.InertialErrors`."""

    gyro_white: float  # rad/s per sample
    accel_white: float  # m/s^2 per sample
    vibration: float  # m/s^2 per sample at the reference speed
    gyro_vibration: float  # rad/s per sample at the reference speed
    vibration_speed: float  # rad/s
    gyro_bias: np.ndarray  # (3,)
    accel_bias: np.ndarray  # (3,)
    gyro_range: float  # rad/s
    accel_range: float  # m/s^2


class CraftParameters(NamedTuple):
    """A craft with its drives, autopilot and inertial sensors in the air of a place."""

    frame: AirframeParameters
    air: AirParameters
    drive: DriveParameters
    cascade: CascadeParameters
    sensors: SensorParameters


class Forcing(NamedTuple):
    """What a mission asks for and what disturbs it, at M ticks of position control and N = 10 M steps."""

    phase: np.ndarray  # (M,): DISARMED, IDLE, FLYING or LANDING
    reference: np.ndarray  # (M, 10): position, velocity, acceleration (NED) and yaw
    excitation: np.ndarray  # (5 M, 4): added at the mixer to roll, pitch, yaw and throttle
    level: np.ndarray  # (M,): whether the craft is to stay level wherever it drifts, as in SYSTEMID mode
    navigation: np.ndarray  # (M, 9): errors of the autopilot's own position, velocity and attitude (roll, pitch, yaw)
    drift: np.ndarray  # (M, 6): of the biases of gyro and accelerometer
    speed: np.ndarray  # (M, n): share of the commanded speed that each rotor still follows; 1: sound
    winds: np.ndarray  # (N, 3): velocity of the air
    noise: np.ndarray  # (N, 6): standard normal, of gyro and accelerometer


class Instant(NamedTuple):
    """What is felt and put out at a step; all arrays, changed in place."""

    specific_force: np.ndarray  # (3,), true
    angles: np.ndarray  # (3,), true
    measured: np.ndarray  # (6,): gyro and accelerometer behind their low-pass
    delays: np.ndarray  # (2, 6): memory of that low-pass
    pack: np.ndarray  # (3,): voltage [V] seen through 10 Hz, current [A] and charge drawn [A s]
    pwm: np.ndarray  # (n,), us
    command: np.ndarray  # (n,): rotor speeds towards which the drives go

    @classmethod
    def at_boot(cls, rotors: int, voltage: float) -> Self:
        """Return a craft that stands, its battery at a voltage [V]."""
        pack = np.array([voltage, 0.0, 0.0])
        return cls(np.zeros(3), np.zeros(3), np.zeros(6), np.zeros((2, 6)), pack, np.zeros(rotors), np.zeros(rotors))


class AxisParameters(NamedTuple):
    """One axis and its controllers; see `simulation.axis_loop.AxisPlant` and `LoopGains`."""

    gain: float
    damping: float
    lag: float
    delay: float
    flex_hz: float
    flex_damping: float
    flex_share: float
    filter_hz: float
    integrates: bool
    P: float
    I: float  # noqa: E741 -- the field's letter
    D: float
    FF: float
    FLTT: float
    FLTE: float
    FLTD: float
    IMAX: float
    angle_P: float  # noqa: N815 -- spelled as the parameter
    limit: float
    position_P: float  # noqa: N815
    velocity_P: float  # noqa: N815


class AxisSignals(NamedTuple):
    """Forcing of one axis: shape (N,) at the loop's rate, `gyro_noise` and `disturbance` (N, substeps)."""

    stick: np.ndarray
    position_chirp: np.ndarray
    velocity_chirp: np.ndarray
    rate_chirp: np.ndarray
    mixer_chirp: np.ndarray
    noise: np.ndarray
    gyro_noise: np.ndarray
    disturbance: np.ndarray
