"""Write a simulated flight as the telemetry log that a ground station would have recorded.

Message names, fields, units and rates follow the MAVLink streams of ArduCopter 4.x at 10 Hz.
"""

import datetime as dt
import math
from pathlib import Path

import numpy as np
import pandas as pd

from logparse.mavlink.writer import write_tlog as write_messages
from simulation._kernels import FLYING, LANDING
from simulation.atmosphere import GRAVITY
from simulation.instruments import InstrumentedFlight

_STABILIZE, _AUTO = 0, 3
_ARDUPILOT = 3
#: MAV_TYPE by number of rotors.
_TYPES = {4: 2, 6: 13, 8: 14}
_MODE_CUSTOM, _MODE_ARMED = 1, 128
_STANDBY, _ACTIVE = 3, 4
_INFO, _REAL32 = 6, 9


def write_tlog(path: Path, log: InstrumentedFlight) -> None:
    """Write the flight as a `.tlog`; receive times are the times of sending (a link without delay)."""
    start = log.start_utc - dt.timedelta(seconds=log.boot)
    write_messages(path, [(name, _on_boot_clock(frame, log.boot)) for name, frame in _messages(log)], start)


def _on_boot_clock(frame: pd.DataFrame, boot: float) -> pd.DataFrame:
    return frame.set_axis(pd.Index(frame.index.to_numpy(dtype=float) + boot, name="t"))


def _messages(log: InstrumentedFlight) -> list[tuple[str, pd.DataFrame]]:
    flight = log.flight
    rows = log.rows(10.0)
    t = rows.index
    boot_ms = np.rint((t.to_numpy() + log.boot) * 1e3)
    nav = log.navigated(rows)
    lat, lon, alt = log.geodetic(nav)
    motors = {f"servo{k}_raw": rows[f"m{k}"] for k in range(1, len(flight.setup.vehicle.rotors) + 1)}
    mag = log.mag.reindex(t, method="nearest")
    bias = flight.setup.sensors.inertial.gyro_bias
    imu = {f"{axis}acc": rows[f"accel_{axis}"] / GRAVITY * 1e3 for axis in "xyz"}
    imu |= {f"{axis}gyro": rows[f"gyro_{axis}"] * 1e3 for axis in "xyz"}
    imu |= {f"{axis}mag": mag[f"mag_{axis}"] * 1e7 for axis in "xyz"}
    horizontal = np.sqrt(nav["v_n"] ** 2 + nav["v_e"] ** 2)
    messages: list[tuple[str, pd.DataFrame]] = [
        ("PARAM_VALUE", _parameters(log)),
        ("HEARTBEAT", _heartbeats(log)),
        (
            "SYSTEM_TIME",
            pd.DataFrame(
                {
                    "time_unix_usec": [_unix_us(log.start_utc + dt.timedelta(seconds=s)) for s in t[::10]],
                    "time_boot_ms": boot_ms[::10],
                },
                index=t[::10],
            ),
        ),
        (
            "ATTITUDE",
            pd.DataFrame(
                {
                    "time_boot_ms": boot_ms,
                    "roll": rows["roll"].round(6),
                    "pitch": rows["pitch"].round(6),
                    "yaw": rows["yaw"].round(6),
                    "rollspeed": (rows["gyro_x"] - bias[0]).round(6),
                    "pitchspeed": (rows["gyro_y"] - bias[1]).round(6),
                    "yawspeed": (rows["gyro_z"] - bias[2]).round(6),
                },
                index=t,
            ),
        ),
        (
            "GLOBAL_POSITION_INT",
            pd.DataFrame(
                {
                    "time_boot_ms": boot_ms,
                    "lat": lat * 1e7,
                    "lon": lon * 1e7,
                    "alt": alt * 1e3,
                    "relative_alt": -nav["p_d"] * 1e3,
                    "vx": nav["v_n"] * 1e2,
                    "vy": nav["v_e"] * 1e2,
                    "vz": nav["v_d"] * 1e2,
                    "hdg": np.degrees(rows["yaw"]) % 360.0 * 1e2 % 35999.5,
                },
                index=t,
            ),
        ),
        (
            "LOCAL_POSITION_NED",
            pd.DataFrame(
                {"time_boot_ms": boot_ms, "x": nav["p_n"], "y": nav["p_e"], "z": nav["p_d"]}
                | {"vx": nav["v_n"], "vy": nav["v_e"], "vz": nav["v_d"]},
                index=t,
            ).round(6),
        ),
        ("SERVO_OUTPUT_RAW", pd.DataFrame({"port": 0, **motors}, index=t)),
        ("RAW_IMU", pd.DataFrame(imu, index=t)),
        ("GPS_RAW_INT", _gps(log)),
        (
            "SCALED_PRESSURE",
            pd.DataFrame(
                {
                    "press_abs": (log.baro["pressure"] / 100.0).round(4),
                    "temperature": (log.baro["temperature"] - 273.15) * 100.0,
                },
                index=log.baro.index,
            ),
        ),
        (
            "VFR_HUD",
            pd.DataFrame(
                {
                    "airspeed": horizontal,
                    "groundspeed": horizontal,
                    "heading": np.floor(np.degrees(rows["yaw"]) % 360.0),
                    "throttle": np.floor(rows["throttle"] * 100.0),
                    "alt": alt,
                    "climb": -nav["v_d"],
                },
                index=t,
            )
            .round(6)
            .iloc[::2],
        ),
        (
            "SYS_STATUS",
            pd.DataFrame(
                {
                    "voltage_battery": log.battery["voltage"] * 1e3,
                    "current_battery": log.battery["current"] * 1e2,
                    "battery_remaining": np.floor(100.0 * (1.0 - log.battery["charge"] / _capacity(log))),
                },
                index=log.battery.index,
            ).iloc[::5],
        ),
        ("SIMSTATE", _truth(log)),
        ("STATUSTEXT", _texts(log)),
    ]
    return messages


