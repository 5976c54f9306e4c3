"""Sensors of every autopilot and firmware age: which fields hold them, and which of their values are impossible."""

import itertools
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

import numpy as np
import pandas as pd

from core.units import numbers, quantities, sample_times
from logparse.canonical.fields import (
    Fields,
    Kind,
    Messages,
    Sensor,
    axes,
    first,
    has,
    instances,
    names_of,
    pick,
    plain,
    rows_of,
    table,
    value,
    values,
)
from logparse.canonical.remarks import Remarks
from logparse.canonical.series import Array, frozen, sample, series
from logparse.craft.frames import Vehicle
from logparse.craft.vehicle import is_simulated
from logparse.source import INSTANCE_NAMES
from logparse.tables import COLUMNS

Parameters = Mapping[str, float]

#: Beyond what no sensor of a multirotor measures: magnetic field [T], speed [m/s], voltage [V] and altitude [m].
_STRONGEST_FIELD, _FASTEST, _HIGHEST_VOLTAGE, _HIGHEST = 1e-3, 300.0, 1000.0, 50e3
#: Accuracy [m, m/s] and dilution of precision that receivers report when they have no fix.
_NO_ACCURACY, _NO_DILUTION = 650.0, 99.0
#: Lowest and highest pressure of the atmosphere, and the standard one at sea level, Pa.
_PRESSURES, _SEA_LEVEL = (100.0, 2e5), 101325.0

#: Lag [s] between the validity of a GPS sample and its arrival when GPS_DELAY_MS leaves it to the driver, as in
#: AP_GPS_UBLOX::get_lag: generation 7 and later, and the older ones. The simulator's receiver and PX4 have their own.
_UBLOX_LAG, _UBLOX_LAG_OLD, _SITL_LAG, _PX4_LAG = 0.12, 0.22, 0.1, 0.11

#: Rows of a fast message that are converted at a time.
_PIECE = 1 << 15

#: Messages of MAVLink that hold an IMU and a magnetometer; RAW_IMU is scaled as SCALED_IMU is.
_MAVLINK_IMUS = ("HIGHRES_IMU", "RAW_IMU", "SCALED_IMU", "SCALED_IMU2", "SCALED_IMU3")

#: By kind of log: messages of one instance each, or of several with an instance column; and their fields.
_Sources = Mapping[Kind, tuple[tuple[str, ...], Fields]]

