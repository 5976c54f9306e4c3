"""What the instruments of a simulated craft write into a DataFlash log, message by message, and the truth beside it.

Message names, fields, formats, units and multipliers follow ArduCopter 4.7. Values are rounded to a resolution far
above the last bit, so that how NumPy vectorises the conversions does not show in a log.
"""

import math

import numpy as np
import numpy.typing as npt
import pandas as pd

from logparse.dataflash.writer import MessageTable
from simulation.instruments import Column, Instruments
from simulation.sensors import SpeedControllers


def table(
    log: Instruments,
    name: str,
    form: str,
    units: str,
    multipliers: str,
    t: npt.ArrayLike,
    columns: dict[str, object],
) -> MessageTable:
    """Return one message table; scalars are repeated, `t` is on the simulation's clock.

    Parameters
    ----------
    log : Instruments
        What its clock has to do with that of the log: `boot`.
    name : str
        Message.
    form : str
        Format characters, that of TimeUS first.
    units, multipliers : str
        Ids of FMTU, one for each field.
    t : array_like, shape (n,)
        Times on the simulation's clock, s.
    columns : dict of str to array_like, shape (n,), or scalar
        Fields after TimeUS, as logged.
    """
    time_us = np.rint((np.asarray(t, dtype=float) + log.boot) * 1e6).astype(np.uint64)
    frame = pd.DataFrame({"TimeUS": time_us, **columns})
    for label, char in zip(frame.columns, form, strict=True):
        if char in "fd" and frame[label].dtype.kind == "f":
            frame[label] = frame[label].round(6)
    return name, form, units, multipliers, frame


def describing_tables(log: Instruments) -> list[MessageTable]:
    """Rows of MSG, PARM and ORGN: what the log is of."""
    texts, parameters, place = log.messages(), log.parameters(), log.place
    return [
        table(log, "MSG", "QZ", "s-", "F-", [t for t, _ in texts], {"Message": [text for _, text in texts]}),
        table(
            log,
            "PARM",
            "QNff",
            "s---",
            "F---",
            np.zeros(len(parameters)),
            {
                "Name": list(parameters),
                "Value": list(map(float, parameters.values())),
                "Default": list(map(float, parameters.values())),
            },
        ),
        table(
            log,
            "ORGN",
            "QBLLe",
            "s#DUm",
            "F-GGB",
            [0.0, 0.0],
            {"Type": [0, 1], "Lat": place.lat_deg, "Lng": place.lon_deg, "Alt": place.alt},
        ),
    ]


def motor_table(log: Instruments) -> MessageTable:
    """Rows of RCOU at 10 Hz: the outputs to the motors."""
    rows = log.rows(10.0)
    n = len(log.vehicle.rotors)
    return table(
        log,
        "RCOU",
        "QHHHHHHHHHHHHHH",
        "sYYYYYYYYYYYYYY",
        "F--------------",
        rows.index,
        {f"C{k}": rows[f"m{k}"].to_numpy() if k <= n else 0 for k in range(1, 15)},
    )


