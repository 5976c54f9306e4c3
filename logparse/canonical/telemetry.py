"""Canonical tables of MAVLink telemetry.

Telemetry samples too slowly to integrate an IMU, so the autopilot's own estimate (`Tables.ekf`, `Tables.attitude`)
is the main thing here.
"""

from collections.abc import Mapping

import numpy as np
import pandas as pd
import pymap3d

from core.findings import Finding, Severity
from core.units import numbers, quantity
from logparse.canonical.dataflash_control import origin_of_fixes
from logparse.canonical.dataflash_events import changes, event_table, mode_table
from logparse.canonical.dataflash_sensors import (
    beside_each_other,
    clean_fixes,
    gps_lag,
    pulses,
    standard_altitude,
    unmapped,
)
from logparse.canonical.instances import pick
from logparse.canonical.modes import ardupilot_mode, px4_custom_mode
from logparse.canonical.remarks import Remarks
from logparse.canonical.series import Array, euler_angles, frozen, join, series, with_attitude, wrap
from logparse.craft.frames import Motor, Vehicle
from logparse.craft.vehicle import assumed_outputs, vehicle_heartbeats
from logparse.tables import COLUMNS, Geodetic, Tables

Sensor = tuple[pd.DataFrame | None, tuple[pd.DataFrame, ...]]

#: Time [s] for which a target of roll and pitch stands to the last bit, and the mean angle [rad] between it and the
#: attitude, from which on it is not the one that was flown.
_IDLE_SECONDS, _IDLE_OFF = 10.0, np.radians(5.0)

#: MAV_MODE_FLAG_SAFETY_ARMED in HEARTBEAT.base_mode.
_ARMED = 128


class Sender:
    """Messages of the vehicle's autopilot, those of ground station and companions left out."""

    def __init__(self, messages: Mapping[str, pd.DataFrame]) -> None:
        self._messages = messages
        beats = vehicle_heartbeats(messages)
        self._ids: dict[str, int] = {}
        if beats is not None and len(beats):
            self._ids = {name: int(beats[name].iloc[0]) for name in ("system", "component") if name in beats}

    def __contains__(self, name: str) -> bool:
        return name in self._messages and len(self.get(name)) > 0

    def get(self, name: str) -> pd.DataFrame:
        """Rows of a message that the autopilot sent."""
        frame = self._messages[name]
        keep = np.ones(len(frame), dtype=bool)
        for column, value in self._ids.items():
            if column in frame:
                keep &= frame[column].to_numpy() == value
        if keep.all():
            return frame
        part = frame[keep]
        part.attrs = frame.attrs
        return part


def build(
    messages: Mapping[str, pd.DataFrame], parameters: Mapping[str, float], vehicle: Vehicle, remarks: Remarks
) -> Tables:
    """Build all tables that the messages allow."""
    sender = Sender(messages)
    imu, further_imu = _imu(sender, remarks)
    mag, further_mag = _mag(sender, remarks)
    gps, further_gps = _gps(sender, parameters, remarks)
    baro, further_baro = _baro(sender, parameters, remarks)
    attitude = _attitude(sender)
    origin = _origin(sender, gps)
    ekf = _ekf(sender, attitude, origin)
    further = {"imu": further_imu, "mag": further_mag, "gps": further_gps, "baro": further_baro}
    return Tables(
        motors=_motors(sender, vehicle.motors, parameters, remarks),
        imu=imu,
        gps=gps,
        baro=baro,
        mag=mag,
        battery=_battery(sender),
        esc=_esc(sender, vehicle.motors),
        attitude=attitude,
        setpoints=_setpoints(sender, origin, attitude),
        rates=_rates(sender),
        ekf=ekf,
        rangefinder=_rangefinder(sender),
        modes=_modes(sender, vehicle.firmware),
        events=_events(sender),
        further={name: tables for name, tables in further.items() if tables},
        parameters=parameters,
        origin=origin if origin is not None else origin_of_fixes(gps, ekf),
    )