_IMU: _Sources = {
    Kind.DATAFLASH: (
        ("IMU", "IMU2", "IMU3"),
        axes({"gyro_{x}": "Gyr{X} rad/s", "accel_{x}": "Acc{X} m/s/s"}, x="xyz", X="XYZ"),
    ),
    Kind.TELEMETRY: (_MAVLINK_IMUS, axes({"gyro_{x}": "{x}gyro mrad/s", "accel_{x}": "{x}acc mG"}, x="xyz")),
    Kind.PX4: (
        ("sensor_combined",),
        axes({"gyro_{x}": "gyro_rad[{k}] rad/s", "accel_{x}": "accelerometer_m_s2[{k}] m/s/s"}, x="xyz", k="012"),
    ),
}
_GPS: _Sources = {
    Kind.DATAFLASH: (
        ("GPS", "GPS2"),
        {
            "lat": "Lat deg",
            "lon": "Lng deg",
            "alt": "Alt m",
            "speed": "Spd m/s",
            "course": "GCrs deg",
            "v_d": "VZ m/s",
            "fix": "Status",
            "satellites": "NSats | nSat",
            "hdop": "HDop",
        },
    ),
    Kind.TELEMETRY: (
        ("GPS_RAW_INT", "GPS2_RAW"),
        {
            "lat": "lat degE7",
            "lon": "lon degE7",
            "alt": "alt mm",
            "speed": "vel cm/s",
            "course": "cog cdeg",
            "fix": "fix_type",
            "satellites": "satellites_visible",
            "hdop": "eph cm",  # in hundredths
            "h_acc": "h_acc mm",
            "v_acc": "v_acc mm",
            "s_acc": "vel_acc mm/s",
        },
    ),
    Kind.PX4: (
        ("vehicle_gps_position", "sensor_gps"),
        {
            "lat": "latitude_deg deg | lat degE7",
            "lon": "longitude_deg deg | lon degE7",
            "alt": "altitude_msl_m m | alt mm",
            "v_n": "vel_n_m_s m/s",
            "v_e": "vel_e_m_s m/s",
            "v_d": "vel_d_m_s m/s",
            "fix": "fix_type",
            "satellites": "satellites_used",
            "hdop": "hdop",
            "h_acc": "eph m",
            "v_acc": "epv m",
            "s_acc": "s_variance_m_s m/s",
        },
    ),
}
_BARO: _Sources = {
    Kind.DATAFLASH: (
        ("BARO", "BAR2", "BAR3"),
        {"alt": "Alt m", "pressure": "Press Pa", "temperature": "Temp degC"},
    ),
    Kind.TELEMETRY: (
        ("SCALED_PRESSURE", "SCALED_PRESSURE2", "SCALED_PRESSURE3"),
        {"alt": "", "pressure": "press_abs hPa", "temperature": "temperature cdegC"},
    ),
    Kind.PX4: (
        ("vehicle_air_data", "sensor_combined", "sensor_baro"),
        {
            "alt": "baro_alt_meter m | altitude m",
            "pressure": "baro_pressure_pa Pa | pressure Pa",
            "temperature": "baro_temp_celcius degC | ambient_temperature degC | temperature degC",
        },
    ),
}
_MAG: _Sources = {
    Kind.DATAFLASH: (("MAG", "MAG2", "MAG3"), axes({"mag_{x}": "Mag{X} mGauss"}, x="xyz", X="XYZ")),
    Kind.TELEMETRY: (_MAVLINK_IMUS, axes({"mag_{x}": "{x}mag mgauss"}, x="xyz")),
    Kind.PX4: (
        ("vehicle_magnetometer", "sensor_combined", "sensor_mag"),
        axes({"mag_{x}": "magnetometer_ga[{k}] gauss | {x} gauss"}, x="xyz", k="012"),
    ),
}
_BATTERY: _Sources = {
    Kind.DATAFLASH: (("BAT", "BAT2", "CURR", "CUR2"), {"voltage": "Volt V", "current": "Curr A"}),
    Kind.TELEMETRY: (("SYS_STATUS",), {"voltage": "voltage_battery mV", "current": "current_battery cA"}),
    Kind.PX4: (("battery_status",), {"voltage": "voltage_v V", "current": "current_a A | current_filtered_a A"}),
}
_RANGE: _Sources = {
    Kind.DATAFLASH: (("RFND",), {"distance": "Dist m | Dist1 m | D1 m"}),
    Kind.TELEMETRY: (("RANGEFINDER", "DISTANCE_SENSOR"), {"distance": "distance m | current_distance cm"}),
    Kind.PX4: (("distance_sensor",), {"distance": "current_distance m"}),
}

#: Fields that are 0 where the autopilot considers a sensor unhealthy, by age of the firmware.
_HEALTHY = (("GH", "AH"), ("GyHlt", "AcHlt"), ("H",), ("Health",))
_UNHEALTHY = "sensor marked unhealthy by the autopilot"


def _instances(
    messages: Messages, kind: Kind, sources: _Sources, wanted: Collection[str] | None = None
) -> list[tuple[str, pd.DataFrame]]:
    """List the instances of a sensor with their names; of PX4 only the first, since older topics repeat it."""
    names, fields = sources[kind]
    logged = [
        (name, frame)
        for name, frame in instances(messages, *names, fields=wanted)
        if len(frame) and any(has(frame, field) for field in fields.values())
    ]
    return logged[:1] if kind is Kind.PX4 else logged


def _unhealthy(values: Array, frame: pd.DataFrame, name: str, remarks: Remarks) -> Array:
    """Remove rows in which the autopilot marked the sensor unhealthy, where it logs that."""
    for flags in _HEALTHY:
        if set(flags) <= set(frame):
            unhealthy = np.any([numbers(frame, flag) == 0.0 for flag in flags], axis=0)
            return remarks.remove(values, np.asarray(unhealthy), name, _UNHEALTHY)
    return values


