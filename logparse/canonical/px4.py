"""Canonical tables of PX4 logs (ulog). Topics are in SI units, NED and FRD already."""

import re
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pandas as pd

from core.units import numbers
from logparse.canonical.dataflash_events import changes, event_table, mode_table
from logparse.canonical.dataflash_sensors import PULSE_RANGE, clean_fixes, standard_altitude
from logparse.canonical.modes import PX4_MODES
from logparse.canonical.remarks import Remarks
from logparse.canonical.series import Array, euler_angles, join, sample, series, with_attitude
from logparse.canonical.stray import without_stray, without_stray_rows
from logparse.craft.frames import Motor, Vehicle
from logparse.tables import COLUMNS, Geodetic, Tables

Messages = Mapping[str, pd.DataFrame]

#: Pause [s] in a signal of autotuning that ends it.
_SILENT = 1.0

#: EKF2_GPS_DELAY of PX4 when the log does not have the parameter [ms].
_GPS_DELAY = 110.0


def build(messages: Messages, parameters: Mapping[str, float], vehicle: Vehicle, remarks: Remarks) -> Tables:
    """Build all tables that the topics allow."""
    gps = _gps(messages, parameters, remarks)
    attitude = _attitude(messages)
    imu = _imu(messages, remarks)
    tables = Tables(
        motors=_motors(messages, vehicle, _dshot(parameters), remarks),
        imu=imu,
        gps=gps,
        baro=_baro(messages),
        mag=_mag(messages),
        battery=_battery(messages),
        esc=_esc(messages, vehicle.motors),
        attitude=attitude,
        setpoints=_setpoints(messages),
        rates=_rates(messages),
        systemid=_systemid(messages),
        ekf=_ekf(messages, attitude),
        rangefinder=_rangefinder(messages),
        modes=_modes(messages),
        events=_events(messages),
        parameters=parameters,
        origin=_origin(messages, gps),
    )
    return without_stray_rows(replace(tables, imu=without_stray(imu, "imu", remarks)), remarks)


def _values(frame: pd.DataFrame, *names: str) -> Array:
    """First of the columns that the topic has (names changed over the years), as numbers; infinite ones are none."""
    for name in names:
        if name in frame:
            values = numbers(frame, name)
            values[np.isinf(values)] = np.nan
            return values
    return np.full(len(frame), np.nan)


def _first(messages: Messages, *names: str) -> pd.DataFrame | None:
    """First of the topics that is logged with at least one row."""
    for name in names:
        if name in messages and len(messages[name]):
            return messages[name]
    return None


def _dshot(parameters: Mapping[str, float]) -> bool:
    """Whether the motors are driven by DShot: a timer of the outputs set to -5..-2, or DSHOT_CONFIG before 1.13."""
    timers = [value for name, value in parameters.items() if name.startswith(("PWM_MAIN_TIM", "PWM_AUX_TIM"))]
    return any(-5.0 <= value <= -2.0 for value in timers) or parameters.get("DSHOT_CONFIG", 0.0) > 0.0


def _motors(messages: Messages, vehicle: Vehicle, dshot: bool, remarks: Remarks) -> pd.DataFrame | None:
    """Motor outputs in us: pulses as they are, DShot commands and commands of 0..1 as the pulses they stand for."""
    low, high = PULSE_RANGE
    frame = _outputs(messages, vehicle.motors)
    largest = float(np.nanmax(frame.to_numpy(), initial=0.0)) if frame is not None else 0.0
    if frame is not None and dshot and largest > 1.0:
        # DShot throttle runs from 0 to 1999 (48..2047 on the wire).
        return 1000.0 + 0.5 * frame.clip(0.0, 2000.0)
    if frame is not None and largest >= low and not (frame.gt(0.0) & frame.lt(low)).to_numpy().any():
        columns = {}
        for name in frame:
            pulses = frame[name].where(frame[name] != 0.0).to_numpy(np.float64)
            bad = np.isfinite(pulses) & ~((pulses >= low) & (pulses <= high))
            columns[str(name)] = remarks.remove(pulses, bad, "actuator_outputs", "pulse of a motor impossible")
        return series(frame.index, columns)
    # Outputs of simulators and CAN are speeds; what each motor was asked for is not.
    asked = _first(messages, "actuator_motors")
    if asked is None:
        return None if frame is None or largest <= 1.0 else 1000.0 + 0.5 * frame.clip(0.0, 2000.0)
    numbers = [motor.number for motor in vehicle.motors] or [
        k for k in range(1, 13) if np.isfinite(_values(asked, f"control[{k - 1}]")).any()
    ]
    return series(asked.index, {f"m{k}": 1000.0 + 1000.0 * _values(asked, f"control[{k - 1}]") for k in numbers})


