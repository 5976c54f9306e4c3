"""What the papers' flights share: printed numbers, and logs of flights that no ArduPilot cascade flew.

Such a log holds instruments, motors and truth, and of the autopilot only the attitude, which is the true one.
"""

import dataclasses
import datetime as dt
import json
import math
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.signal import butter, lfilter, lfilter_zi

from logparse.craft.frames import FRAME_TYPES, motor_table
from simulation._kernels import actuator
from simulation.flight_log import write_open_loop
from simulation.instruments import Instruments, attitude_angles
from simulation.place import Place
from simulation.sensors import Sensors, rotate_to_body
from simulation.truth import describe_place, describe_sensors, describe_vehicle
from simulation.vehicle import Multirotor, Vector

#: Tables of the papers; see `papers.toml`.
PRINTED = tomllib.loads(Path(__file__).with_name("papers.toml").read_text(encoding="utf-8"))

#: Where the papers' flights are logged: at sea level, with standard gravity.
FIELD = Place(name="sea level", lat_deg=45.5, lon_deg=8.0, alt=0.0)

#: Of the sensors' noise.
_SEED = 1

_START = dt.datetime(2025, 1, 15, 12, 0, 0, tzinfo=dt.UTC)
_BOOT = 20.0
_FILTER = 20.0


def write_paper_log(
    path: pd.DataFrame,
    vehicle: Multirotor,
    folder: Path,
    name: str,
    summary: str,
    *,
    gravity: float,
    wind: Vector = (0.0, 0.0, 0.0),
) -> list[Path]:
    """Write the log (`.bin`) and the truth (`.json`) of a flight."""
    order = motor_order(vehicle)
    renamed = {f"w{k + 1}": f"w{number}" for number, k in enumerate(order, start=1)}
    craft = dataclasses.replace(vehicle, rotors=tuple(vehicle.rotors[k] for k in order))
    sensors = Sensors()
    log = Instruments(
        _truth(path.rename(columns=renamed), craft, sensors, gravity, wind),
        craft,
        FIELD,
        sensors,
        seed=_SEED,
        start_utc=_START,
        boot=_BOOT,
        filter_frequency=_FILTER,
        imu_rate=1.0 / (path.index[1] - path.index[0]),
    )
    files = [folder / f"{name}.bin", folder / f"{name}.json"]
    write_open_loop(files[0], log)
    truth = {
        "name": name,
        "what": f"simulated by rotorid, not flown: {summary}",
        "time_s": {"log_start": _BOOT, "airborne": [_BOOT, round(_BOOT + path.index[-1], 3)]},
        "place": describe_place(FIELD) | {"gravity_m_s2": gravity},
        "wind": {"mean_ned_m_s": list(wind)},
        "vehicle": describe_vehicle(craft, float(log.truth["voltage"].mean())),
        "number_of_each_motor_in_the_paper": [k + 1 for k in order],
        "sensors": describe_sensors(log, 50.0),
    }
    files[1].write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")
    return files


def motor_order(vehicle: Multirotor) -> list[int]:
    """Index of the rotor that is ArduPilot's motor 1, 2, 3 and 4 of this quadcopter's frame."""
    order = []
    for motor in motor_table("quad", FRAME_TYPES[vehicle.frame_type]):
        for k, mount in enumerate(vehicle.rotors):
            turn = math.atan2(mount.position[1], mount.position[0]) - motor.angle
            if abs(math.remainder(turn, 2.0 * math.pi)) < 0.02 and mount.spin == motor.spin:
                order.append(k)
    return order


def _truth(path: pd.DataFrame, craft: Multirotor, sensors: Sensors, gravity: float, wind: Vector) -> pd.DataFrame:
    """Complete the state by what instruments feel, at 100 Hz."""
    t = path.index.to_numpy()
    dt_path = t[1] - t[0]
    acceleration = np.gradient(path[["v_n", "v_e", "v_d"]].to_numpy(), dt_path, axis=0)
    force = rotate_to_body(path[["q_w", "q_x", "q_y", "q_z"]].to_numpy(), acceleration - np.array([0.0, 0.0, gravity]))
    raw = np.column_stack((path[["w_x", "w_y", "w_z"]].to_numpy(), force))
    inertial, density = sensors.inertial, math.sqrt(0.5 / dt_path)
    noise = np.random.RandomState(_SEED * 10).standard_normal(raw.shape) * density
    noise[:, :3] *= inertial.gyro_noise + inertial.gyro_vibration
    noise[:, 3:] *= inertial.accel_noise + inertial.accel_vibration
    b, a = butter(2, _FILTER, fs=1.0 / dt_path)
    measured, _ = lfilter(b, a, raw + noise, axis=0, zi=np.outer(lfilter_zi(b, a), raw[0]))
    n = len(craft.rotors)
    speeds = path[[f"w{k}" for k in range(1, n + 1)]].to_numpy()
    power = np.zeros(len(t))
    for mount, speed in zip(craft.rotors, speeds.T, strict=True):
        # Both kinds of rotor take torque as the square of the speed at rest in the air.
        power += mount.rotor.torque(100.0) / 100.0**2 * speed**3
    drive, battery = craft.drive, craft.battery
    current = (battery.avionics_power + power / drive.efficiency) / drive.voltage_reference
    voltage = drive.voltage_reference - battery.resistance * current
    shares = (speeds / drive.speed_max * (drive.voltage_reference / voltage)[:, None]) ** 2
    span = drive.pwm_at_full_thrust - drive.pwm_at_zero_thrust
    pwm = [[int(drive.pwm_at_zero_thrust + span * actuator(share, drive.expo)) for share in row] for row in shares]
    names = ("f_x", "f_y", "f_z", "a_n", "a_e", "a_d", "gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
    felt = np.column_stack((force, acceleration, measured))
    truth = path.assign(
        **dict(zip(names, felt.T, strict=True)),
        **dict(zip(("wind_n", "wind_e", "wind_d"), wind, strict=True)),
        **dict(zip(("roll", "pitch", "yaw"), attitude_angles(path), strict=True)),
        voltage=voltage,
        current=current,
        charge=np.cumsum(current) * dt_path,
        clips=0,
        **{f"m{k}": column for k, column in enumerate(np.array(pwm, dtype=float).T, start=1)},
    )
    return truth.iloc[:: round(0.01 / dt_path)]