def imu(messages: Messages, kind: Kind, remarks: Remarks) -> Sensor:
    """Angular rate and specific force; of GYR and ACC where a DataFlash log has no IMU."""
    tables: list[pd.DataFrame] = []
    wanted = names_of(_IMU[kind][1]) | {*INSTANCE_NAMES, *itertools.chain(*_HEALTHY)}
    for name, frame in _instances(messages, kind, _IMU, wanted):
        if name == "SCALED_IMU" and tables:
            continue  # what RAW_IMU has
        pieces = quantities(frame, plain(_IMU[kind][1]), _PIECE)
        made = _imu_table(frame, frame.index.to_numpy(), pieces, name, remarks)
        # A unit that does not exist is sent as zeros.
        if kind is not Kind.TELEMETRY or made["accel_z"].notna().any():
            tables.append(made)
    if not tables and kind is Kind.DATAFLASH:
        tables = [*_raw_imus(messages, remarks)]
    return pick(tables, "accel_z")


def _raw_imus(messages: Messages, remarks: Remarks) -> Iterator[pd.DataFrame]:
    """Yield the tables of GYR with the ACC of the same number."""
    fields = names_of(_IMU[Kind.DATAFLASH][1]) | {*INSTANCE_NAMES, "SampleUS"}
    rates, forces = (
        instances(messages, *(f"{name}{k}" for k in ("", 1, 2, 3)), fields=fields) for name in ("GYR", "ACC")
    )
    for (gyro_name, gyro), (accel_name, accel) in zip(rates, forces, strict=False):
        rate = series(_sampled(gyro), values(gyro, axes({"{X}": "Gyr{X} rad/s"}, X="XYZ")))
        force = series(_sampled(accel), values(accel, axes({"{X}": "Acc{X} m/s/s"}, X="XYZ")))
        t = rate.index.to_numpy()
        columns = [*rate.to_numpy().T, *sample(force, t, gap=0.05).T]
        yield _imu_table(pd.DataFrame(), t, [columns], f"{gyro_name}/{accel_name}", remarks)


def _sampled(frame: pd.DataFrame) -> Array:
    """Boot time of the samples of a raw sensor message, where it is logged beside the write time."""
    t: Array = frame.index.to_numpy(dtype=np.float64)
    if "SampleUS" in frame:
        sampled = sample_times(frame)
        if np.all(np.abs(sampled - t) < 1.0):
            return sampled
    return t


def _imu_table(
    frame: pd.DataFrame, t: Array, pieces: Iterable[Sequence[Array]], name: str, remarks: Remarks
) -> pd.DataFrame:
    # A few rows at a time, whose columns stay in the cache: as a whole, columns and block would be as large as the log.
    block = np.empty((len(t), 6))
    unknown, wild, zero = np.zeros(len(t), np.bool_), np.zeros(len(t), np.bool_), np.ones(len(t), np.bool_)
    start = 0
    for columns in pieces:
        rows = slice(start, start + len(columns[0]))
        start = rows.stop
        for k, column in enumerate(columns):
            block[rows, k] = column
            unknown[rows] |= ~np.isfinite(column)
            zero[rows] &= column == 0.0
            with np.errstate(invalid="ignore"):
                wild[rows] |= np.abs(column) > (100.0 if k < 3 else 500.0)
    names = list(COLUMNS["imu"])
    if zero.all():
        return series(t, dict.fromkeys(names, np.full(len(t), np.nan)))
    block = remarks.remove(block, unknown, name, "gyro or accelerometer not a number")
    block = remarks.remove(block, zero, name, "gyro and accelerometer all zero")
    block = remarks.remove(block, wild & ~unknown, name, "above 100 rad/s or 500 m/s^2")
    block = _unhealthy(block, frame, name, remarks)
    if not unknown.any() and np.isfinite(block).all() and (t[1:] > t[:-1]).all():
        # The longest table of a log stays one block, which the estimator reads as it is.
        return pd.DataFrame(block, index=pd.Index(t.copy(), name="t", dtype=np.float64), columns=names, copy=False)
    return series(t, dict(zip(names, block.T, strict=True)))


