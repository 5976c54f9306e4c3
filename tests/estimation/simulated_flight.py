"""Simulated flights with known truth: a smooth multirotor path and the sensors of a small autopilot that saw it."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from pygeomag import GeoMag
from scipy.interpolate import BPoly, CubicSpline, PPoly
from scipy.signal import bilinear, lfilter

from core.attitude import continuous, matrix_from_quat, multiply, quat_from_euler
from estimation.place import LocalFrame
from logparse import Geodetic, Tables
from tests.timed import inertial, timed

PLACE = Geodetic(np.radians(47.4), np.radians(8.5), 480.0)
STEP = 0.002  # s; the truth's own sampling


@dataclass(frozen=True)
class Sensors:
    """Errors of the sensors, SI; the defaults are a MEMS autopilot with a single-frequency receiver."""

    imu_rate: float = 50.0
    cutoff: float = 20.0
    gyro_density: float = 1.5e-4
    accel_density: float = 2.0e-3
    gyro_bias: float = 3.0e-3
    accel_bias: float = 0.06
    gyro_walk: float = 1.0e-5
    accel_walk: float = 1.5e-4
    vibration_rate: float = 0.05
    vibration_force: float = 1.5
    gps_rate: float = 5.0
    gps_lag: float = 0.12
    gps_error: tuple[float, float, float] = (1.0, 1.0, 1.5)
    gps_error_time: float = 100.0
    gps_white: float = 0.05
    gps_speed: float = 0.2
    baro_rate: float = 10.0
    baro_white: float = 0.12
    baro_walk: float = 0.04
    baro_wander: float = 0.0  # of wash and airspeed, 1-sigma, m; it lasts for `baro_wander_time`, s
    baro_wander_time: float = 5.0
    mag_rate: float = 10.0
    mag_white: float = 3.0e-7
    hard_iron: float = 2.0e-6
    second_gps: bool = False
    range_finder: float = 0.0  # its white noise, m; 0 for none


@dataclass(frozen=True)
class Flight:
    tables: Tables
    truth: pd.DataFrame
    biases: pd.DataFrame = field(repr=False)

    def settled(self, after: float = 15.0) -> pd.DataFrame:
        """Return the truth from when the craft has taken off and its heading has been found, s."""
        return self.truth[self.truth.index > after]


def each(tables: Tables, change: Callable[[pd.DataFrame], pd.DataFrame]) -> Tables:
    """Return the tables of a flight with every sensor's changed alike."""
    names = ("imu", "gps", "baro", "mag", "attitude")
    return tables.changed(**{name: change(getattr(tables, name)) for name in names})


def later(tables: Tables, start: float) -> Tables:
    """Return the log as if it had been started in the air."""
    return each(tables, lambda table: table[table.index > start])


def _path(rng: np.random.Generator, duration: float, still: float, heading: float) -> tuple[np.ndarray, ...]:
    """Minimum-jerk hops between random waypoints with rests, after `still` seconds on the ground, and random yaw."""
    knots, points, yaws = [0.0, still], [np.zeros(3), np.zeros(3)], [heading, heading]
    while knots[-1] < duration:
        hop = rng.uniform(5.0, 14.0)
        target = np.append(rng.uniform(-40.0, 40.0, 2), -rng.uniform(5.0, 35.0))
        target = points[-1] + np.clip(target - points[-1], -3.0 * hop, 3.0 * hop)
        knots += [knots[-1] + hop, knots[-1] + hop + rng.uniform(0.0, 3.0)]
        turn = yaws[-1] + rng.uniform(-1.5, 1.5)
        points += [target, target]
        yaws += [turn, turn]
    t = np.arange(0.0, duration, STEP)
    values = np.column_stack([np.array(points), yaws])
    flat = np.zeros((len(knots), 3, 4))
    flat[:, 0] = values
    # In powers, which take a quarter of the time of Bernstein's basis.
    curve = PPoly.from_bernstein_basis(BPoly.from_derivatives(knots, flat))
    place, velocity, acceleration = (curve(t, nu) for nu in range(3))
    return t, place[:, :3], velocity[:, :3], acceleration[:, :3], place[:, 3]