def _outputs(messages: Messages, motors: tuple[Motor, ...]) -> pd.DataFrame | None:
    """Return the outputs of the motors in the first group (main, auxiliary, CAN) in which all of them move."""
    groups = []
    for name in messages:
        if motors and re.fullmatch(r"actuator_outputs(_\d+)?", name):
            for first in (1, 9):  # auxiliary outputs are numbered from 9, and from 1 in a group of their own
                channels = {m.number: (m.channel or m.number) - first for m in motors}
                columns = {f"m{k}": _values(messages[name], f"output[{at}]") for k, at in channels.items()}
                groups.append(series(messages[name].index, columns))
    moving = (group for group in groups if len(group) and (group.max() > group.min()).all())
    return next(moving, groups[0] if groups else None)


def _imu(messages: Messages, remarks: Remarks) -> pd.DataFrame | None:
    """Read the selected gyro and accelerometer of sensor_combined, integrals over each interval divided by it."""
    frame = _first(messages, "sensor_combined")
    if frame is None:
        return None
    columns = {f"gyro_{axis}": _values(frame, f"gyro_rad[{k}]") for k, axis in enumerate("xyz")}
    columns |= {f"accel_{axis}": _values(frame, f"accelerometer_m_s2[{k}]") for k, axis in enumerate("xyz")}
    values = np.column_stack(list(columns.values()))
    values = remarks.remove(values, np.asarray(~np.isfinite(values).all(axis=1)), "sensor_combined", "not a number")
    return series(frame.index, dict(zip(columns, values.T, strict=True)))


def _gps(messages: Messages, parameters: Mapping[str, float], remarks: Remarks) -> pd.DataFrame | None:
    """GPS fixes of vehicle_gps_position or sensor_gps; before 1.14 latitude and longitude are integers of 1e-7 deg."""
    frame = _first(messages, "vehicle_gps_position", "sensor_gps")
    if frame is None:
        return None
    t = frame.index.to_numpy(dtype=np.float64)
    if "latitude_deg" in frame:
        lat, lon = np.radians(_values(frame, "latitude_deg")), np.radians(_values(frame, "longitude_deg"))
        alt = _values(frame, "altitude_msl_m")
    else:
        lat, lon = np.radians(_values(frame, "lat") * 1e-7), np.radians(_values(frame, "lon") * 1e-7)
        alt = _values(frame, "alt") * 1e-3
    fix = _values(frame, "fix_type")
    velocity = [_values(frame, f"vel_{axis}_m_s") for axis in "ned"]
    values = clean_fixes(np.column_stack((lat, lon, alt, *velocity)), fix, "vehicle_gps_position", remarks)
    delay = float(parameters.get("EKF2_GPS_DELAY", _GPS_DELAY)) * 1e-3
    hdop = _values(frame, "hdop")
    columns = {
        "t_valid": t - delay,
        **dict(zip(("lat", "lon", "alt", "v_n", "v_e", "v_d"), values.T, strict=True)),
        "fix": fix,
        "satellites": _values(frame, "satellites_used"),
        "hdop": np.where(hdop < 99.0, hdop, np.nan),
        "h_acc": _accuracy(_values(frame, "eph")),
        "v_acc": _accuracy(_values(frame, "epv")),
        "s_acc": _accuracy(_values(frame, "s_variance_m_s")),
    }
    return series(t, columns)


def _accuracy(values: Array) -> Array:
    """Accuracies; without a fix the receiver sends thousands of kilometres."""
    return np.where((values > 0.0) & (values < 1e4), values, np.nan)