def mag(messages: Messages, kind: Kind, parameters: Parameters, remarks: Remarks) -> Sensor:
    """Magnetic field, calibrated as the autopilot uses it."""
    tables: list[pd.DataFrame] = []
    for name, frame in _instances(messages, kind, _MAG):
        if name == "SCALED_IMU" and tables:
            continue
        field = np.column_stack([*values(frame, _MAG[kind][1]).values()])
        zero = (field == 0.0).all(axis=1)
        if kind is Kind.TELEMETRY and zero.all():
            continue  # a unit without a magnetometer
        field = remarks.remove(field, np.asarray(~np.isfinite(field).all(axis=1)), name, "not a number")
        field = remarks.remove(field, zero, name, "all three axes of the magnetometer zero")
        field = remarks.remove(field, frozen(field), name, "one reading of the magnetometer throughout")
        strong = np.asarray(np.sum(field**2, axis=1) > _STRONGEST_FIELD**2)
        field = remarks.remove(field, strong, name, "field twenty times that of the Earth")
        field = _unhealthy(field, frame, name, remarks)
        made = series(frame.index, dict(zip(COLUMNS["mag"], field.T, strict=True)))
        if kind is Kind.PX4:  # sensor_combined repeats the last sample at the rate of the gyro
            made = made[(made.diff().fillna(1.0) != 0.0).any(axis=1)]
        tables.append(made)
    preferred = int(parameters.get("COMPASS_PRIMARY", 0))
    used = [parameters.get(name, 1.0) for name in ("COMPASS_USE", "COMPASS_USE2", "COMPASS_USE3")]
    if not 0 <= preferred < 3 or not used[preferred]:
        preferred = next((k for k in range(3) if used[k]), 0)
    return pick(tables, "mag_x", preferred)


def gps(messages: Messages, kind: Kind, parameters: Parameters, vehicle: Vehicle, remarks: Remarks) -> Sensor:
    """GPS fixes with their time of validity; accuracies of DataFlash are in GPA or UBX3."""
    accuracies = [frame for _, frame in [*instances(messages, "GPA", "GPA2")] or instances(messages, "UBX3")]
    old = _old_receiver(messages, parameters, vehicle)
    tables = []
    for k, (name, frame) in enumerate(_instances(messages, kind, _GPS)):
        if kind is Kind.PX4:
            lag = float(parameters.get("EKF2_GPS_DELAY", 1e3 * _PX4_LAG)) * 1e-3
        else:
            lag = _lag(parameters, k, old)
        made = _fixes(frame, _GPS[kind][1], lag, name, remarks)
        if k < len(accuracies) and kind is Kind.DATAFLASH and len(accuracies[k]):
            made |= _accuracy(accuracies[k], frame.index.to_numpy(np.float64), made)
        tables.append(series(frame.index, made))
    if kind is Kind.PX4:  # also one that never had a fix
        return next(iter(tables), None), ()
    return pick(tables, "lat", int(parameters.get("GPS_PRIMARY", 0)))


def _old_receiver(messages: Messages, parameters: Parameters, vehicle: Vehicle) -> bool:
    """Return whether the GPS receiver is likely of u-blox generation 6 or before.

    Copter 3.5 and later print the receiver's hardware. Before, more satellites than GPS alone shows are a sign of a
    newer one, which uses two constellations at once.
    """
    if "MSG" in messages and "Message" in messages["MSG"]:
        for text in messages["MSG"]["Message"]:
            match = re.search(r"u-blox \d HW: (\w{8})", str(text))
            if match:
                return int(match[1], 16) < 0x00070000
    match = re.match(r"(\d+)\.(\d+)", vehicle.version or "")
    recent = "FRAME_CLASS" in parameters if match is None else (int(match[1]), int(match[2])) >= (3, 5)
    if recent or "GPS" not in messages or "NSats" not in messages["GPS"]:
        return not recent
    seen = numbers(messages["GPS"], "NSats")
    return not (seen[np.isfinite(seen)] > 13).any()