def _motors(
    sender: Sender, table: tuple[Motor, ...], parameters: Mapping[str, float], remarks: Remarks
) -> pd.DataFrame | None:
    """Servo outputs of the motors from SERVO_OUTPUT_RAW (port 0; port 1 holds outputs from 17)."""
    if "SERVO_OUTPUT_RAW" not in sender:
        return None
    frame = sender.get("SERVO_OUTPUT_RAW")
    if "port" in frame:
        frame = frame[frame["port"] == 0]
    columns = {}
    for motor in table:
        column = f"servo{motor.channel}_raw"
        if motor.channel is None or column not in frame:
            remarks.add(unmapped(motor.number, "SERVO_OUTPUT_RAW"))
        else:
            columns[f"m{motor.number}"] = pulses(numbers(frame, column), "SERVO_OUTPUT_RAW", remarks)
    _remark_assumed(table, parameters, remarks)
    return series(frame.index, columns) if columns else None


def _remark_assumed(table: tuple[Motor, ...], parameters: Mapping[str, float], remarks: Remarks) -> None:
    """Remark which motors are taken to be on the output of their number because their SERVOn_FUNCTION is missing."""
    numbers_assumed = assumed_outputs(table, parameters)
    if numbers_assumed:
        listed = ", ".join(map(str, numbers_assumed))
        remarks.add(
            Finding(
                id="frame-unknown",
                severity=Severity.WARNING,
                reason=f"The log lacks SERVOn_FUNCTION of outputs {listed}; "
                "the motors of these numbers are taken to be on them.",
                advice="Let the ground station download all parameters before take-off.",
                evidence={"motors": listed},
            )
        )


def _imu(sender: Sender, remarks: Remarks) -> Sensor:
    """Angular rate and specific force: HIGHRES_IMU, or RAW_IMU (scaled alike by ArduPilot), SCALED_IMU, 2 and 3."""
    tables: list[tuple[str, pd.DataFrame]] = []
    for name in ("HIGHRES_IMU", "RAW_IMU", "SCALED_IMU", "SCALED_IMU2", "SCALED_IMU3"):
        if name not in sender or (name == "SCALED_IMU" and tables):
            continue
        frame = sender.get(name)
        units = ("rad/s", "m/s/s") if name == "HIGHRES_IMU" else ("mrad/s", "mG")
        values = np.column_stack(
            [quantity(frame, f"{axis}gyro", units[0]) for axis in "xyz"]
            + [quantity(frame, f"{axis}acc", units[1]) for axis in "xyz"]
        )
        zero = (values == 0.0).all(axis=1)
        if zero.all():
            # Sent for a unit that does not exist.
            continue
        values = remarks.remove(values, zero, name, "gyro and accelerometer all zero")
        names = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
        tables.append((name, series(frame.index, dict(zip(names, values.T, strict=True)))))
    return pick(tables, "accel_z")


def _mag(sender: Sender, remarks: Remarks) -> Sensor:
    """Magnetic field beside the IMU in the same messages."""
    tables: list[tuple[str, pd.DataFrame]] = []
    for name in ("HIGHRES_IMU", "RAW_IMU", "SCALED_IMU", "SCALED_IMU2", "SCALED_IMU3"):
        if name not in sender or (name == "SCALED_IMU" and tables):
            continue
        frame = sender.get(name)
        unit = "gauss" if name == "HIGHRES_IMU" else "mgauss"
        values = np.column_stack([quantity(frame, f"{axis}mag", unit) for axis in "xyz"])
        # A unit without a magnetometer sends zeros for ever, which is no error.
        zero = (values == 0.0).all(axis=1)
        if zero.all():
            continue
        values = remarks.remove(values, zero, name, "all three axes of the magnetometer zero")
        values = remarks.remove(values, frozen(values), name, "one reading of the magnetometer throughout")
        tables.append((name, series(frame.index, dict(zip(("mag_x", "mag_y", "mag_z"), values.T, strict=True)))))
    return pick(tables, "mag_x")


