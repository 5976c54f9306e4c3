"""Sensors and actuators of DataFlash logs, from the 2013 firmware to today's."""

import re
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import numpy.typing as npt
import pandas as pd

from core.findings import Finding, Severity
from core.units import numbers, quantities, quantity, sample_times
from logparse.canonical.instances import instances, pick
from logparse.canonical.remarks import Remarks
from logparse.canonical.series import Array, frozen, sample, series
from logparse.craft.frames import Motor

Messages = Mapping[str, pd.DataFrame]
Sensor = tuple[pd.DataFrame | None, tuple[pd.DataFrame, ...]]

#: Servo pulses that exist [us]; outside are unused outputs (0), unset memory (65535, negative) and DShot numbers.
PULSE_RANGE = (800.0, 2250.0)

#: Field [T] that no magnetometer of an autopilot measures, and speed [m/s] and voltage [V] of no multirotor.
_STRONGEST_FIELD, _FASTEST, _HIGHEST_VOLTAGE = 1e-3, 300.0, 1000.0

#: Lag [s] between the validity of a GPS sample and its arrival when GPS_DELAY_MS leaves it to the driver, as in
#: AP_GPS_UBLOX::get_lag: generation 7 and later, and the older ones. The simulator's receiver has its own.
UBLOX_LAG = 0.12
UBLOX_LAG_OLD = 0.22
SITL_LAG = 0.1


def motors(messages: Messages, table: tuple[Motor, ...], remarks: Remarks) -> pd.DataFrame | None:
    """Motor outputs by motor number: RCOU (and RCO2, RCO3 for outputs from 15), or MOT of firmware before 3.1."""
    if "RCOU" not in messages or not len(messages["RCOU"]):
        if "MOT" not in messages:
            return None
        frame = messages["MOT"]
        outputs = {
            int(str(name)[3:]): numbers(frame, str(name)) for name in frame if re.fullmatch(r"Mot\d+", str(name))
        }
        wanted = [motor.number for motor in table] or sorted(outputs)
        columns = {f"m{k}": pulses(outputs[k], "MOT", remarks) for k in wanted if k in outputs}
        return series(frame.index, columns) if columns else None

    frame = messages["RCOU"]
    columns = {}
    late: dict[str, pd.DataFrame] = {}
    for motor in table:
        if motor.channel is None:
            remarks.add(unmapped(motor.number, "RCOU"))
            continue
        name = f"m{motor.number}"
        for message in ("RCOU", "RCO2", "RCO3"):
            if message in messages and (column := _output(messages[message], motor.channel)) is not None:
                driven = pulses(numbers(messages[message], column), message, remarks)
                if message == "RCOU":
                    columns[name] = driven
                else:
                    late[name] = series(messages[message].index, {name: driven})
                break
        else:
            remarks.add(unmapped(motor.number, "RCOU"))
    if not columns and not late:
        return None
    result = series(frame.index, columns)
    for name, other in late.items():
        # RCO2 is written right after RCOU with the same time.
        result[name] = sample(other, result.index.to_numpy(), gap=0.05)[:, 0]
    return result[[f"m{motor.number}" for motor in table if f"m{motor.number}" in result]]


def unmapped(number: int, message: str) -> Finding:
    """Report that a motor's output is not in the log."""
    return Finding(
        id="not-logged",
        severity=Severity.WARNING,
        reason=f"Motor {number} of the frame has no logged servo output.",
        advice=f"Check SERVOn_FUNCTION on the autopilot; {message} must hold the output that drives this motor.",
        evidence={"motor": number},
    )


def _output(frame: pd.DataFrame, channel: int) -> str | None:
    """Column of a servo output: C1, Ch1 or Chan1 by age of the firmware."""
    return next((name for name in (f"C{channel}", f"Ch{channel}", f"Chan{channel}") if name in frame), None)


def pulses(widths: Array, message: str, remarks: Remarks) -> Array:
    """Pulse widths [us]; 0 means no pulse, which is no error."""
    low, high = PULSE_RANGE
    silent = widths == 0.0
    bad = ~((widths >= low) & (widths <= high)) & ~silent
    return remarks.remove(
        np.where(silent, np.nan, widths), bad, message, f"pulse of a motor outside {low:.0f}..{high:.0f} us"
    )


#: Rows of a fast message that are converted at a time.
_PIECE = 1 << 15