def _walk(rng: np.random.Generator, start: float, density: float, n: int, step: float) -> np.ndarray:
    steps = rng.normal(0.0, density * np.sqrt(step), (n, 3))
    return rng.normal(0.0, start, 3) + np.cumsum(steps, axis=0)


def _gauss_markov(rng: np.random.Generator, sigma: np.ndarray, time: float, n: int, step: float) -> np.ndarray:
    a = np.exp(-step / time)
    noise = rng.normal(size=(n, 3)) * sigma
    noise[1:] *= np.sqrt(1.0 - a * a)
    return lfilter([1.0], [1.0, -a], noise, axis=0)


def fly(
    seed: int, *, duration: float = 120.0, still: float = 8.0, heading: float = 0.4, sensors: Sensors | None = None
) -> Flight:
    """Fly a random path after `still` seconds on the ground with the nose at `heading`, and log it."""
    sensors = sensors or Sensors()
    rng = np.random.default_rng(seed)
    t, position, velocity, acceleration, yaw = _path(rng, duration, still, heading)
    n = len(t)
    frame = LocalFrame.at(PLACE)
    # Thrust carries the craft against gravity and drag; drag is what the accelerometer feels across the thrust.
    thrust = acceleration - np.array([0.0, 0.0, frame.gravity]) + 0.25 * velocity * np.array([1.0, 1.0, 0.3])
    down = -thrust / np.linalg.norm(thrust, axis=1, keepdims=True)
    heading = np.column_stack([np.cos(yaw), np.sin(yaw), np.zeros(n)])
    right = np.cross(down, heading)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    forward = np.cross(right, down)
    roll = np.arctan2(right[:, 2], down[:, 2])
    pitch = -np.arcsin(forward[:, 2])
    quat = quat_from_euler(roll, pitch, np.arctan2(forward[:, 1], forward[:, 0]))
    quat = continuous(quat)
    turning = CubicSpline(t, quat)
    C = matrix_from_quat(quat)
    rate = 2.0 * multiply(quat * np.array([1.0, -1.0, -1.0, -1.0]), turning(t, 1))[:, 1:]
    rate += np.einsum("nji,j->ni", C, frame.earth_rate)
    coriolis = 2.0 * np.cross(frame.earth_rate, velocity)
    force = np.einsum("nji,nj->ni", C, acceleration + coriolis - np.array([0.0, 0.0, frame.gravity]))

    gyro_bias = _walk(rng, sensors.gyro_bias, sensors.gyro_walk, n, STEP)
    accel_bias = _walk(rng, sensors.accel_bias, sensors.accel_walk, n, STEP)
    airborne = (t > still)[:, None]
    phase = 2.0 * np.pi * (np.cumsum(rng.normal(93.0, 30.0, (n, 6)), axis=0) * STEP + rng.random(6))
    shaking = airborne * np.sin(phase)
    gyro = rate + gyro_bias + rng.normal(0.0, sensors.gyro_density / np.sqrt(STEP), (n, 3))
    gyro += sensors.vibration_rate * shaking[:, :3]
    accel = force + accel_bias + rng.normal(0.0, sensors.accel_density / np.sqrt(STEP), (n, 3))
    accel += sensors.vibration_force * shaking[:, 3:]
    if sensors.cutoff > 0.0:
        w = 2.0 * np.pi * sensors.cutoff
        b, a = bilinear([w * w], [1.0, np.sqrt(2.0) * w, w * w], 1.0 / STEP)
        before = [np.zeros((2, 3))] * 2
        for signal, state in zip((gyro, accel), before, strict=True):
            mean = signal[:50].mean(axis=0)
            signal[:] = mean + lfilter(b, a, signal - mean, axis=0, zi=state)[0]
    every = round(1.0 / sensors.imu_rate / STEP)
    imu = inertial(t[::every], gyro[::every], accel[::every])
    names = ["p_n", "p_e", "p_d", "v_n", "v_e", "v_d", "q_w", "q_x", "q_y", "q_z"]
    truth = pd.DataFrame(np.column_stack([position, velocity, quat])[::every], index=imu.index, columns=names)
    names = ["b_gx", "b_gy", "b_gz", "b_ax", "b_ay", "b_az"]
    biases = pd.DataFrame(np.column_stack([gyro_bias, accel_bias])[::every], index=imu.index, columns=names)
    gps = _gps(rng, sensors, frame, t, position, velocity)
    baro, mag = _baro(rng, sensors, t, position), _mag(rng, sensors, t, C)
    # Drawn last, so that the other sensors of a seed are the same with and without.
    second = (_gps(rng, sensors, frame, t, position, velocity),) if sensors.second_gps else ()
    tables = Tables(
        imu=imu,
        gps=gps,
        baro=baro,
        mag=mag,
        rangefinder=_ranges(rng, sensors, t, position, C) if sensors.range_finder else None,
        further={"gps": second} if second else {},
        attitude=timed(t, roll=roll, pitch=pitch, yaw=np.arctan2(np.sin(yaw), np.cos(yaw))).iloc[:: round(0.1 / STEP)],
        parameters={"INS_GYRO_FILTER": sensors.cutoff, "INS_ACCEL_FILTER": sensors.cutoff},
        origin=PLACE,
    )
    return Flight(tables, truth, biases)