def _gps(sender: Sender, parameters: Mapping[str, float], remarks: Remarks) -> Sensor:
    """GPS fixes of GPS_RAW_INT and GPS2_RAW; they have no vertical velocity."""
    tables: list[tuple[str, pd.DataFrame]] = []
    for k, name in enumerate(("GPS_RAW_INT", "GPS2_RAW")):
        if name not in sender:
            continue
        frame = sender.get(name)
        t = frame.index.to_numpy(dtype=np.float64)
        fix = numbers(frame, "fix_type")
        # MAVLink counts no receiver and no fix as 0 and 1, then as the canonical table.
        speed, course = quantity(frame, "vel", "cm/s"), quantity(frame, "cog", "cdeg")
        unknown = (numbers(frame, "vel") == 65535) | (numbers(frame, "cog") == 65535)
        speed = np.where(unknown, np.nan, speed)
        missing = np.full(len(t), np.nan)
        values = np.column_stack(
            (
                quantity(frame, "lat", "degE7"),
                quantity(frame, "lon", "degE7"),
                quantity(frame, "alt", "mm"),
                speed * np.cos(course),
                speed * np.sin(course),
                missing,
            )
        )
        values = clean_fixes(values, fix, name, remarks)
        hdop = numbers(frame, "eph")
        satellites = numbers(frame, "satellites_visible")
        columns = {
            "t_valid": t - gps_lag(parameters, k, "FRAME_CLASS" not in parameters),
            **dict(zip(("lat", "lon", "alt", "v_n", "v_e", "v_d"), values.T, strict=True)),
            "fix": fix,
            "satellites": np.where(satellites == 255.0, np.nan, satellites),
            "hdop": np.where(hdop < 9900.0, hdop / 100.0, np.nan),
        }
        for column, source, unit in (("h_acc", "h_acc", "mm"), ("v_acc", "v_acc", "mm"), ("s_acc", "vel_acc", "mm/s")):
            accuracy = quantity(frame, source, unit)
            columns[column] = np.where(accuracy > 0.0, accuracy, np.nan)
        tables.append((name, series(t, columns)))
    return pick(tables, "lat", int(parameters.get("GPS_PRIMARY", 0)))


def _baro(sender: Sender, parameters: Mapping[str, float], remarks: Remarks) -> Sensor:
    """Pressure altitude of SCALED_PRESSURE, 2 and 3, above the ground pressure that the autopilot calibrated."""
    tables: list[tuple[str, pd.DataFrame]] = []
    for k, name in enumerate(("SCALED_PRESSURE", "SCALED_PRESSURE2", "SCALED_PRESSURE3")):
        if name not in sender:
            continue
        frame = sender.get(name)
        pressure, temperature = quantity(frame, "press_abs", "hPa"), quantity(frame, "temperature", "cdegC")
        bad = ~((pressure > 100.0) & (pressure < 2e5))
        pressure = remarks.remove(pressure, bad, name, "pressure outside the atmosphere")
        ground = _ground_pressure(parameters, k + 1, pressure)
        alt = standard_altitude(pressure) - float(standard_altitude(np.array([ground]))[0])
        warm = parameters.get("BARO_GND_TEMP", parameters.get("GND_TEMP", 0.0))
        if warm:
            # Air at the pilot's ground temperature [degC] instead of the standard one.
            alt = alt * (273.15 + warm) / (288.15 * (ground / 101325.0) ** 0.190263)
        tables.append((name, series(frame.index, {"alt": alt, "pressure": pressure, "temperature": temperature})))
    return pick(tables, "alt")


def _ground_pressure(parameters: Mapping[str, float], instance: int, pressure: Array) -> float:
    """Pressure [Pa] at the ground: the autopilot's own calibration when it fits the log, else the first samples."""
    first = float(np.nanmedian(pressure[:20])) if np.isfinite(pressure[:20]).any() else 101325.0
    for name in (f"BARO{instance}_GND_PRESS", "GND_ABS_PRESS", "BARO_GND_PRESS"):
        ground = parameters.get(name, 0.0)
        # Parameters read before the calibration hold the standard pressure.
        if abs(ground - 101325.0) > 1.0 and abs(ground - first) < 1200.0:
            return float(ground)
    return first