#: Fields of the fast messages that `imu` reads, of any age.
_IMU_FIELDS = (
    *(f"{sensor}{axis}" for sensor in ("Gyr", "Acc") for axis in "XYZ"),
    *("I", "Instance", "Inst", "GH", "AH", "GyHlt", "AcHlt", "SampleUS"),
)


def imu(messages: Messages, remarks: Remarks) -> Sensor:
    """Angular rate and specific force: IMU, IMU2, IMU3 or IMU with its instance; ACC1 and GYR1 where IMU is missing."""
    tables = []
    fields = [(f"Gyr{axis}", "rad/s") for axis in "XYZ"] + [(f"Acc{axis}", "m/s/s") for axis in "XYZ"]
    for name, frame in instances(messages, "IMU", "IMU2", "IMU3", fields=_IMU_FIELDS):
        pieces = quantities(frame, fields, _PIECE)
        tables.append((name, _imu_table(frame.index.to_numpy(), pieces, name, remarks, _flags(frame))))
    if not tables:
        for k, (name, gyro) in enumerate(instances(messages, "GYR", "GYR1", "GYR2", "GYR3", fields=_IMU_FIELDS)):
            accel = instances(messages, "ACC", "ACC1", "ACC2", "ACC3", fields=_IMU_FIELDS)
            if k >= len(accel):
                break
            force_name, force = accel[k]
            rate_table = series(_sampled(gyro), {f"r{axis}": quantity(gyro, f"Gyr{axis}", "rad/s") for axis in "XYZ"})
            force_table = series(
                _sampled(force), {f"f{axis}": quantity(force, f"Acc{axis}", "m/s/s") for axis in "XYZ"}
            )
            t = rate_table.index.to_numpy()
            columns = [*rate_table.to_numpy().T, *sample(force_table, t, gap=0.05).T]
            tables.append((name, _imu_table(t, [columns], f"{name}/{force_name}", remarks, None)))
    return pick(tables, "accel_z")


def _sampled(frame: pd.DataFrame) -> Array:
    """Boot time of the samples of a raw sensor message, where it is logged beside the write time."""
    t: Array = frame.index.to_numpy(dtype=np.float64)
    if "SampleUS" in frame:
        sampled = sample_times(frame)
        if np.all(np.abs(sampled - t) < 1.0):
            return sampled
    return t


def _flags(frame: pd.DataFrame) -> npt.NDArray[np.bool_] | None:
    """Whether the autopilot held gyro and accelerometer for healthy, where it says so."""
    for gyro, accel in (("GH", "AH"), ("GyHlt", "AcHlt")):
        if gyro in frame and accel in frame:
            return np.asarray((numbers(frame, gyro) != 0) & (numbers(frame, accel) != 0))
    return None


def _imu_table(
    t: Array,
    pieces: Iterable[Sequence[Array]],
    name: str,
    remarks: Remarks,
    healthy: npt.NDArray[np.bool_] | None,
) -> pd.DataFrame:
    # A few rows at a time, whose columns stay in the cache: as a whole, columns and block would be as large as the log.
    values = np.empty((len(t), 6))
    unknown, wild, zero = np.zeros(len(t), np.bool_), np.zeros(len(t), np.bool_), np.ones(len(t), np.bool_)
    first = 0
    for columns in pieces:
        rows = slice(first, first + len(columns[0]))
        first = rows.stop
        for k, column in enumerate(columns):
            values[rows, k] = column
            unknown[rows] |= ~np.isfinite(column)
            zero[rows] &= column == 0.0
            with np.errstate(invalid="ignore"):
                wild[rows] |= np.abs(column) > (100.0 if k < 3 else 500.0)
    values = remarks.remove(values, unknown, name, "gyro or accelerometer not a number")
    values = remarks.remove(values, zero, name, "gyro and accelerometer all zero")
    values = remarks.remove(values, wild & ~unknown, name, "above 100 rad/s or 500 m/s^2")
    if healthy is not None:
        values = remarks.remove(values, np.asarray(~healthy), name, "sensor marked unhealthy by the autopilot")
    names = ["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"]
    if not unknown.any() and np.isfinite(values).all() and (t[1:] > t[:-1]).all():
        # The longest table of a log stays one block, which the estimator reads as it is.
        return pd.DataFrame(values, index=pd.Index(t.copy(), name="t", dtype=np.float64), columns=names, copy=False)
    return series(t, dict(zip(names, values.T, strict=True)))


