"""What the autopilot estimated and wanted, in DataFlash logs: attitude, own position, targets, rates, truth."""

from collections.abc import Collection, Iterator, Mapping

import numpy as np
import pandas as pd
import pymap3d

from core.cubic_spline import cubic_spline
from core.units import numbers, quantity
from logparse.canonical.instances import instances, some_fields
from logparse.canonical.series import Array, columns_of, euler_angles, join, quaternions, sample, series, wrap
from logparse.craft.frames import Vehicle
from logparse.tables import COLUMNS, Geodetic

Messages = Mapping[str, pd.DataFrame]


def attitude(messages: Messages) -> pd.DataFrame | None:
    """Roll, pitch and yaw: ATT or the faster ANG, or the filter's quaternion or angles where neither is logged."""
    candidates = [name for name in ("ATT", "ANG") if name in messages and len(messages[name]) > 1]
    if candidates:
        # ANG comes at the rate of the attitude loop where fast attitude logging is on.
        return _angles(max((messages[name] for name in candidates), key=len))
    core = _core(messages, ("XKQ", "NKQ", "XKQ1", "NKQ1"))
    if core is not None and {"Q1", "Q2", "Q3", "Q4"} <= set(core.columns):
        roll, pitch, yaw = euler_angles(*(quantity(core, f"Q{k}", "") for k in range(1, 5)))
        return series(core.index, {"roll": roll, "pitch": pitch, "yaw": yaw})
    for names in (("XKF1", "NKF1", "EKF1"), ("AHR2",)):
        core = _core(messages, names)
        if core is not None:
            return _angles(core)
    return None


def _angles(frame: pd.DataFrame, prefix: str = "") -> pd.DataFrame:
    """Roll, pitch, yaw [rad] of a message that has them in degrees."""
    columns = {name.lower(): wrap(quantity(frame, f"{prefix}{name}", "deg")) for name in ("Roll", "Pitch", "Yaw")}
    return series(frame.index, columns)


def _core(messages: Messages, names: tuple[str, ...]) -> pd.DataFrame | None:
    """Rows of the filter core in use, from the first of the messages that is logged.

    XKF4 and NKF4 name the core in use (PI); before the instance column each core had its own message, of which
    the first belongs to core 0.
    """
    for name in names:
        if name not in messages or not len(messages[name]):
            continue
        frame = messages[name]
        if "C" not in frame:
            return frame
        core: Array = numbers(frame, "C")
        cores = np.unique(core[np.isfinite(core)])
        if not len(cores):
            return frame
        state = "XKF4" if name.startswith("X") else "NKF4"
        primary = int(cores[0])
        if state in messages:
            used, rows = np.unique(numbers(messages[state], "PI"), return_counts=True)
            if len(used) and used[np.argmax(rows)] in cores:
                primary = int(used[np.argmax(rows)])
        part: pd.DataFrame = frame[core == primary]
        part.attrs = frame.attrs
        return part
    return None


def estimate(messages: Messages, parameters: Mapping[str, float]) -> pd.DataFrame | None:
    """Position, velocity and attitude of the filter that the autopilot flew on: XKF1, NKF1 or EKF1."""
    names = ("XKF1", "NKF1", "EKF1")
    if int(parameters.get("AHRS_EKF_TYPE", 3)) == 2:
        names = ("NKF1", "XKF1", "EKF1")
    core = _core(messages, names)
    if core is None:
        return None
    columns = {f"p_{axis.lower()}": quantity(core, f"P{axis}", "m") for axis in "NED"}
    columns |= {f"v_{axis.lower()}": quantity(core, f"V{axis}", "m/s") for axis in "NED"}
    columns |= {name.lower(): wrap(quantity(core, name, "deg")) for name in ("Roll", "Pitch", "Yaw")}
    table = series(core.index, columns)
    # Until the filter runs its states are logged as zeros.
    table[(table[["p_n", "p_e", "p_d", "v_n", "v_e", "v_d"]] == 0.0).all(axis=1)] = np.nan
    return table