def _lag(parameters: Parameters, instance: int, old_receiver: bool) -> float:
    """Return the receiver's lag [s]: GPS_DELAY_MS if set, else the default of the u-blox driver or the simulator."""
    names = (("GPS_DELAY_MS", "GPS1_DELAY_MS"), ("GPS_DELAY_MS2", "GPS2_DELAY_MS"))[min(instance, 1)]
    for name in names:
        delay = parameters.get(name, 0.0)
        if 0.0 < delay < 1000.0:
            return delay * 1e-3
    if is_simulated(parameters):
        return _SITL_LAG
    return _UBLOX_LAG_OLD if old_receiver else _UBLOX_LAG


def _fixes(frame: pd.DataFrame, fields: Fields, lag: float, name: str, remarks: Remarks) -> dict[str, Array]:
    """Return the columns of the `gps` table of one receiver."""
    t, read = frame.index.to_numpy(dtype=np.float64), values(frame, fields)
    fix = read["fix"] if has(frame, fields["fix"]) else np.full(len(t), 3.0)
    if "Time" in frame and len(fix) and np.nanmax(fix, initial=0.0) == 2.0:
        fix = np.where(fix == 2.0, 3.0, fix)  # until 2.9 a good fix has status 2 and there is no 3
    if "speed" in read:
        unknown = (numbers(frame, "vel") == 65535) | (numbers(frame, "cog") == 65535)  # as MAVLink says so
        speed = np.where(unknown, np.nan, read["speed"])
        read |= {"v_n": speed * np.cos(read["course"]), "v_e": speed * np.sin(read["course"])}
    down = read.get("v_d", np.full(len(t), np.nan))
    # Receivers that give no vertical speed have zeros in this column.
    read["v_d"] = down if np.any(down[np.isfinite(down)]) else np.full(len(t), np.nan)
    measured = ("lat", "lon", "alt", "v_n", "v_e", "v_d")
    fixes = np.column_stack([read[column] for column in measured])
    fixes[np.isnan(fixes[:, :2]).any(axis=1), :2] = np.nan  # half a position is none
    fixes = _clean_fixes(fixes, fix, name, remarks)
    satellites, hdop = read["satellites"], read["hdop"]
    return {
        "t_valid": t - lag,
        **dict(zip(measured, fixes.T, strict=True)),
        "fix": fix,
        "satellites": np.where(satellites == 255.0, np.nan, satellites),
        "hdop": np.where((hdop > 0.0) & (hdop < _NO_DILUTION), hdop, np.nan),
        **{column: _reported(read.get(column, np.full(len(t), np.nan))) for column in ("h_acc", "v_acc", "s_acc")},
    }


def _accuracy(frame: pd.DataFrame, t: Array, fixes: Mapping[str, Array]) -> dict[str, Array]:
    """Return the columns of fixes that GPA or UBX3 hold more exactly.

    GPA rows follow their GPS row at once; UBX3 rows come by themselves at the receiver's rate.
    """
    fields = {"h_acc": "HAcc m | hAcc m", "v_acc": "VAcc m | vAcc m", "s_acc": "SAcc m/s | sAcc m/s"}
    details = {column: _reported(accuracy) for column, accuracy in values(frame, fields).items()}
    if "VV" in frame:
        details["has_v_d"] = numbers(frame, "VV")
    if "SMS" in frame:
        # Boot time of the fix's arrival; the row itself can be written a loop or two later.
        details["waited"] = np.clip(frame.index.to_numpy(np.float64) - value(frame, "SMS ms"), 0.0, None)
    near = _nearest(series(frame.index, details), t)
    waited = near.pop("waited", np.zeros(len(t)))
    near["t_valid"] = fixes["t_valid"] - np.where((waited >= 0.0) & (waited < 0.5), waited, 0.0)
    near["v_d"] = np.where(near.pop("has_v_d", np.ones(len(t))) == 0.0, np.nan, fixes["v_d"])
    return near