def _capacity(log: InstrumentedFlight) -> float:
    return log.flight.setup.vehicle.battery.capacity * 3600.0


def _unix_us(moment: dt.datetime) -> int:
    return (moment - dt.datetime(1970, 1, 1, tzinfo=dt.UTC)) // dt.timedelta(microseconds=1)


def _parameters(log: InstrumentedFlight) -> pd.DataFrame:
    parameters = log.parameters()
    n = len(parameters)
    # Sent one after the other once the link is up, as a ground station asks for them.
    return pd.DataFrame(
        {
            "param_id": list(parameters),
            "param_value": list(parameters.values()),
            "param_type": _REAL32,
            "param_count": n,
            "param_index": range(n),
        },
        index=0.5 + 0.02 * np.arange(n),
    )


def _heartbeats(log: InstrumentedFlight) -> pd.DataFrame:
    rows = log.rows(1.0)
    armed = (rows.index >= log.flight.reference.arm) & (rows.index < log.flight.disarm)
    flying = rows["state"].isin((FLYING, LANDING)).to_numpy()
    return pd.DataFrame(
        {
            "type": _TYPES[len(log.flight.setup.vehicle.rotors)],
            "autopilot": _ARDUPILOT,
            "base_mode": np.where(armed, _MODE_CUSTOM | _MODE_ARMED, _MODE_CUSTOM),
            "custom_mode": np.where(rows.index >= log.flight.reference.takeoff, _AUTO, _STABILIZE),
            "system_status": np.where(flying, _ACTIVE, _STANDBY),
            "mavlink_version": 3,
        },
        index=rows.index,
    )


def _gps(log: InstrumentedFlight) -> pd.DataFrame:
    gps, sensors = log.gps, log.flight.setup.sensors
    return pd.DataFrame(
        {
            # The receiver's own time of the sample; the row comes later by the receiver's lag.
            "time_usec": np.rint((gps["t_valid"] + log.boot) * 1e6),
            "fix_type": np.where(gps["fix"], 3, 1),
            "lat": gps["lat_deg"] * 1e7,
            "lon": gps["lon_deg"] * 1e7,
            "alt": gps["alt"] * 1e3,
            "eph": 80,
            "epv": 130,
            "vel": np.sqrt(gps["v_n"] ** 2 + gps["v_e"] ** 2) * 1e2,
            "cog": np.degrees(np.arctan2(gps["v_e"], gps["v_n"])) % 360.0 * 1e2 % 35999.5,
            "satellites_visible": 14,
            "alt_ellipsoid": gps["alt"] * 1e3,
            "h_acc": round(1e3 * math.hypot(sensors.gps.horizontal_wander, sensors.gps.position_noise)),
            "v_acc": round(1e3 * math.hypot(sensors.gps.vertical_wander, sensors.gps.position_noise)),
            "vel_acc": round(2e3 * sensors.gps.velocity_noise),
        },
        index=gps.index,
    )


def _truth(log: InstrumentedFlight) -> pd.DataFrame:
    rows = log.rows(10.0)
    w, x, y, z = (rows[name] for name in ("q_w", "q_x", "q_y", "q_z"))
    lat, lon, _ = log.geodetic(rows)
    columns = {
        "roll": np.arctan2(2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
        "pitch": np.arcsin(2 * (w * y - x * z)),
        "yaw": np.arctan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z)),
        **{f"{axis}acc": rows[f"f_{axis}"] for axis in "xyz"},
        **{f"{axis}gyro": rows[f"w_{axis}"] for axis in "xyz"},
    }
    frame = pd.DataFrame(columns, index=rows.index).round(6)
    return frame.assign(lat=lat * 1e7, lng=lon * 1e7)


def _texts(log: InstrumentedFlight) -> pd.DataFrame:
    messages = log.messages()
    return pd.DataFrame(
        {"severity": _INFO, "text": [text[:50] for _, text in messages]}, index=[t for t, _ in messages]
    )