def origin(messages: Messages, gps: pd.DataFrame | None, ekf: pd.DataFrame | None) -> Geodetic | None:
    """Origin of the autopilot's local frame.

    ORGN of type 0 where it is logged (since 3.5; before, type 0 was 1). Otherwise the place that brings the
    filter's positions onto the GPS fixes, or the first good fix where there is no filter.
    """
    if "ORGN" in messages and len(messages["ORGN"]):
        rows = messages["ORGN"]
        lat, lon, alt = quantity(rows, "Lat", "deg"), quantity(rows, "Lng", "deg"), quantity(rows, "Alt", "m")
        kind = numbers(rows, "Type") if "Type" in rows else np.zeros(len(rows))
        good = np.isfinite(lat) & np.isfinite(lon) & ~((lat == 0.0) & (lon == 0.0))
        for wanted in (0, 1):
            found = np.flatnonzero(good & (kind == wanted))
            if len(found):
                k = found[0]
                return Geodetic(lat=float(lat[k]), lon=float(lon[k]), alt=float(alt[k]))
    return origin_of_fixes(gps, ekf)


def origin_of_fixes(gps: pd.DataFrame | None, ekf: pd.DataFrame | None) -> Geodetic | None:
    """Place that brings the autopilot's positions onto the GPS fixes, or the first good fix without any."""
    if gps is None:
        return None
    good = gps[(gps["fix"] >= 3.0) & gps[["lat", "lon", "alt"]].notna().all(axis=1)]
    if not len(good):
        return None
    first = Geodetic(*(float(good[name].iloc[0]) for name in ("lat", "lon", "alt")))
    if ekf is None:
        return first
    # North and east of exactly zero are the filter's start values.
    position = ekf[["p_n", "p_e", "p_d"]]
    position = position[(position[["p_n", "p_e"]] != 0.0).any(axis=1)].dropna()
    if len(position) < 2:
        return first
    at = sample(position, good["t_valid"].to_numpy(), gap=0.5)
    use = np.isfinite(at).all(axis=1)
    if np.count_nonzero(use) < 5:
        return first
    north, east, down = pymap3d.geodetic2ned(
        good["lat"].to_numpy()[use],
        good["lon"].to_numpy()[use],
        good["alt"].to_numpy()[use],
        first.lat,
        first.lon,
        first.alt,
        deg=False,
    )
    offset = np.median(np.column_stack((north, east, down)) - at[use], axis=0)
    lat, lon, alt = pymap3d.ned2geodetic(*offset, first.lat, first.lon, first.alt, deg=False)
    return Geodetic(lat=float(lat), lon=float(lon), alt=float(alt))


#: Longest time [s] between samples of one message over which targets are interpolated.
_GAP = 0.3


def setpoints(messages: Messages, vehicle: Vehicle) -> pd.DataFrame | None:
    """Targets of position, velocity, attitude and throttle, on the times of the most frequent of their messages."""
    parts = [
        *_position_targets(messages),
        *(_attitude_targets(messages[name]) for name in ("ATT", "ANG") if name in messages),
        throttle_output(messages, vehicle),
    ]
    return join((part for part in parts if part is not None), COLUMNS["setpoints"], gap=_GAP)