def gps(messages: Messages, parameters: Mapping[str, float], old_receiver: bool, remarks: Remarks) -> Sensor:
    """GPS fixes with their time of validity: GPS and GPS2, or GPS with its instance; accuracies of GPA or UBX3."""
    accuracy = instances(messages, "GPA", "GPA2")
    if not accuracy:
        accuracy = [
            (name, frame.rename(columns={"hAcc": "HAcc", "vAcc": "VAcc", "sAcc": "SAcc"}))
            for name, frame in instances(messages, "UBX3")
        ]
    tables = []
    for k, (name, frame) in enumerate(instances(messages, "GPS", "GPS2")):
        lag = gps_lag(parameters, k, old_receiver)
        tables.append((name, _gps_table(frame, accuracy[k][1] if k < len(accuracy) else None, name, lag, remarks)))
    return pick(tables, "lat", int(parameters.get("GPS_PRIMARY", 0)))


def gps_lag(parameters: Mapping[str, float], instance: int, old_receiver: bool) -> float:
    """Receiver lag [s]: GPS_DELAY_MS when it is set, else the default of the u-blox driver or of the simulator."""
    names = (("GPS_DELAY_MS", "GPS1_DELAY_MS"), ("GPS_DELAY_MS2", "GPS2_DELAY_MS"))[min(instance, 1)]
    for name in names:
        delay = parameters.get(name, 0.0)
        if 0.0 < delay < 1000.0:
            return delay * 1e-3
    if any(name.startswith("SIM_") for name in parameters):
        return SITL_LAG
    return UBLOX_LAG_OLD if old_receiver else UBLOX_LAG


def _gps_table(
    frame: pd.DataFrame, accuracy: pd.DataFrame | None, name: str, lag: float, remarks: Remarks
) -> pd.DataFrame:
    t = frame.index.to_numpy(dtype=np.float64)
    fix = numbers(frame, "Status") if "Status" in frame else np.full(len(t), 3.0)
    if "Time" in frame and len(fix) and np.nanmax(fix, initial=0.0) == 2.0:
        # Until 2.9 a good fix has status 2 and there is no 3.
        fix = np.where(fix == 2.0, 3.0, fix)
    lat, lon = quantity(frame, "Lat", "deg"), quantity(frame, "Lng", "deg")
    speed, course = quantity(frame, "Spd", "m/s"), quantity(frame, "GCrs", "deg")
    down = quantity(frame, "VZ", "m/s")
    if not np.any(down[np.isfinite(down)]):
        # Receivers that give no vertical speed have zeros in this column.
        down = np.full(len(t), np.nan)
    values = np.column_stack(
        (lat, lon, quantity(frame, "Alt", "m"), speed * np.cos(course), speed * np.sin(course), down)
    )
    values = clean_fixes(values, fix, name, remarks)
    hdop = quantity(frame, "HDop", "")
    columns = {
        "t_valid": t - lag,
        **dict(zip(("lat", "lon", "alt", "v_n", "v_e", "v_d"), values.T, strict=True)),
        "fix": fix,
        "satellites": quantity(frame, "NSats" if "NSats" in frame else "nSat", ""),
        "hdop": np.where((hdop > 0.0) & (hdop < 99.0), hdop, np.nan),
        "h_acc": np.full(len(t), np.nan),
        "v_acc": np.full(len(t), np.nan),
        "s_acc": np.full(len(t), np.nan),
    }
    if accuracy is None or not len(accuracy):
        return series(t, columns)

    times = accuracy.index.to_numpy(dtype=np.float64)
    details = {
        column: _positive(quantity(accuracy, source, unit))
        for column, source, unit in (("h_acc", "HAcc", "m"), ("v_acc", "VAcc", "m"), ("s_acc", "SAcc", "m/s"))
    }
    if "VV" in accuracy:
        details["has_v_d"] = quantity(accuracy, "VV", "")
    if "SMS" in accuracy:
        # Boot time of the fix's arrival; the row itself can be written a loop or two later.
        details["waited"] = np.clip(times - quantity(accuracy, "SMS", "ms"), 0.0, None)
    # GPA rows follow their GPS row at once; UBX3 rows come by themselves at the receiver's rate.
    rows = series(times, details)
    near = _nearest(rows, t)
    for column in ("h_acc", "v_acc", "s_acc"):
        columns[column] = near[column]
    if "has_v_d" in near:
        columns["v_d"] = np.where(near["has_v_d"] == 0.0, np.nan, columns["v_d"])
    if "waited" in near:
        waited = near["waited"]
        columns["t_valid"] = t - lag - np.where((waited >= 0.0) & (waited < 0.5), waited, 0.0)
    return series(t, columns)


