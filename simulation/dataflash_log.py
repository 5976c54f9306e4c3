"""Write a simulated flight as the DataFlash log that ArduPilot Copter 4.x would have written.

Message names, fields, formats, units, multipliers and rates follow ArduCopter 4.7. What a simulation without an
on-board estimator cannot know (XKF1 and its like) is left out. Values are rounded to a resolution far above the
last bit, so that how NumPy vectorises the conversions does not show in a log.
"""

import math
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd

from logparse.dataflash.writer import MessageTable, write_dataflash
from simulation._kernels import FLYING, LANDING
from simulation.instruments import Column, InstrumentedFlight

_STABILIZE, _AUTO = 0, 3
#: EV.Id of ArduPilot (LogEvent).
_EVENT_ARMED, _EVENT_DISARMED, _EVENT_AUTO_ARMED, _EVENT_LANDED, _EVENT_NOT_LANDED = 10, 11, 15, 18, 28


def write_bin(path: Path, log: InstrumentedFlight, imu_rate: float) -> None:
    """Write the flight as a DataFlash log, IMU rows at `imu_rate` [Hz], truth rows (SIM, SIM2) at 25 Hz."""
    write_dataflash(path, [*_descriptive(log), *_sensors(log, imu_rate), *_autopilot(log), *_truth(log)])


def _table(
    log: InstrumentedFlight,
    name: str,
    form: str,
    units: str,
    multipliers: str,
    t: npt.ArrayLike,
    columns: dict[str, object],
) -> MessageTable:
    """One message table; scalars are repeated, `t` is on the simulation's clock."""
    time_us = np.rint((np.asarray(t, dtype=float) + log.boot) * 1e6).astype(np.uint64)
    frame = pd.DataFrame({"TimeUS": time_us, **columns})
    for label, char in zip(frame.columns, form, strict=True):
        if char in "fd" and frame[label].dtype.kind == "f":
            frame[label] = frame[label].round(6)
    return name, form, units, multipliers, frame