def _gps(rng: np.random.Generator, sensors: Sensors, frame: LocalFrame, t, position, velocity) -> pd.DataFrame:
    rows = np.arange(round(0.1 / STEP), len(t), round(1.0 / sensors.gps_rate / STEP))
    m = len(rows)
    sigma = np.array(sensors.gps_error)
    seen = position[rows] + _gauss_markov(rng, sigma, sensors.gps_error_time, m, 1.0 / sensors.gps_rate)
    seen += rng.normal(0.0, sensors.gps_white, (m, 3))
    speed = velocity[rows] + rng.normal(0.0, sensors.gps_speed, (m, 3))
    origin = frame.origin
    return timed(
        t[rows] + sensors.gps_lag,
        t_valid=t[rows],
        lat=origin.lat + seen[:, 0] / frame.metres_per_lat,
        lon=origin.lon + seen[:, 1] / frame.metres_per_lon,
        alt=origin.alt - seen[:, 2],
        v_n=speed[:, 0],
        v_e=speed[:, 1],
        v_d=speed[:, 2],
        fix=3.0,
        satellites=14.0,
        hdop=0.8,
        h_acc=sigma[0],
        v_acc=sigma[2],
        s_acc=sensors.gps_speed,
    )


def _baro(rng: np.random.Generator, sensors: Sensors, t: np.ndarray, position: np.ndarray) -> pd.DataFrame:
    rows = np.arange(0, len(t), round(1.0 / sensors.baro_rate / STEP))
    drift = _walk(rng, 1.0, sensors.baro_walk, len(rows), 1.0 / sensors.baro_rate)[:, 0]
    if sensors.baro_wander > 0.0:
        size = np.array([sensors.baro_wander, 0.0, 0.0])
        drift += _gauss_markov(rng, size, sensors.baro_wander_time, len(rows), 1.0 / sensors.baro_rate)[:, 0]
    alt = -position[rows, 2] + drift + rng.normal(0.0, sensors.baro_white, len(rows))
    return timed(t[rows], alt=alt, pressure=np.nan, temperature=np.nan)


def _ranges(rng: np.random.Generator, sensors: Sensors, t, position, C) -> pd.DataFrame:
    """Return what a sensor 0.1 m above level ground at the origin's height sees along the body's down axis."""
    rows = np.arange(0, len(t), round(0.1 / STEP))
    distance = (0.1 - position[rows, 2]) / C[rows, 2, 2] + rng.normal(0.0, sensors.range_finder, len(rows))
    return timed(t[rows], distance=distance)


def _mag(rng: np.random.Generator, sensors: Sensors, t: np.ndarray, C: np.ndarray) -> pd.DataFrame:
    world = GeoMag(base_year=2020).calculate(
        glat=np.degrees(PLACE.lat), glon=np.degrees(PLACE.lon), alt=PLACE.alt / 1000.0, time=2020.0
    )
    rows = np.arange(0, len(t), round(1.0 / sensors.mag_rate / STEP))
    field_b = np.einsum("nji,j->ni", C[rows], 1e-9 * np.array([world.x, world.y, world.z]))
    field_b += rng.normal(0.0, sensors.hard_iron, 3) + rng.normal(0.0, sensors.mag_white, field_b.shape)
    return timed(t[rows], mag_x=field_b[:, 0], mag_y=field_b[:, 1], mag_z=field_b[:, 2])