def _position_targets(messages: Messages) -> list[pd.DataFrame]:
    """Targets of the position controller, one table for each message that holds some."""
    parts = []
    for axis in "NED":
        name = f"PSC{axis}"
        if name in messages:  # since 4.1
            frame = messages[name]
            low = axis.lower()
            columns = {f"p_{low}": quantity(frame, f"TP{axis}", "m"), f"v_{low}": quantity(frame, f"TV{axis}", "m/s")}
            if f"DV{axis}" in frame:
                columns[f"v_{low}_ref"] = quantity(frame, f"DV{axis}", "m/s")
            parts.append(series(frame.index, columns))
    if parts:
        return parts
    if "PSC" in messages:  # 4.0
        frame = messages["PSC"]
        columns = {f"p_{low}": quantity(frame, f"TP{axis}", "m") for low, axis in (("n", "X"), ("e", "Y"))}
        columns |= {f"v_{low}": quantity(frame, f"TV{axis}", "m/s") for low, axis in (("n", "X"), ("e", "Y"))}
        parts.append(series(frame.index, columns))
    elif "NTUN" in messages and "DPosX" in messages["NTUN"]:  # 3.1 to 3.6, in cm
        frame = messages["NTUN"]
        columns = {f"p_{low}": quantity(frame, f"DPos{axis}", "cm") for low, axis in (("n", "X"), ("e", "Y"))}
        columns |= {f"v_{low}": quantity(frame, f"DVel{axis}", "cm/s") for low, axis in (("n", "X"), ("e", "Y"))}
        parts.append(series(frame.index, columns))
    if "PSCZ" in messages:
        frame = messages["PSCZ"]
        columns = {"p_d": -quantity(frame, "TPZ", "m"), "v_d": -quantity(frame, "TVZ", "m/s")}
        parts.append(series(frame.index, columns))
    elif "CTUN" in messages and "DAlt" in messages["CTUN"]:
        frame = messages["CTUN"]
        columns = {"p_d": -quantity(frame, "DAlt", "m"), "v_d": -quantity(frame, "DCRt", "cm/s")}
        parts.append(series(frame.index, columns))
    return parts


def _attitude_targets(frame: pd.DataFrame) -> pd.DataFrame | None:
    """Attitude targets of ATT and ANG; until 3.0 they are called RollIn, PitchIn and NavYaw."""
    if "DesRoll" in frame:
        return _angles(frame, "Des")
    if "RollIn" in frame:
        columns = {"roll": "RollIn", "pitch": "PitchIn", "yaw": "NavYaw"}
        return series(frame.index, {name: wrap(quantity(frame, source, "deg")) for name, source in columns.items()})
    return None


#: Firmware whose throttle output is logged in percent.
_PERCENT = ("ArduPlane", "ArduRover")


def throttle_output(messages: Messages, vehicle: Vehicle) -> pd.DataFrame | None:
    """Throttle output 0..1: CTUN.ThO, or ThrOut in thousandths before 3.4; in percent where it is no copter.

    It is below 0 where a rover brakes or goes backwards.
    """
    if "CTUN" not in messages:
        return None
    frame = messages["CTUN"]
    column = next((name for name in ("ThO", "ThrOut") if name in frame), None)
    if column is None:
        return None
    values = quantity(frame, column, "")
    finite = values[np.isfinite(values)]
    if vehicle.firmware in _PERCENT:
        values = values / 100.0
    elif len(finite) and np.max(np.abs(finite)) > 2.0:
        values = values / 1000.0
    return series(frame.index, {"throttle": values})


#: Axis of the craft, letter of RATE and PID messages, name of the mixer input.
_AXES = (("x", "R", "roll"), ("y", "P", "pitch"), ("z", "Y", "yaw"))


#: Columns of the table of rates: field of RATE and its unit.
_RATE_FIELDS = (
    {f"w_{axis}_ref": (f"{letter}Des", "deg/s") for axis, letter, _ in _AXES}
    | {f"w_{axis}": (letter, "deg/s") for axis, letter, _ in _AXES}
    | {f"out_{name}": (f"{letter}Out", "") for _, letter, name in _AXES}
    | {"out_thrust": ("AOut", ""), "a_up": ("A", "cm/s/s"), "a_up_ref": ("ADes", "cm/s/s")}
)


def rates(messages: Messages) -> pd.DataFrame | None:
    """Rate controller: targets, rates and outputs of RATE, or of PIDR, PIDP and PIDY where RATE is not logged."""
    if "RATE" not in messages:
        return _rates_from_pid(messages)
    frame = some_fields(messages, "RATE", {field for field, _ in _RATE_FIELDS.values()})
    return series(frame.index, ((name, quantity(frame, *source)) for name, source in _RATE_FIELDS.items()))


def rate_columns(messages: Messages, wanted: Collection[str]) -> Iterator["pd.Series[float]"]:
    """Columns of the table that `rates` makes of RATE, one by one, in the order wanted."""
    frame = some_fields(messages, "RATE", {_RATE_FIELDS[name][0] for name in wanted})
    return columns_of(frame.index, ((name, quantity(frame, *_RATE_FIELDS[name])) for name in wanted))