def _battery(sender: Sender) -> pd.DataFrame | None:
    """Voltage and current of SYS_STATUS."""
    if "SYS_STATUS" not in sender:
        return None
    frame = sender.get("SYS_STATUS")
    voltage, current = quantity(frame, "voltage_battery", "mV"), quantity(frame, "current_battery", "cA")
    voltage = np.where((voltage > 0.5) & (numbers(frame, "voltage_battery") != 65535), voltage, np.nan)
    current = np.where(numbers(frame, "current_battery") == -1, np.nan, current)
    return series(frame.index, {"voltage": voltage, "current": current}) if np.isfinite(voltage).any() else None


def _esc(sender: Sender, table: tuple[Motor, ...]) -> pd.DataFrame | None:
    """ESC telemetry in groups of four outputs, on the times of the first group."""
    groups = {}
    for start in range(1, 33, 4):
        name = f"ESC_TELEMETRY_{start}_TO_{start + 3}"
        if name not in sender:
            continue
        frame = sender.get(name)
        for k in range(4):
            kinds = (("w", "rpm", "rpm"), ("voltage", "voltage", "cV"), ("current", "current", "cA"))
            columns = {kind: quantity(frame, f"{source}[{k}]", unit) for kind, source, unit in kinds}
            groups[start + k] = series(frame.index, columns)
    found = {m.number: groups[m.channel or m.number] for m in table if (m.channel or m.number) in groups}
    if not found:
        return None
    return beside_each_other(found, 2.0)


def _attitude(sender: Sender) -> pd.DataFrame | None:
    """Attitude of ATTITUDE, or of ATTITUDE_QUATERNION."""
    if "ATTITUDE" in sender:
        frame = sender.get("ATTITUDE")
        return series(frame.index, {name: wrap(quantity(frame, name, "rad")) for name in ("roll", "pitch", "yaw")})
    if "ATTITUDE_QUATERNION" in sender:
        frame = sender.get("ATTITUDE_QUATERNION")
        angles = euler_angles(*(quantity(frame, f"q{k}", "") for k in range(1, 5)))
        return series(frame.index, dict(zip(("roll", "pitch", "yaw"), angles, strict=True)))
    return None


def _rates(sender: Sender) -> pd.DataFrame | None:
    """Body rates of ATTITUDE; telemetry has neither their targets nor the mixer's inputs."""
    if "ATTITUDE" not in sender:
        return None
    frame = sender.get("ATTITUDE")
    table = pd.DataFrame(
        series(
            frame.index,
            {
                name: quantity(frame, source, "rad/s")
                for name, source in (("w_x", "rollspeed"), ("w_y", "pitchspeed"), ("w_z", "yawspeed"))
            },
        )
    )
    return table.reindex(columns=list(COLUMNS["rates"]))


def _origin(sender: Sender, gps: pd.DataFrame | None) -> Geodetic | None:
    """Origin of the local frame: GPS_GLOBAL_ORIGIN, else the autopilot's home, else the first good fix.

    When LOCAL_POSITION_NED is sent but not its origin, None: it follows from the fixes.
    """
    for name, suffix in (("GPS_GLOBAL_ORIGIN", ""), ("HOME_POSITION", "")):
        if name == "HOME_POSITION" and "LOCAL_POSITION_NED" in sender:
            continue
        if name in sender:
            frame = sender.get(name)
            lat = quantity(frame, f"latitude{suffix}", "degE7")
            lon = quantity(frame, f"longitude{suffix}", "degE7")
            alt = quantity(frame, f"altitude{suffix}", "mm")
            good = np.flatnonzero((lat != 0.0) | (lon != 0.0))
            if len(good):
                return Geodetic(lat=float(lat[good[0]]), lon=float(lon[good[0]]), alt=float(alt[good[0]]))
    if "LOCAL_POSITION_NED" in sender:
        return None
    return origin_of_fixes(gps, None)