def _nearest(rows: pd.DataFrame, t: Array) -> dict[str, Array]:
    """Return the columns of the nearest row within 0.3 s of each time, NaN where there is none."""
    times = rows.index.to_numpy()
    right = np.searchsorted(times, t).clip(0, len(times) - 1)
    left = (right - 1).clip(0)
    take = np.where(np.abs(times[left] - t) <= np.abs(times[right] - t), left, right)
    far = np.abs(times[take] - t) > 0.3
    return {str(name): np.where(far, np.nan, rows[name].to_numpy()[take]) for name in rows}


def _clean_fixes(fixes: Array, fix: Array, message: str, remarks: Remarks) -> Array:
    """Remove positions and velocities (columns lat, lon [rad], alt first) that no receiver can have measured."""
    fixes = remarks.remove(fixes, (fixes[:, :2] == 0.0).all(axis=1), message, "latitude and longitude zero")
    outside = (np.abs(fixes[:, :3]) > (np.pi / 2.0, np.pi, _HIGHEST)).any(axis=1)
    fixes = remarks.remove(fixes, np.asarray(outside), message, "position outside the Earth")
    fast = (np.abs(fixes[:, 3:]) > _FASTEST).any(axis=1)
    fixes = remarks.remove(fixes, np.asarray(fast), message, f"faster than {_FASTEST:.0f} m/s")
    return remarks.remove(fixes, (fix < 2.0) & np.isfinite(fixes[:, 0]), message, "no fix")


def _reported(accuracy: Array) -> Array:
    """Return accuracies; NaN for the zero of receivers that report none and the huge number of those without a fix."""
    return np.where((accuracy > 0.0) & (accuracy < _NO_ACCURACY), accuracy, np.nan)


def baro(messages: Messages, kind: Kind, parameters: Parameters, remarks: Remarks) -> Sensor:
    """Pressure altitude above the ground; the altitude of CTUN in firmware before 3.2."""
    tables = []
    for k, (name, frame) in enumerate(_instances(messages, kind, _BARO)):
        read = values(frame, _BARO[kind][1])
        alt, pressure = read["alt"], read["pressure"]
        if kind is Kind.PX4 and np.nanmax(pressure, initial=0.0) < 2000.0:
            pressure = pressure * 100.0  # hPa in old sensor_baro
        pressure = np.where(pressure > 0.0, pressure, np.nan) if kind is not Kind.DATAFLASH else pressure
        if kind is Kind.TELEMETRY:
            alt = _above_ground(pressure, parameters, k + 1)
        elif kind is Kind.PX4:
            alt = _above_start(alt if np.isfinite(alt).any() else standard_altitude(pressure))
        least, most = _PRESSURES
        bad = ~np.isfinite(alt) | (np.abs(alt) > 30e3) | (pressure <= least) | (pressure > most)
        block = np.column_stack((alt, pressure, read["temperature"]))
        block = remarks.remove(block, bad, name, "pressure or altitude outside the atmosphere")
        block = _unhealthy(block, frame, name, remarks)
        tables.append(series(frame.index, dict(zip(COLUMNS["baro"], block.T, strict=True))))
    if not tables and kind is Kind.DATAFLASH and (ctun := first(messages, "CTUN")) is not None:
        fields = {"alt": "BAlt m | BarAlt m"}
        tables = [table(ctun, fields).reindex(columns=list(COLUMNS["baro"]))] if has(ctun, fields["alt"]) else []
    return pick(tables, "alt", int(parameters.get("BARO_PRIMARY", parameters.get("GND_PRIMARY", 0))))


def standard_altitude(pressure: Array) -> Array:
    """Return the altitude [m] at a pressure [Pa] in the troposphere of the standard atmosphere (ISO 2533).

    The temperature logged beside the pressure is that of the sensor's chip, which says little about the air.
    """
    return np.asarray(44330.77 * (1.0 - (pressure / _SEA_LEVEL) ** 0.190263), dtype=np.float64)


