"""Sensors: what the instruments of a flight would have said, errors with known sizes included."""

import math
from dataclasses import dataclass

import numpy as np
import pandas as pd
import pymap3d
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from simulation._parameters import SensorParameters
from simulation.errors import ParameterError
from simulation.place import Place

Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Inertial:
    """Gyro and accelerometer, sampled every step of the simulation before the low-pass."""

    gyro_bias: Vector = (0.0, 0.0, 0.0)  #: rad/s.
    accel_bias: Vector = (0.0, 0.0, 0.0)  #: m/s^2.
    #: Noise density, rad/s/sqrt(Hz) and m/s^2/sqrt(Hz).
    gyro_noise: float = 1.5e-4
    accel_noise: float = 2.0e-3
    #: Further noise densities at hover; grow with the square of the rotor speed.
    gyro_vibration: float = 6.0e-4
    accel_vibration: float = 2.0e-2
    #: Standard deviation of the Gauss-Markov drift of the biases, rad/s and m/s^2; it starts at zero.
    gyro_instability: float = 0.0
    accel_instability: float = 0.0
    instability_time: float = 100.0  #: Correlation time of that drift, s.
    #: Where the sensors clip, rad/s and m/s^2 (2000 deg/s and 16 g).
    gyro_range: float = 34.9
    accel_range: float = 156.9

    def drift(self, n: int, dt: float, random: np.random.RandomState) -> np.ndarray:
        """Drift of the biases of gyro (rad/s) and accelerometer (m/s^2) at n ticks of dt; shape (n, 6)."""
        sigma = np.repeat([self.gyro_instability, self.accel_instability], 3)
        if not sigma.any():
            return np.zeros((n, 6))
        wander = _gauss_markov(n, 6, self.instability_time / dt, random)
        return np.ascontiguousarray(sigma * (wander - wander[0]))

    def kernel_parameters(self, dt: float, hover_speed: float) -> SensorParameters:
        """Return the numbers that the flight loop reads; `hover_speed` [rad/s] is that of the rotors."""
        density = math.sqrt(0.5 / dt)
        return SensorParameters(
            gyro_white=self.gyro_noise * density,
            accel_white=self.accel_noise * density,
            vibration=self.accel_vibration * density,
            gyro_vibration=self.gyro_vibration * density,
            vibration_speed=hover_speed,
            gyro_bias=np.array(self.gyro_bias),
            accel_bias=np.array(self.accel_bias),
            gyro_range=float(self.gyro_range),
            accel_range=float(self.accel_range),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Gps:
    """Receiver with late samples, an error that wanders and white noise on top."""

    rate: float = 5.0  #: Hz.
    lag: float = 0.12  #: From the instant that a sample is valid to the row in the log, s.
    #: Standard deviation of the Gauss-Markov position error, m per axis.
    horizontal_wander: float = 0.5
    vertical_wander: float = 0.9
    wander_time: float = 60.0  #: Its correlation time, s.
    #: White noise, m and m/s per axis.
    position_noise: float = 0.04
    velocity_noise: float = 0.05
    #: Start and end of times without a fix, s from the start of the simulation; the receiver goes on sending rows, with
    #: its last position.
    outages: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        if not 0.0 <= self.lag <= 0.5:
            raise ParameterError(f"GPS lag {self.lag:g} s must lie in 0..0.5 s")

    def sample(self, truth: pd.DataFrame, place: Place, random: np.random.RandomState) -> pd.DataFrame:
        """Sample a flight."""
        t_truth = truth.index.to_numpy()
        t_valid = np.arange(0.0, t_truth[-1] - self.lag, 1.0 / self.rate)
        n = len(t_valid)
        wander = np.array([self.horizontal_wander, self.horizontal_wander, self.vertical_wander])
        position = _at(truth, ["p_n", "p_e", "p_d"], t_valid)
        position += wander * _gauss_markov(n, 3, self.wander_time * self.rate, random)
        position += self.position_noise * random.standard_normal((n, 3))
        velocity = _at(truth, ["v_n", "v_e", "v_d"], t_valid)
        velocity += self.velocity_noise * random.standard_normal((n, 3))
        fix = np.ones(n, dtype=bool)
        for start, end in self.outages:
            fix &= (t_valid < start) | (t_valid >= end)
        last = np.maximum.accumulate(np.where(fix, np.arange(n), 0))
        position, velocity = position[last], np.where(fix[:, None], velocity, 0.0)
        lat, lon, alt = pymap3d.ned2geodetic(*position.T, place.lat_deg, place.lon_deg, place.alt)
        return pd.DataFrame(
            {
                "t_valid": t_valid,
                "lat_deg": lat,
                "lon_deg": lon,
                "alt": alt,
                "v_n": velocity[:, 0],
                "v_e": velocity[:, 1],
                "v_d": velocity[:, 2],
                "fix": fix,
            },
            index=pd.Index(t_valid + self.lag, name="t"),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Barometer:
    """Static pressure with noise and drift."""

    rate: float = 10.0  #: Hz.
    noise: float = 1.2  #: White noise, Pa.
    drift: float = 4.0  #: Standard deviation of the Gauss-Markov drift, Pa.
    drift_time: float = 120.0  #: Its correlation time, s.
    self_heating: float = 12.0  #: Sensor above air temperature, K.

    def sample(self, truth: pd.DataFrame, place: Place, random: np.random.RandomState) -> pd.DataFrame:
        """Sample a flight: index `t` [s]; pressure [Pa], temperature of the sensor [K]."""
        t = np.arange(0.0, truth.index[-1], 1.0 / self.rate)
        n = len(t)
        height = -_at(truth, ["p_d"], t)[:, 0]
        air = place.atmosphere
        pressure = np.array([air.pressure_at(h) for h in height])
        drift = _gauss_markov(n, 1, self.drift_time * self.rate, random)[:, 0]
        pressure += self.drift * (drift - drift[0]) + self.noise * random.standard_normal(n)
        temperature = np.array([air.temperature_at(h) + self.self_heating for h in height])
        return pd.DataFrame({"pressure": pressure, "temperature": temperature}, index=pd.Index(t, name="t"))


@dataclass(frozen=True, slots=True, kw_only=True)
class Magnetometer:
    """Three-axis compass with what is left of hard iron after calibration."""

    rate: float = 10.0  #: Hz.
    noise: float = 2.0e-7  #: White noise, T.
    hard_iron: Vector = (0.0, 0.0, 0.0)  #: Constant field of the craft left by the calibration, body axes, T.

    def sample(self, truth: pd.DataFrame, field_n: np.ndarray, random: np.random.RandomState) -> pd.DataFrame:
        """Sample a flight: index `t` [s]; mag_x, mag_y, mag_z [T]."""
        step = round(1.0 / self.rate / (truth.index[1] - truth.index[0]))
        rows = truth.iloc[::step]
        q = rows[["q_w", "q_x", "q_y", "q_z"]].to_numpy()
        field_b = rotate_to_body(q, field_n) + np.array(self.hard_iron)
        field_b += self.noise * random.standard_normal(field_b.shape)
        return pd.DataFrame(field_b, index=rows.index, columns=["mag_x", "mag_y", "mag_z"])


@dataclass(frozen=True, slots=True, kw_only=True)
class Navigation:
    """Errors of the autopilot's own estimate, on which it flies and which it logs (ATT, PSCN, CTUN).

    No filter is run on board: the estimate is the truth plus Gauss-Markov errors of these standard deviations,
    smoothed over two seconds as a filter's errors are.
    """

    position: float = 0.25
    position_time: float = 40.0
    velocity: float = 0.03
    velocity_time: float = 5.0
    tilt: float = 0.004
    yaw: float = 0.015
    attitude_time: float = 20.0

    def sample(self, n: int, dt: float, random: np.random.RandomState) -> np.ndarray:
        """Errors of position (m), velocity (m/s) and roll, pitch, yaw (rad) at n ticks of dt; shape (n, 9).

        They start at zero: the origin is where the autopilot believes to be at boot.
        """
        sigma = np.array([self.tilt, self.tilt, self.yaw])
        position = self.position * _smooth_wander(n, self.position_time / dt, 2.0 / dt, random)
        velocity = self.velocity * _smooth_wander(n, self.velocity_time / dt, 2.0 / dt, random)
        attitude = sigma * _smooth_wander(n, self.attitude_time / dt, 2.0 / dt, random)
        errors = np.hstack((position, velocity, attitude))
        start = np.minimum(np.arange(n) * dt / 10.0, 1.0)
        return np.ascontiguousarray(errors * start[:, None])


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensors:
    """All instruments of a craft."""

    inertial: Inertial = Inertial()
    gps: Gps = Gps()
    barometer: Barometer = Barometer()
    magnetometer: Magnetometer = Magnetometer()
    navigation: Navigation = Navigation()


def _gauss_markov(n: int, columns: int, correlation: float, random: np.random.RandomState) -> np.ndarray:
    """First-order Gauss-Markov noise of unit variance; `correlation` in samples; shape (n, columns)."""
    keep = math.exp(-1.0 / correlation)
    noise = random.standard_normal((n, columns))
    noise[1:] *= math.sqrt(1.0 - keep * keep)
    filtered: np.ndarray = lfilter([1.0], [1.0, -keep], noise, axis=0)
    return filtered


def _smooth_wander(n: int, correlation: float, smoothing: float, random: np.random.RandomState) -> np.ndarray:
    """Gauss-Markov noise behind a first-order low-pass, unit variance; times in samples; shape (n, 3)."""
    keep = math.exp(-1.0 / smoothing)
    gain = (1.0 - keep) * math.sqrt((correlation + smoothing) / correlation)
    filtered: np.ndarray = lfilter([gain], [1.0, -keep], _gauss_markov(n, 3, correlation, random), axis=0)
    return filtered


def rotate_to_body(q: np.ndarray, vector_n: np.ndarray) -> np.ndarray:
    """Turn NED vectors (3,) or (N, 3) into body axes by quaternions q (N, 4), scalar first, body to NED; (N, 3)."""
    # Columns of a table may be read-only, which SciPy refuses.
    turned: np.ndarray = Rotation.from_quat(q.copy(), scalar_first=True).apply(vector_n.copy(), inverse=True)
    return turned


def _at(frame: pd.DataFrame, columns: list[str], t: np.ndarray) -> np.ndarray:
    """Columns of a frame linearly interpolated at t; shape (len(t), len(columns))."""
    index = frame.index.to_numpy()
    return np.column_stack([np.interp(t, index, frame[name].to_numpy()) for name in columns])