def _rates_from_pid(messages: Messages) -> pd.DataFrame | None:
    """Put together the rate controller from its three PID messages (since 4.0, in rad/s)."""
    parts = []
    for axis, letter, name in _AXES:
        frame = messages.get(f"PID{letter}")
        if frame is None or not {"Tar", "Act", "P", "I", "D", "FF"} <= set(frame.columns):
            continue
        output = sum((quantity(frame, term, "") for term in ("P", "I", "D", "FF")), np.zeros(len(frame)))
        columns = {f"w_{axis}_ref": numbers(frame, "Tar"), f"w_{axis}": numbers(frame, "Act"), f"out_{name}": output}
        parts.append(series(frame.index, columns))
    return join(parts, COLUMNS["rates"], gap=_GAP)


def systemid(messages: Messages) -> pd.DataFrame | None:
    """Chirps of SYSTEMID mode: SIDD, with the axis and the length that the last SIDS before them announces."""
    if "SIDD" not in messages or not len(messages["SIDD"]):
        return None
    frame = messages["SIDD"]
    columns = {"axis": np.full(len(frame), np.nan), "target": quantity(frame, "Targ", "")}
    columns |= {"elapsed": quantity(frame, "Time", "s"), "planned": np.full(len(frame), np.nan)}
    columns |= {"frequency": 2.0 * np.pi * numbers(frame, "F")}
    columns |= {f"w_{axis}": quantity(frame, f"G{axis}", "deg/s") for axis in "xyz"}
    columns |= {f"f_{axis}": quantity(frame, f"A{axis}", "m/s/s") for axis in "xyz"}
    table = series(frame.index, columns)
    if "SIDS" in messages and len(messages["SIDS"]):
        said = {name: numbers(messages["SIDS"], field) for name, field in (("axis", "Ax"), ("planned", "TR"))}
        announced = pd.DataFrame(series(messages["SIDS"].index, said)).reindex(table.index, method="ffill")
        table[list(said)] = announced
    return table


def truth(messages: Messages) -> pd.DataFrame | None:
    """Truth of ArduPilot's simulator: position and velocity of SIM2 with the attitude of SIM."""
    if "SIM2" not in messages or not len(messages["SIM2"]):
        return None
    frame = messages["SIM2"]
    columns = {f"p_{axis.lower()}": quantity(frame, f"P{axis}", "m") for axis in "NED"}
    columns |= {f"v_{axis.lower()}": quantity(frame, f"V{axis}", "m/s") for axis in "NED"}
    result = series(frame.index, columns)
    names = ["q_w", "q_x", "q_y", "q_z"]
    result[names] = np.nan
    simulated = next((part for _, part in instances(messages, "SIM")), None)
    if simulated is None or len(simulated) < 2:
        return result
    if "Q1" in simulated:
        q = np.column_stack([quantity(simulated, f"Q{k}", "") for k in range(1, 5)])
    else:
        q = quaternions(*(quantity(simulated, name, "deg") for name in ("Roll", "Pitch", "Yaw")))
    turned = pd.DataFrame(series(simulated.index, dict(zip(names, q.T, strict=True)))).dropna()
    if len(turned) < 2:
        return result
    values = turned.to_numpy(copy=True)
    # Neighbouring quaternions on the same side of the sphere, so that interpolation takes the short way.
    flips = np.cumsum(np.append(False, np.sum(values[1:] * values[:-1], axis=1) < 0.0)) % 2
    values[flips == 1] *= -1.0
    when = result.index.to_numpy()
    at = cubic_spline(turned.index.to_numpy(), values, when)
    at[np.isnan(sample(turned, when, gap=0.2))] = np.nan
    with np.errstate(invalid="ignore", divide="ignore"):  # a damaged quaternion of zeros has no direction: NaN
        result[names] = at / np.linalg.norm(at, axis=1, keepdims=True)
    return result