def sensor_tables(log: Instruments, imu_rate: float) -> list[MessageTable]:
    """Rows of IMU (at `imu_rate` Hz), VIBE, GPS, GPA, BARO, MAG and BAT."""
    imu = log.rows(imu_rate)
    gps, baro, mag, battery = log.gps, log.baro, log.mag, log.battery
    sensors = log.sensors
    filtered = log.imu_rate
    week_second, week = log.gps_time(gps["t_valid"].to_numpy())
    v_n, v_e = columns_of(gps, "v_n", "v_e")
    altitude = log.pressure_altitude()
    place = log.place
    climb = -np.interp(baro.index, log.truth.index, log.truth["v_d"])
    energy = (battery["voltage"] * battery["current"]).cumsum() * 0.1 / 3600.0
    capacity = log.vehicle.battery.capacity
    pressure = baro["pressure"].round(2)
    return [
        table(
            log,
            "IMU",
            "QBffffffIIfBBHH",
            "s#EEEooo--O--zz",
            "F-000000-----00",
            imu.index,
            {
                "I": 0,
                **dict(zip(("GyrX", "GyrY", "GyrZ"), columns_of(imu, "gyro_x", "gyro_y", "gyro_z"), strict=True)),
                **dict(zip(("AccX", "AccY", "AccZ"), columns_of(imu, "accel_x", "accel_y", "accel_z"), strict=True)),
                "EG": 0,
                "EA": 0,
                "T": float(round(baro["temperature"].iloc[0] - 273.15 + 15.0, 2)),
                "GH": 1,
                "AH": 1,
                "GHz": round(filtered),
                "AHz": round(filtered),
            },
        ),
        _vibration(log),
        table(
            log,
            "GPS",
            "QBBIHBcLLeffffB",
            "s#-s-S-DUmnhnh-",
            "F--C-0BGGB000--",
            gps.index,
            {
                "I": 0,
                "Status": np.where(gps["fix"], 3, 1),
                "GMS": week_second,
                "GWk": week,
                "NSats": np.where(gps["fix"], 14, 3),
                "HDop": np.where(gps["fix"], 0.8, 99.99),
                "Lat": gps["lat_deg"].to_numpy(),
                "Lng": gps["lon_deg"].to_numpy(),
                "Alt": gps["alt"].to_numpy(),
                "Spd": np.round(np.sqrt(v_n * v_n + v_e * v_e), 3),
                "GCrs": np.round(np.degrees(np.arctan2(v_e, v_n)) % 360.0, 3),
                "VZ": np.round(gps["v_d"].to_numpy(), 3),
                "Yaw": 0.0,
                "U": 1,
            },
        ),
        table(
            log,
            "GPA",
            "QBCCCCfBIHeHH",
            "s#-mmnd-ssm--",
            "F-BBBB0-CCB--",
            gps.index,
            {
                "I": 0,
                "VDop": 1.3,
                "HAcc": round(math.hypot(sensors.gps.horizontal_wander, sensors.gps.position_noise), 2),
                "VAcc": round(math.hypot(sensors.gps.vertical_wander, sensors.gps.position_noise), 2),
                "SAcc": round(sensors.gps.velocity_noise * 2.0, 2),
                "YAcc": 0.0,
                "VV": 1,
                "SMS": gps.index.to_numpy() + log.boot,
                "Delta": 1.0 / sensors.gps.rate,
                "AEl": gps["alt"].to_numpy(),
                "RTCMFU": 0,
                "RTCMFD": 0,
            },
        ),
        table(
            log,
            "BARO",
            "QBfffcfIffBf",
            "s#mmPOnsmO-P",
            "F-000B0C?0-0",
            baro.index,
            {
                "I": 0,
                "Alt": altitude,
                "AltAMSL": altitude + place.alt,
                "Press": pressure.to_numpy(),
                "Temp": (baro["temperature"] - 273.15).to_numpy(),
                "CRt": climb,
                "SMS": baro.index.to_numpy() + log.boot,
                "Offset": 0.0,
                "GndTemp": float(round(baro["temperature"].iloc[0] - 273.15, 2)),
                "H": 1,
                "CPress": pressure.to_numpy(),
            },
        ),
        table(
            log,
            "MAG",
            "QBhhhhhhhhhBI",
            "s#GGGGGGGGG-s",
            "F-CCCCCCCCC-F",
            mag.index,
            {
                "I": 0,
                "MagX": mag["mag_x"].to_numpy() * 1e4,
                "MagY": mag["mag_y"].to_numpy() * 1e4,
                "MagZ": mag["mag_z"].to_numpy() * 1e4,
                **dict.fromkeys(("OfsX", "OfsY", "OfsZ", "MOX", "MOY", "MOZ"), 0.0),
                "Health": 1,
                "S": mag.index.to_numpy() + log.boot,
            },
        ),
        table(
            log,
            "BAT",
            "QBfffffcfBBB",
            "s#vvAaXOw%-%",
            "F-000C0?0000",
            battery.index,
            {
                "Inst": 0,
                "Volt": np.round(battery["voltage"].to_numpy(), 3),
                "VoltR": np.round(
                    battery["voltage"].to_numpy() + battery["current"].to_numpy() * log.vehicle.battery.resistance,
                    3,
                ),
                "Curr": np.round(battery["current"].to_numpy(), 3),
                "CurrTot": battery["charge"].to_numpy() / 3600.0,
                "EnrgTot": energy.to_numpy(),
                "Temp": 0.0,
                "Res": log.vehicle.battery.resistance,
                # As the autopilot does, nothing is left of a pack that gives more than it should hold.
                "RemPct": np.floor(100.0 * np.maximum(0.0, 1.0 - battery["charge"].to_numpy() / 3600.0 / capacity)),
                "H": 1,
                "SH": 0,
            },
        ),
    ]