def _nearest(rows: pd.DataFrame, t: Array) -> dict[str, Array]:
    """Columns of the nearest row within 0.3 s of each time, NaN where there is none."""
    times = rows.index.to_numpy()
    right = np.searchsorted(times, t).clip(0, len(times) - 1)
    left = (right - 1).clip(0)
    take = np.where(np.abs(times[left] - t) <= np.abs(times[right] - t), left, right)
    far = np.abs(times[take] - t) > 0.3
    return {str(name): np.where(far, np.nan, rows[name].to_numpy()[take]) for name in rows}


def clean_fixes(values: Array, fix: Array, message: str, remarks: Remarks) -> Array:
    """Remove positions and velocities (columns lat, lon [rad] first) that no receiver can have measured."""
    values = remarks.remove(
        values, (values[:, 0] == 0.0) & (values[:, 1] == 0.0), message, "latitude and longitude zero"
    )
    with np.errstate(invalid="ignore"):
        outside = (np.abs(values[:, 0]) > np.pi / 2.0) | (np.abs(values[:, 1]) > np.pi) | (np.abs(values[:, 2]) > 50e3)
    values = remarks.remove(values, outside, message, "position outside the Earth")
    with np.errstate(invalid="ignore"):
        fast = (np.abs(values[:, 3:]) > _FASTEST).any(axis=1)
    values = remarks.remove(values, np.asarray(fast), message, f"faster than {_FASTEST:.0f} m/s")
    return remarks.remove(values, (fix < 2.0) & np.isfinite(values[:, 0]), message, "no fix")


def _positive(values: Array) -> Array:
    """Accuracies; receivers that do not give one have zero, those without a fix the largest number there is."""
    return np.where((values > 0.0) & (values < 650.0), values, np.nan)


def baro(messages: Messages, parameters: Mapping[str, float], remarks: Remarks) -> Sensor:
    """Pressure altitude: BARO, BAR2, BAR3 or BARO with its instance; the altitude of CTUN in firmware before 3.2."""
    tables = []
    for name, frame in instances(messages, "BARO", "BAR2", "BAR3"):
        alt, pressure = quantity(frame, "Alt", "m"), quantity(frame, "Press", "Pa")
        values = np.column_stack((alt, pressure, quantity(frame, "Temp", "degC")))
        with np.errstate(invalid="ignore"):
            bad = ~np.isfinite(alt) | (np.abs(alt) > 30e3) | (pressure <= 100.0) | (pressure > 2e5)
        values = remarks.remove(values, bad, name, "pressure or altitude outside the atmosphere")
        for flag in ("H", "Health"):
            if flag in frame:
                values = remarks.remove(
                    values, numbers(frame, flag) == 0, name, "sensor marked unhealthy by the autopilot"
                )
        tables.append((name, series(frame.index, dict(zip(("alt", "pressure", "temperature"), values.T, strict=True)))))
    if not tables and "CTUN" in messages:
        frame = messages["CTUN"]
        column = next((name for name in ("BAlt", "BarAlt") if name in frame), None)
        if column is not None:
            missing = np.full(len(frame), np.nan)
            columns = {"alt": quantity(frame, column, "m"), "pressure": missing, "temperature": missing}
            tables.append(("CTUN", series(frame.index, columns)))
    return pick(tables, "alt", int(parameters.get("BARO_PRIMARY", parameters.get("GND_PRIMARY", 0))))


def standard_altitude(pressure: Array) -> Array:
    """Altitude [m] in the troposphere of the international standard atmosphere (ISO 2533) at a pressure [Pa].

    The temperature beside the pressure is that of the sensor's chip, which says little about the air.
    """
    return np.asarray(44330.77 * (1.0 - (pressure / 101325.0) ** 0.190263), dtype=np.float64)