def _baro(messages: Messages) -> pd.DataFrame | None:
    """Pressure altitude of vehicle_air_data, sensor_baro or (2016 to 2017) sensor_combined, above its first value."""
    frame = _first(messages, "vehicle_air_data", "sensor_combined" if _has_baro(messages) else "", "sensor_baro")
    if frame is None:
        return None
    pressure = _values(frame, "baro_pressure_pa", "pressure")
    if np.nanmax(pressure, initial=0.0) < 2000.0:
        pressure = pressure * 100.0  # hPa in old sensor_baro
    alt = _values(frame, "baro_alt_meter", "altitude")
    if not np.isfinite(alt).any():
        alt = standard_altitude(np.where(pressure > 0.0, pressure, np.nan))
    temperature = _values(frame, "baro_temp_celcius", "ambient_temperature", "temperature") + 273.15
    finite = alt[np.isfinite(alt)]
    if not len(finite):
        return None
    # Above the start: PX4 logs the altitude in the standard atmosphere.
    alt = alt - float(np.median(finite[: max(len(finite) // 50, 5)]))
    return series(frame.index, {"alt": alt, "pressure": pressure, "temperature": temperature})


def _has_baro(messages: Messages) -> bool:
    return "sensor_combined" in messages and "baro_alt_meter" in messages["sensor_combined"]


def _mag(messages: Messages) -> pd.DataFrame | None:
    """Magnetic field of vehicle_magnetometer, sensor_combined (before 2018) or sensor_mag, from gauss."""
    for name, column in (
        ("vehicle_magnetometer", "magnetometer_ga[{}]"),
        ("sensor_combined", "magnetometer_ga[{}]"),
        ("sensor_mag", "{}"),
    ):
        if name in messages and column.format("x" if column == "{}" else 0) in messages[name]:
            frame = messages[name]
            keys = "xyz" if column == "{}" else "012"
            values = np.column_stack([_values(frame, column.format(key)) for key in keys]) * 1e-4
            table = series(frame.index, dict(zip(("mag_x", "mag_y", "mag_z"), values.T, strict=True)))
            # sensor_combined repeats the last magnetometer sample at the rate of the gyro.
            fresh = (table.diff().fillna(1.0) != 0.0).any(axis=1)
            return table[fresh]
    return None


def _battery(messages: Messages) -> pd.DataFrame | None:
    """Voltage and current of battery_status."""
    frame = _first(messages, "battery_status")
    if frame is None:
        return None
    voltage, current = _values(frame, "voltage_v"), _values(frame, "current_a", "current_filtered_a")
    voltage = np.where(voltage > 0.5, voltage, np.nan)
    return series(frame.index, {"voltage": voltage, "current": np.where(current < 0.0, np.nan, current)})


def _esc(messages: Messages, table: tuple[Motor, ...]) -> pd.DataFrame | None:
    """ESC telemetry of esc_status."""
    frame = _first(messages, "esc_status")
    if frame is None:
        return None
    # Since 1.13 an ESC says which motor it drives (101 for the first).
    entries = {int(np.nanmax(_values(frame, f"esc[{k}].actuator_function"), initial=0)) - 100: k for k in range(12)}
    columns = {}
    for kind, source, factor in (("w", "rpm", np.pi / 30.0), ("voltage", "voltage", 1.0), ("current", "current", 1.0)):
        for motor in table:
            values = _values(frame, f"esc[{entries.get(motor.number, motor.number - 1)}].esc_{source}")
            columns[f"{kind}{motor.number}"] = values * factor
    return series(frame.index, columns) if columns else None


def _quaternion_angles(frame: pd.DataFrame, name: str) -> dict[str, Array]:
    angles = euler_angles(*(_values(frame, f"{name}[{k}]") for k in range(4)))
    return dict(zip(("roll", "pitch", "yaw"), angles, strict=True))


def _attitude(messages: Messages) -> pd.DataFrame | None:
    """Attitude of vehicle_attitude."""
    frame = _first(messages, "vehicle_attitude")
    return None if frame is None else series(frame.index, _quaternion_angles(frame, "q"))


def _ekf(messages: Messages, attitude: pd.DataFrame | None) -> pd.DataFrame | None:
    """Position and velocity of vehicle_local_position where it calls them valid, with the attitude at its times."""
    frame = _first(messages, "vehicle_local_position")
    if frame is None:
        return None
    columns = {}
    for names, axes, flag in (
        (("p_n", "p_e"), ("x", "y"), "xy_valid"),
        (("p_d",), ("z",), "z_valid"),
        (("v_n", "v_e"), ("vx", "vy"), "v_xy_valid"),
        (("v_d",), ("vz",), "v_z_valid"),
    ):
        valid = _values(frame, flag)
        for name, axis in zip(names, axes, strict=True):
            columns[name] = np.where(valid == 0.0, np.nan, _values(frame, axis))
    return with_attitude(series(frame.index, columns), attitude, gap=0.2)


def _origin(messages: Messages, gps: pd.DataFrame | None) -> Geodetic | None:
    """Origin: the reference of vehicle_local_position (ref_lat, ref_lon in degrees), or the first good fix."""
    frame = _first(messages, "vehicle_local_position")
    if frame is not None:
        lat, lon, alt = _values(frame, "ref_lat"), _values(frame, "ref_lon"), _values(frame, "ref_alt")
        good = np.flatnonzero(np.isfinite(lat) & np.isfinite(lon) & np.isfinite(alt) & (lat != 0.0))
        if len(good):
            k = good[0]
            return Geodetic(lat=float(np.radians(lat[k])), lon=float(np.radians(lon[k])), alt=float(alt[k]))
    if gps is None:
        return None
    fixes = gps[(gps["fix"] >= 3.0) & gps["lat"].notna()]
    return Geodetic(*(float(fixes[name].iloc[0]) for name in ("lat", "lon", "alt"))) if len(fixes) else None


def _setpoints(messages: Messages) -> pd.DataFrame | None:
    """Targets of position and velocity, attitude and thrust, on the times of the most frequent of their topics."""
    parts = []
    frame = _first(messages, "vehicle_local_position_setpoint", "trajectory_setpoint")
    if frame is not None:
        position = [_values(frame, axis, f"position[{k}]") for k, axis in enumerate("xyz")]
        velocity = [_values(frame, f"v{axis}", f"velocity[{k}]") for k, axis in enumerate("xyz")]
        names = ("p_n", "p_e", "p_d", "v_n", "v_e", "v_d")
        parts.append(series(frame.index, dict(zip(names, (*position, *velocity), strict=True))))
    if "trajectory_setpoint" in messages:
        asked = messages["trajectory_setpoint"]
        velocity = [_values(asked, f"v{axis}", f"velocity[{k}]") for k, axis in enumerate("xyz")]
        parts.append(series(asked.index, dict(zip(("v_n_ref", "v_e_ref", "v_d_ref"), velocity, strict=True))))
    frame = _first(messages, "vehicle_attitude_setpoint")
    if frame is not None:
        columns = _quaternion_angles(frame, "q_d")
        thrust = _values(frame, "thrust_body[2]")
        columns["throttle"] = -thrust if np.isfinite(thrust).any() else _values(frame, "thrust")
        parts.append(series(frame.index, columns))
    return join(parts, COLUMNS["setpoints"], gap=0.3)


def _rates(messages: Messages) -> pd.DataFrame | None:
    """Rate controller: vehicle_angular_velocity with vehicle_rates_setpoint and the torque and thrust commands."""
    frame = _first(messages, "vehicle_angular_velocity")
    if frame is not None:
        columns = {f"w_{axis}": _values(frame, f"xyz[{k}]") for k, axis in enumerate("xyz")}
    else:
        frame = _first(messages, "vehicle_attitude")
        if frame is None or "rollspeed" not in frame:
            return None
        columns = {
            f"w_{axis}": _values(frame, f"{name}speed")
            for axis, name in zip("xyz", ("roll", "pitch", "yaw"), strict=True)
        }
    table = series(frame.index, columns).reindex(columns=list(COLUMNS["rates"]))
    t = table.index.to_numpy()
    wanted = _first(messages, "vehicle_rates_setpoint")
    if wanted is not None:
        part = series(wanted.index, {name: _values(wanted, name) for name in ("roll", "pitch", "yaw")})
        table[["w_x_ref", "w_y_ref", "w_z_ref"]] = sample(part, t, gap=0.1)
    torque, thrust = _first(messages, "vehicle_torque_setpoint"), _first(messages, "vehicle_thrust_setpoint")
    controls = _first(messages, "actuator_controls_0")
    outputs = ["out_roll", "out_pitch", "out_yaw"]
    if torque is not None and thrust is not None:
        part = series(torque.index, {name: _values(torque, f"xyz[{k}]") for k, name in enumerate(outputs)})
        table[outputs] = sample(part, t, gap=0.1)
        table["out_thrust"] = sample(series(thrust.index, {"z": -_values(thrust, "xyz[2]")}), t, gap=0.1)[:, 0]
    elif controls is not None:
        names = [*outputs, "out_thrust"]
        part = series(controls.index, {name: _values(controls, f"control[{k}]") for k, name in enumerate(names)})
        table[names] = sample(part, t, gap=0.2)
    return table


def _systemid(messages: Messages) -> pd.DataFrame | None:
    """Signals that autotuning adds to the rate targets, where it does; it logs no frequency."""
    frame = _first(messages, "autotune_attitude_control_status")
    if frame is None:
        return None
    t = frame.index.to_numpy(np.float64)
    added = np.column_stack([_values(frame, f"rate_sp[{k}]") for k in range(3)])
    moving = np.nan_to_num(np.abs(added)) > 0.0
    # A signal passes through zero: a run lasts until its axis is silent for a second.
    axis = np.full(len(t), -1)
    for k in range(3):
        at = t[moving[:, k]]
        if len(at):
            after = np.searchsorted(at, t, "right") - 1
            before = np.searchsorted(at, t)
            near = (after >= 0) & (before < len(at))
            gap = at[np.minimum(before, len(at) - 1)] - at[np.maximum(after, 0)]
            axis[near & (gap <= _SILENT) & (axis < 0)] = k
    rows = np.flatnonzero(axis >= 0)
    if not len(rows):
        return None
    first = np.concatenate([[True], (np.diff(axis[rows]) != 0) | (np.diff(t[rows]) > _SILENT)])
    began = t[rows][np.maximum.accumulate(np.where(first, np.arange(len(rows)), 0))]
    # As SID_AXIS numbers signals that are added to rate targets.
    columns = {"axis": 7.0 + axis[rows], "target": np.degrees(added[rows, axis[rows]]), "elapsed": t[rows] - began}
    return series(t[rows], columns).reindex(columns=list(COLUMNS["systemid"]))


def _rangefinder(messages: Messages) -> pd.DataFrame | None:
    """Distance of distance_sensor looking down."""
    frame = _first(messages, "distance_sensor")
    if frame is None:
        return None
    down = frame[frame["orientation"] == 25] if "orientation" in frame else frame
    return series(down.index, {"distance": _values(down, "current_distance")}) if len(down) else None


def _modes(messages: Messages) -> pd.DataFrame | None:
    """Flight modes of vehicle_status."""
    frame = _first(messages, "vehicle_status")
    if frame is None or "nav_state" not in frame:
        return None
    states = (int(value) for value in frame["nav_state"])
    return mode_table(frame.index.to_numpy(), (PX4_MODES.get(state, f"MODE_{state}") for state in states))


def _events(messages: Messages) -> pd.DataFrame | None:
    """Arming, take-off and landing, and the logged texts."""
    parts = []
    frame = _first(messages, "vehicle_status")
    if frame is not None and "arming_state" in frame:
        parts.append(changes(frame, frame["arming_state"].to_numpy() == 2, "ARMED", "DISARMED"))
    frame = _first(messages, "vehicle_land_detected")
    if frame is not None and "landed" in frame:
        parts.append(changes(frame, frame["landed"].to_numpy() == 0, "TAKEOFF", "LAND_COMPLETE"))
    frame = _first(messages, "logged_messages")
    if frame is not None and "message" in frame:
        texts = [str(text) for text in frame["message"]]
        parts.append((frame.index.to_numpy(), ["MESSAGE" for _ in texts], texts))
    return event_table(parts)