def _above_start(alt: Array) -> Array:
    """Return altitudes above the first ones: PX4 logs those of the standard atmosphere."""
    finite = alt[np.isfinite(alt)]
    return alt - float(np.median(finite[: max(len(finite) // 50, 5)])) if len(finite) else alt


def _above_ground(pressure: Array, parameters: Parameters, instance: int) -> Array:
    """Return the altitude [m] above the ground pressure that ArduPilot calibrated, as it computes it."""
    ground = _ground_pressure(parameters, instance, pressure)
    alt = standard_altitude(pressure) - float(standard_altitude(np.array([ground]))[0])
    if warm := parameters.get("BARO_GND_TEMP", parameters.get("GND_TEMP", 0.0)):
        # Air at the pilot's ground temperature [degC] instead of the standard one.
        alt = alt * (273.15 + warm) / (288.15 * (ground / _SEA_LEVEL) ** 0.190263)
    return alt


def _ground_pressure(parameters: Parameters, instance: int, pressure: Array) -> float:
    """Return the pressure [Pa] at the ground: of the autopilot's calibration where it fits the log, else the first."""
    start = float(np.nanmedian(pressure[:20])) if np.isfinite(pressure[:20]).any() else _SEA_LEVEL
    for name in (f"BARO{instance}_GND_PRESS", "GND_ABS_PRESS", "BARO_GND_PRESS"):
        ground = parameters.get(name, 0.0)
        # Parameters read before the calibration hold the standard pressure.
        if abs(ground - _SEA_LEVEL) > 1.0 and abs(ground - start) < 1200.0:
            return float(ground)
    return start


def battery(messages: Messages, kind: Kind, remarks: Remarks) -> Sensor:
    """Voltage and current of the flight battery."""
    tables = []
    for name, frame in _instances(messages, kind, _BATTERY):
        fields = _BATTERY[kind][1]
        if name.startswith("CUR") and {"ThrOut", "ThrInt", "Throttle", "Thr"} & set(frame):
            fields = {"voltage": "Volt cV", "current": "Curr cA"}  # until 3.3, with columns that later versions lack
        read = values(frame, fields)
        voltage, current = read["voltage"], read["current"]
        if kind is not Kind.DATAFLASH:  # -1 where it is not measured
            voltage = np.where(numbers(frame, "voltage_battery") == 65535, np.nan, voltage)
            current = np.where(current < 0.0, np.nan, current)
        odd = ~((voltage >= 0.0) & (voltage < _HIGHEST_VOLTAGE)) & (np.isfinite(voltage) | (kind is Kind.DATAFLASH))
        voltage = remarks.remove(voltage, odd, name, "voltage impossible")
        # Without a power module the voltage reads zero or a little noise.
        voltage = np.where(voltage > 0.5, voltage, np.nan)
        tables.append(series(frame.index, {"voltage": voltage, "current": current}))
    return pick(tables, "voltage")


def rangefinder(messages: Messages, kind: Kind, remarks: Remarks) -> pd.DataFrame | None:
    """Distance of the rangefinder that looks down."""
    sensors = _instances(messages, kind, _RANGE)
    # 25 is MAV_SENSOR_ROTATION_PITCH_270, down.
    down = [
        (name, rows_of(frame, numbers(frame, column) == 25)) for name, frame in sensors for column in _facing(frame)
    ]
    unknown = [(name, frame) for name, frame in sensors if kind is Kind.DATAFLASH or not _facing(frame)]
    for name, frame in (*((name, frame) for name, frame in down if len(frame)), *unknown):
        made = table(frame, _RANGE[kind][1])
        if "Stat" in frame:
            bad = numbers(frame, "Stat") < 4
            distance = remarks.remove(value(frame, _RANGE[kind][1]["distance"]), bad, name, "out of range or no data")
            made = series(frame.index, {"distance": distance})
        # Without a rangefinder ArduPilot sends zeros.
        if made["distance"].any() and made["distance"].notna().any():
            return made
    return None


def _facing(frame: pd.DataFrame) -> list[str]:
    """List the column with the direction in which a rangefinder looks; empty where there is none."""
    return [column for column in ("Orient", "orientation") if column in frame]