def mag(messages: Messages, parameters: Mapping[str, float], remarks: Remarks) -> Sensor:
    """Magnetic field, calibrated as the autopilot uses it: MAG, MAG2, MAG3 or MAG with its instance."""
    tables = []
    for name, frame in instances(messages, "MAG", "MAG2", "MAG3"):
        values = np.column_stack([quantity(frame, f"Mag{axis}", "mGauss") for axis in "XYZ"])
        values = remarks.remove(values, np.asarray(~np.isfinite(values).all(axis=1)), name, "not a number")
        values = remarks.remove(values, (values == 0.0).all(axis=1), name, "all three axes zero")
        values = remarks.remove(values, frozen(values), name, "one reading throughout")
        strong = np.asarray(np.sum(values**2, axis=1) > _STRONGEST_FIELD**2)
        values = remarks.remove(values, strong, name, "field twenty times that of the Earth")
        if "Health" in frame:
            values = remarks.remove(
                values, numbers(frame, "Health") == 0, name, "sensor marked unhealthy by the autopilot"
            )
        tables.append((name, series(frame.index, dict(zip(("mag_x", "mag_y", "mag_z"), values.T, strict=True)))))
    preferred = int(parameters.get("COMPASS_PRIMARY", 0))
    used = [parameters.get(name, 1.0) for name in ("COMPASS_USE", "COMPASS_USE2", "COMPASS_USE3")]
    if not 0 <= preferred < 3 or not used[preferred]:
        preferred = next((k for k in range(3) if used[k]), 0)
    return pick(tables, "mag_x", preferred)


def battery(messages: Messages, remarks: Remarks) -> Sensor:
    """Voltage and current of the flight battery: BAT (any instance), or CURR of firmware before 3.6."""
    tables = []
    for name, frame in instances(messages, "BAT", "BAT2", "CURR", "CUR2"):
        # Until 3.3 CURR has centivolts and centiamperes, beside columns that later versions lack.
        old = name.startswith("CUR") and any(column in frame for column in ("ThrOut", "ThrInt", "Throttle", "Thr"))
        voltage = quantity(frame, "Volt", "cV" if old else "V")
        current = quantity(frame, "Curr", "cA" if old else "A")
        odd = ~((voltage >= 0.0) & (voltage < _HIGHEST_VOLTAGE))
        voltage = remarks.remove(voltage, odd, name, "voltage impossible")
        # Without a power module the voltage reads zero or a little noise.
        voltage = np.where(voltage > 0.5, voltage, np.nan)
        tables.append((name, series(frame.index, {"voltage": voltage, "current": current})))
    return pick(tables, "voltage")


def esc(messages: Messages, table: tuple[Motor, ...]) -> pd.DataFrame | None:
    """ESC telemetry by motor number, on the times of the first motor that has any: ESC with its instance, or ESC1..."""
    by_output: dict[int, pd.DataFrame] = {}
    if "ESC" in messages:
        for name, frame in instances(messages, "ESC"):
            match = re.search(r"\[(\d+)\]", name)
            by_output[int(match[1]) + 1 if match else 1] = frame
    else:
        by_output = {k: messages[f"ESC{k}"] for k in range(1, 13) if f"ESC{k}" in messages}
    tables = {}
    for motor in table:
        part = by_output.get(motor.channel or motor.number)
        if part is None or not len(part):
            continue
        tables[motor.number] = series(
            part.index,
            {
                "w": quantity(part, "RPM", "rpm"),
                "voltage": quantity(part, "Volt", "V"),
                "current": quantity(part, "Curr", "A"),
            },
        )
    if not tables:
        return None
    times = next(iter(tables.values())).index.to_numpy()
    return beside_each_other(tables, 2.0 * (float(np.median(np.diff(times))) if len(times) > 1 else 1.0))


def beside_each_other(tables: Mapping[int, pd.DataFrame], gap: float) -> pd.DataFrame:
    """Put the telemetry of ESCs, by motor number, on the times of the first."""
    times = next(iter(tables.values())).index.to_numpy()
    joined = {number: sample(table, times, gap=gap) for number, table in tables.items()}
    columns = {
        f"{kind}{number}": values[:, k]
        for k, kind in enumerate(("w", "voltage", "current"))
        for number, values in joined.items()
    }
    return series(times, columns)


def rangefinder(messages: Messages, remarks: Remarks) -> pd.DataFrame | None:
    """Distance of the rangefinder that looks down: RFND, with its instance or with numbered columns."""
    if "RFND" not in messages:
        return None
    frame = messages["RFND"]
    if "Dist" in frame:
        if "Orient" in frame:
            # 25 is MAV_SENSOR_ROTATION_PITCH_270, down.
            down = frame[numbers(frame, "Orient") == 25]
            down.attrs = frame.attrs
            frame = down if len(down) else frame
        distance = quantity(frame, "Dist", "m")
        if "Stat" in frame:
            distance = remarks.remove(distance, numbers(frame, "Stat") < 4, "RFND", "out of range or no data")
    else:
        numbered = next((name for name in ("Dist1", "D1") if name in frame), None)
        if numbered is None:
            return None
        distance = quantity(frame, numbered, "m")
    table = series(frame.index, {"distance": distance})
    return table if table["distance"].notna().any() else None