def _ekf(sender: Sender, attitude: pd.DataFrame | None, origin: Geodetic | None) -> pd.DataFrame | None:
    """Position and velocity of LOCAL_POSITION_NED or GLOBAL_POSITION_INT with the attitude at their times."""
    if "LOCAL_POSITION_NED" in sender:
        frame = sender.get("LOCAL_POSITION_NED")
        columns = {f"p_{axis}": quantity(frame, source, "m") for axis, source in zip("ned", "xyz", strict=True)}
        columns |= {f"v_{axis}": quantity(frame, f"v{s}", "m/s") for axis, s in zip("ned", "xyz", strict=True)}
    elif "GLOBAL_POSITION_INT" in sender and origin is not None:
        frame = sender.get("GLOBAL_POSITION_INT")
        lat, lon = quantity(frame, "lat", "degE7"), quantity(frame, "lon", "degE7")
        known = (lat != 0.0) | (lon != 0.0)
        lat, lon = np.where(known, lat, np.nan), np.where(known, lon, np.nan)
        position = pymap3d.geodetic2ned(
            lat, lon, quantity(frame, "alt", "mm"), origin.lat, origin.lon, origin.alt, deg=False
        )
        columns = {f"p_{axis}": np.asarray(p) for axis, p in zip("ned", position, strict=True)}
        columns |= {f"v_{axis}": quantity(frame, f"v{s}", "cm/s") for axis, s in zip("ned", "xyz", strict=True)}
    else:
        return None
    return with_attitude(series(frame.index, columns), attitude, gap=1.0)


def _setpoints(sender: Sender, origin: Geodetic | None, attitude: pd.DataFrame | None) -> pd.DataFrame | None:
    """Targets of POSITION_TARGET_*, ATTITUDE_TARGET or NAV_CONTROLLER_OUTPUT, and the throttle of VFR_HUD."""
    parts: list[pd.DataFrame] = []
    if "NAV_CONTROLLER_OUTPUT" in sender:
        frame = sender.get("NAV_CONTROLLER_OUTPUT")
        columns = {name: quantity(frame, f"nav_{name}", "deg") for name in ("roll", "pitch")}
        parts.append(_without_idle(series(frame.index, columns), attitude))
    if "ATTITUDE_TARGET" in sender:
        frame = sender.get("ATTITUDE_TARGET")
        targets = euler_angles(*(quantity(frame, f"q[{k}]", "") for k in range(4)))
        parts.append(series(frame.index, dict(zip(("roll", "pitch", "yaw"), targets, strict=True))))
    if "POSITION_TARGET_LOCAL_NED" in sender:
        frame = sender.get("POSITION_TARGET_LOCAL_NED")
        columns = {f"p_{axis}": quantity(frame, s, "m") for axis, s in zip("ned", "xyz", strict=True)}
        parts.append(_targets(frame, columns))
    elif "POSITION_TARGET_GLOBAL_INT" in sender and origin is not None:
        frame = sender.get("POSITION_TARGET_GLOBAL_INT")
        lat, lon = quantity(frame, "lat_int", "degE7"), quantity(frame, "lon_int", "degE7")
        known = (lat != 0.0) | (lon != 0.0)
        place = pymap3d.geodetic2ned(
            np.where(known, lat, np.nan),
            lon,
            quantity(frame, "alt", "m"),
            origin.lat,
            origin.lon,
            origin.alt,
            deg=False,
        )
        # MAV_FRAME_GLOBAL (0) and _INT (5) have altitudes above sea level; the others are relative to home or terrain.
        down = np.where(np.isin(numbers(frame, "coordinate_frame"), (0, 5)), place[2], np.nan)
        columns = dict(zip(("p_n", "p_e", "p_d"), (*place[:2], down), strict=True))
        parts.append(_targets(frame, columns))
    if "VFR_HUD" in sender:
        frame = sender.get("VFR_HUD")
        parts.append(series(frame.index, {"throttle": numbers(frame, "throttle") / 100.0}))
    return join(parts, COLUMNS["setpoints"], gap=1.5)