def _descriptive(log: InstrumentedFlight) -> list[MessageTable]:
    flight, place = log.flight, log.flight.setup.place
    reference = flight.reference
    texts = log.messages()
    parameters = log.parameters()
    events = [
        (reference.arm, _EVENT_ARMED),
        (reference.takeoff, _EVENT_AUTO_ARMED),
        (flight.airborne[0], _EVENT_NOT_LANDED),
        (flight.disarm, _EVENT_LANDED),
        (flight.disarm, _EVENT_DISARMED),
    ]
    modes = [_STABILIZE, _AUTO]
    return [
        _table(log, "MSG", "QZ", "s-", "F-", [t for t, _ in texts], {"Message": [text for _, text in texts]}),
        _table(
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
        _table(
            log,
            "ORGN",
            "QBLLe",
            "s#DUm",
            "F-GGB",
            [0.0, 0.0],
            {"Type": [0, 1], "Lat": place.lat_deg, "Lng": place.lon_deg, "Alt": place.alt},
        ),
        _table(
            log,
            "MODE",
            "QMBB",
            "s---",
            "F---",
            [0.0, reference.takeoff],
            {"Mode": modes, "ModeNum": modes, "Rsn": [1, 2]},
        ),
        _table(
            log,
            "ARM",
            "QBIBB",
            "s----",
            "F----",
            [reference.arm, flight.disarm],
            {"ArmState": [1, 0], "ArmChecks": 0, "Forced": 0, "Method": [2, 13]},
        ),
        _table(log, "EV", "QB", "s-", "F-", [t for t, _ in events], {"Id": [event for _, event in events]}),
    ]


def _sensors(log: InstrumentedFlight, imu_rate: float) -> list[MessageTable]:
    imu = log.rows(imu_rate)
    gps, baro, mag, battery = log.gps, log.baro, log.mag, log.battery
    sensors = log.flight.setup.sensors
    filtered = 1.0 / log.flight.setup.step
    week_second, week = log.gps_time(gps["t_valid"].to_numpy())
    v_n, v_e = _columns(gps, "v_n", "v_e")
    altitude = log.pressure_altitude()
    place = log.flight.setup.place
    climb = -np.interp(baro.index, log.flight.truth.index, log.flight.truth["v_d"])
    energy = (battery["voltage"] * battery["current"]).cumsum() * 0.1 / 3600.0
    capacity = log.flight.setup.vehicle.battery.capacity
    pressure = baro["pressure"].round(2)
    return [
        _table(
            log,
            "IMU",
            "QBffffffIIfBBHH",
            "s#EEEooo--O--zz",
            "F-000000-----00",
            imu.index,
            {
                "I": 0,
                **dict(zip(("GyrX", "GyrY", "GyrZ"), _columns(imu, "gyro_x", "gyro_y", "gyro_z"), strict=True)),
                **dict(zip(("AccX", "AccY", "AccZ"), _columns(imu, "accel_x", "accel_y", "accel_z"), strict=True)),
                "EG": 0,
                "EA": 0,
                "T": float(round(baro["temperature"].iloc[0] - 273.15 + 15.0, 2)),
                "GH": 1,
                "AH": 1,
                "GHz": round(filtered),
                "AHz": round(filtered),
            },
        ),
        _table(
            log,
            "GPS",
            "QBBIHBcLLeffffB",
            "s#-s-S-DUmnhnh-",
            "F--C-0BGGB000--",
            gps.index,
            {
                "I": 0,
                "Status": 3,
                "GMS": week_second,
                "GWk": week,
                "NSats": 14,
                "HDop": 0.8,
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
        _table(
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
        _table(
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
        _table(
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
        _table(
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
                    battery["voltage"].to_numpy()
                    + battery["current"].to_numpy() * log.flight.setup.vehicle.battery.resistance,
                    3,
                ),
                "Curr": np.round(battery["current"].to_numpy(), 3),
                "CurrTot": battery["charge"].to_numpy() / 3600.0,
                "EnrgTot": energy.to_numpy(),
                "Temp": 0.0,
                "Res": log.flight.setup.vehicle.battery.resistance,
                "RemPct": np.floor(100.0 * (1.0 - battery["charge"].to_numpy() / 3600.0 / capacity)),
                "H": 1,
                "SH": 0,
            },
        ),
    ]


def _autopilot(log: InstrumentedFlight) -> list[MessageTable]:
    rows = log.rows(10.0)
    flight, place = log.flight, log.flight.setup.place
    gravity = place.gravity
    plan, nav = log.planned(rows), log.navigated(rows)
    active = rows["state"].isin((FLYING, LANDING)).to_numpy()
    n = len(flight.setup.vehicle.rotors)
    degrees = {name: np.degrees(rows[name].to_numpy()) for name in _ANGLES}
    # The autopilot controls on the rate less its estimate of the gyro bias.
    bias = np.degrees(flight.setup.sensors.inertial.gyro_bias)
    baro_altitude = np.interp(rows.index, log.baro.index, log.pressure_altitude())
    climb = -nav["v_d"].to_numpy()

    tables = [
        _table(
            log,
            "ATT",
            "QffffffB",
            "sddddhh-",
            "F000000-",
            rows.index,
            {
                "DesRoll": degrees["roll_ref"],
                "Roll": degrees["roll"],
                "DesPitch": degrees["pitch_ref"],
                "Pitch": degrees["pitch"],
                "DesYaw": degrees["yaw_ref"] % 360.0,
                "Yaw": degrees["yaw"] % 360.0,
                "AEKF": 3,
            },
        ),
        _table(
            log,
            "RATE",
            "Qfffffffffffff",
            "skk-kk-kk-oo--",
            "F?????????BB--",
            rows.index,
            {
                "RDes": degrees["w_x_ref"],
                "R": degrees["gyro_x"] - bias[0],
                "ROut": rows["out_roll"].to_numpy(),
                "PDes": degrees["w_y_ref"],
                "P": degrees["gyro_y"] - bias[1],
                "POut": rows["out_pitch"].to_numpy(),
                "YDes": degrees["w_z_ref"],
                "Y": degrees["gyro_z"] - bias[2],
                "YOut": rows["out_yaw"].to_numpy(),
                "ADes": -rows["a_d_ref"].to_numpy(),
                "A": -rows["a_d"].to_numpy(),
                "AOut": rows["throttle"].to_numpy(),
                "AOutSlew": 0.0,
            },
        ),
        _table(
            log,
            "RCOU",
            "QHHHHHHHHHHHHHH",
            "sYYYYYYYYYYYYYY",
            "F--------------",
            rows.index,
            {f"C{k}": rows[f"m{k}"].to_numpy() if k <= n else 0 for k in range(1, 15)},
        ),
        _table(
            log,
            "CTUN",
            "Qffffffefffhh",
            "s----mmmmmmnn",
            "F----00B000BB",
            rows.index,
            {
                "ThI": rows["throttle_in"].to_numpy(),
                "ABst": rows["angle_boost"].to_numpy(),
                "ThO": rows["throttle"].to_numpy(),
                "ThH": flight.hover_thrust,
                "DAlt": -plan["p_d"].to_numpy(),
                "Alt": -nav["p_d"].to_numpy(),
                "BAlt": baro_altitude,
                "DSAlt": math.nan,
                "SAlt": 0.0,
                "TAlt": 0.0,
                "DCRt": np.where(active, -rows["v_d_ref"], 0.0),
                "CRt": climb,
            },
        ),
    ]
    for axis in "NED":
        low = axis.lower()
        form, units, multipliers = "Qfffffffff", "smmmnnnooo", "F000000000"
        accel = rows[f"a_{low}"].to_numpy()
        measured = nav[f"p_{low}"].to_numpy()
        position = np.where(active, plan[f"p_{low}"], measured)
        tables.append(
            _table(
                log,
                f"PSC{axis}",
                form,
                units,
                multipliers,
                rows.index,
                {
                    f"DP{axis}": position,
                    f"TP{axis}": position,
                    f"P{axis}": measured,
                    f"DV{axis}": np.where(active, plan[f"v_{low}"], 0.0),
                    f"TV{axis}": np.where(active, rows[f"v_{low}_ref"], 0.0),
                    f"V{axis}": nav[f"v_{low}"].to_numpy(),
                    f"DA{axis}": np.where(active, plan[f"a_{low}"], 0.0),
                    f"TA{axis}": np.clip(rows[f"a_{low}_ref"].to_numpy(), -gravity, gravity),
                    f"A{axis}": accel,
                },
            )
        )
    return tables


_ANGLES = (
    *("roll_ref", "pitch_ref", "yaw_ref", "roll", "pitch", "yaw"),
    *("w_x_ref", "w_y_ref", "w_z_ref", "gyro_x", "gyro_y", "gyro_z"),
)


def _truth(log: InstrumentedFlight) -> list[MessageTable]:
    rows = log.rows(25.0)
    lat, lon, alt = log.flight.geodetic(rows)
    w, x, y, z = _columns(rows, "q_w", "q_x", "q_y", "q_z")
    roll = np.degrees(np.arctan2(2 * (y * z + w * x), 1 - 2 * (x * x + y * y)))
    pitch = np.degrees(np.arcsin(np.clip(2 * (w * y - x * z), -1.0, 1.0)))
    yaw = np.degrees(np.arctan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z))) % 360.0
    v_n, v_e, v_d, wind_n, wind_e, wind_d = _columns(rows, "v_n", "v_e", "v_d", "wind_n", "wind_e", "wind_d")
    airspeed = np.sqrt((v_n - wind_n) ** 2 + (v_e - wind_e) ** 2 + (v_d - wind_d) ** 2)
    return [
        _table(
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
        _table(
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


def _columns(frame: pd.DataFrame, *names: str) -> tuple[Column, ...]:
    return tuple(frame[name].to_numpy(dtype=float) for name in names)