def _vibration(log: Instruments) -> MessageTable:
    """VIBE at 10 Hz: how much the raw accelerometer shakes, and how often it clipped."""
    rows = log.rows(10.0)
    speeds = rows[[f"w{k}" for k in range(1, len(log.vehicle.rotors) + 1)]].to_numpy()
    hover = log.vehicle.hover_speed(log.place.gravity, log.place.atmosphere.density_at(0.0))
    inertial = log.sensors.inertial
    density = inertial.accel_noise + inertial.accel_vibration * (speeds * speeds).mean(axis=1) / hover**2
    shake = density * math.sqrt(0.5 * log.imu_rate)
    return table(
        log,
        "VIBE",
        "QBfffI",
        "s#ooo-",
        "F-000-",
        rows.index,
        {"IMU": 0, "VibeX": shake, "VibeY": shake, "VibeZ": shake, "Clip": rows["clips"].to_numpy()},
    )


def speed_controller_tables(log: Instruments, rate: float) -> list[MessageTable]:
    """Rows of ESC, one for each motor at `rate` [Hz]: what speed controllers with telemetry report."""
    rotors = len(log.vehicle.rotors)
    samples = SpeedControllers(rate=rate).sample(log.truth, rotors)
    volt = log.rows(rate)["voltage"].to_numpy()
    temperature = log.place.atmosphere.temperature_at(0.0) - 273.15 + 20.0
    order = np.argsort(np.tile(np.arange(len(samples)), rotors), kind="stable")

    def interleaved(columns: list[npt.NDArray[np.float64]]) -> npt.NDArray[np.float64]:
        return np.concatenate(columns)[order]

    rpm = interleaved([samples[f"rpm{k}"].to_numpy() for k in range(1, rotors + 1)])
    currents = [samples[f"current{k}"].to_numpy() for k in range(1, rotors + 1)]
    return [
        table(
            log,
            "ESC",
            "QBffffcfcf",
            "s#qqvAOaO%",
            "F-00--BCB-",
            interleaved([samples.index.to_numpy()] * rotors),
            {
                "Instance": np.repeat(np.arange(rotors), len(samples))[order],
                "RPM": rpm,
                "RawRPM": rpm,
                "Volt": interleaved([volt] * rotors),
                "Curr": interleaved(currents),
                "Temp": round(temperature, 2),
                "CTot": interleaved([current.cumsum() / rate / 3600.0 for current in currents]),
                "MotTemp": round(temperature + 5.0, 2),
                "Err": 0.0,
            },
        )
    ]


def truth_tables(log: Instruments) -> list[MessageTable]:
    """Rows of SIM and SIM2, 25 Hz: attitude, position and velocity as they are."""
    rows = log.rows(25.0)
    lat, lon, alt = log.geodetic(rows)
    w, x, y, z = columns_of(rows, "q_w", "q_x", "q_y", "q_z")
    roll = np.degrees(np.arctan2(2 * (y * z + w * x), 1 - 2 * (x * x + y * y)))
    pitch = np.degrees(np.arcsin(np.clip(2 * (w * y - x * z), -1.0, 1.0)))
    yaw = np.degrees(np.arctan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z))) % 360.0
    v_n, v_e, v_d, wind_n, wind_e, wind_d = columns_of(rows, "v_n", "v_e", "v_d", "wind_n", "wind_e", "wind_d")
    airspeed = np.sqrt((v_n - wind_n) ** 2 + (v_e - wind_e) ** 2 + (v_d - wind_d) ** 2)
    return [
        table(
            log,
            "SIM",
            "QccCfLLffff",
            "sddhmDU----",
            "FBBB0GG0000",
            rows.index,
            {
                "Roll": roll,
                "Pitch": pitch,
                "Yaw": yaw,
                "Alt": np.round(alt, 3),
                "Lat": lat,
                "Lng": lon,
                "Q1": w,
                "Q2": x,
                "Q3": y,
                "Q4": z,
            },
        ),
        table(
            log,
            "SIM2",
            "QdddfffffI",
            "s?????????",
            "F?????????",
            rows.index,
            {
                "PN": rows["p_n"].to_numpy(),
                "PE": rows["p_e"].to_numpy(),
                "PD": rows["p_d"].to_numpy(),
                "VN": v_n,
                "VE": v_e,
                "VD": v_d,
                "As": airspeed,
                "ASpdU": airspeed,
                "UFC": np.arange(len(rows)),
            },
        ),
    ]


def columns_of(frame: pd.DataFrame, *names: str) -> tuple[Column, ...]:
    """Return columns as arrays."""
    return tuple(frame[name].to_numpy(dtype=float) for name in names)