def _without_idle(targets: pd.DataFrame, attitude: pd.DataFrame | None) -> pd.DataFrame:
    """Drop the targets of an autopilot that was not steering by them.

    ArduCopter before 3.2 fills NAV_CONTROLLER_OUTPUT in its automatic modes only and goes on sending the last values
    (or zeros) while a pilot flies by stick. A craft that holds a constant target is at it on average.
    """
    if attitude is None or len(attitude) < 2 or len(targets) < 2:
        return targets
    t, asked = targets.index.to_numpy(np.float64), targets[["roll", "pitch"]].to_numpy(np.float64)
    flown = np.column_stack([np.interp(t, attitude.index, attitude[name]) for name in ("roll", "pitch")])
    starts = np.flatnonzero(np.any(np.diff(asked, axis=0, prepend=np.nan) != 0.0, axis=1))
    idle = np.zeros(len(t), dtype=bool)
    for first, last in zip(starts, [*starts[1:], len(t)], strict=True):
        off = np.abs(np.mean(flown[first:last] - asked[first:last], axis=0))
        idle[first:last] = t[last - 1] - t[first] > _IDLE_SECONDS and float(off.max()) > _IDLE_OFF
    return targets[~idle]


def _targets(frame: pd.DataFrame, position: Mapping[str, Array]) -> pd.DataFrame:
    """Position and velocity targets of a POSITION_TARGET message, without those that its type_mask ignores."""
    mask = frame["type_mask"].to_numpy(dtype=np.int64)
    columns = {name: np.where(mask & (1 << k), np.nan, values) for k, (name, values) in enumerate(position.items())}
    for k, (axis, source) in enumerate(zip("ned", "xyz", strict=True), start=3):
        columns[f"v_{axis}"] = np.where(mask & (1 << k), np.nan, quantity(frame, f"v{source}", "m/s"))
        # The message carries what is asked of the controller, nothing of its correction.
        columns[f"v_{axis}_ref"] = columns[f"v_{axis}"]
    return series(frame.index, columns)


def _rangefinder(sender: Sender) -> pd.DataFrame | None:
    """Distance of RANGEFINDER, or of a DISTANCE_SENSOR that looks down."""
    if "RANGEFINDER" in sender:
        frame = sender.get("RANGEFINDER")
        distance = quantity(frame, "distance", "m")
        # Without a rangefinder ArduPilot sends zeros.
        return series(frame.index, {"distance": distance}) if np.any(distance > 0.0) else None
    if "DISTANCE_SENSOR" in sender:
        frame = sender.get("DISTANCE_SENSOR")
        down = frame[frame["orientation"] == 25]
        if len(down):
            down.attrs = frame.attrs
            return series(down.index, {"distance": quantity(down, "current_distance", "cm")})
    return None


def _modes(sender: Sender, firmware: str | None) -> pd.DataFrame | None:
    """Flight modes of HEARTBEAT; one row for each change."""
    if "HEARTBEAT" not in sender:
        return None
    frame = sender.get("HEARTBEAT")
    px4 = int(frame["autopilot"].iloc[0]) == 12
    numbered = (int(value) for value in frame["custom_mode"])
    names = (px4_custom_mode(each) if px4 else ardupilot_mode(each, firmware) for each in numbered)
    return mode_table(frame.index.to_numpy(), names)


def _events(sender: Sender) -> pd.DataFrame | None:
    """Arming of HEARTBEAT and the texts of STATUSTEXT."""
    parts = []
    if "HEARTBEAT" in sender:
        frame = sender.get("HEARTBEAT")
        armed = (frame["base_mode"].to_numpy(dtype=np.int64) & _ARMED) != 0
        parts.append(changes(frame, armed, "ARMED", "DISARMED"))
    if "STATUSTEXT" in sender:
        frame = sender.get("STATUSTEXT")
        texts = [str(text).strip("\x00 ") for text in frame["text"]]
        parts.append((frame.index.to_numpy(), ["MESSAGE" for _ in texts], texts))
    return event_table(parts)
