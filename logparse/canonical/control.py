"""What the autopilot estimated and wanted: attitude, own position, targets, rates, chirps; and a simulator's truth."""

from collections.abc import Collection, Iterator, Mapping

import numpy as np
import pandas as pd
import pymap3d

from core.attitude import continuous, quat_from_euler
from core.cubic_spline import cubic_spline
from core.units import numbers, quantity
from logparse.canonical.fields import (
    Fields,
    Kind,
    Messages,
    axes,
    first,
    has,
    instances,
    names_of,
    quaternion_angles,
    rows_of,
    table,
    value,
    values,
)
from logparse.canonical.series import (
    ANGLES,
    Array,
    columns_of,
    join,
    joined_columns,
    sample,
    series,
    with_attitude,
)
from logparse.craft.frames import Vehicle
from logparse.tables import COLUMNS, Geodetic

_DEGREES = {"roll": "Roll deg", "pitch": "Pitch deg", "yaw": "Yaw deg"}
_NED = {"n": "ned", "N": "NED"}

#: Longest time [s] between samples of one message over which targets are interpolated, by kind of log.
_GAP = {Kind.DATAFLASH: 0.3, Kind.TELEMETRY: 1.5, Kind.PX4: 0.3}


def attitude(messages: Messages, kind: Kind) -> pd.DataFrame | None:
    """Roll, pitch and yaw as the autopilot logs them, or its filter where it does not."""
    if kind is Kind.PX4:
        frame = first(messages, "vehicle_attitude")
        return None if frame is None else series(frame.index, quaternion_angles(frame, "q[{}]", range(4)))
    if kind is Kind.TELEMETRY:
        if (frame := first(messages, "ATTITUDE")) is not None:
            return table(frame, {name: f"{name} rad" for name in ANGLES})
        frame = first(messages, "ATTITUDE_QUATERNION")
        return None if frame is None else series(frame.index, quaternion_angles(frame, "q{}", range(1, 5)))
    logged = (messages.part(name, names_of(_DEGREES), of_all=True) for name in ("ATT", "ANG") if name in messages)
    candidates = [frame for frame in logged if len(frame) > 1]
    if candidates:
        # ANG comes at the rate of the attitude loop where fast attitude logging is on.
        return table(max(candidates, key=len), _DEGREES)
    core = _core(messages, ("XKQ", "NKQ", "XKQ1", "NKQ1"))
    if core is not None and {"Q1", "Q2", "Q3", "Q4"} <= set(core.columns):
        return series(core.index, quaternion_angles(core, "Q{}", range(1, 5)))
    cores = (_core(messages, names) for names in (("XKF1", "NKF1", "EKF1"), ("AHR2",)))
    return next((table(core, _DEGREES) for core in cores if core is not None), None)


def _core(messages: Messages, names: tuple[str, ...]) -> pd.DataFrame | None:
    """Rows of the filter core in use, from the first of the messages that is logged.

    XKF4 and NKF4 name the core in use (PI); before the instance column each core had its own message, of which
    the first belongs to core 0.
    """
    name = next((name for name in names if name in messages and len(messages[name])), None)
    if name is None or "C" not in messages[name]:
        return None if name is None else messages[name]
    frame = messages[name]
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
    return rows_of(frame, core == primary)


#: Position and velocity of PX4's estimate, with the flag that says whether they are valid.
_PX4_VALID = {
    "xy_valid": {"p_n": "x m", "p_e": "y m"},
    "z_valid": {"p_d": "z m"},
    "v_xy_valid": {"v_n": "vx m/s", "v_e": "vy m/s"},
    "v_z_valid": {"v_d": "vz m/s"},
}


def estimate(
    messages: Messages,
    kind: Kind,
    parameters: Mapping[str, float],
    angles: pd.DataFrame | None,
    place: Geodetic | None,
) -> pd.DataFrame | None:
    """Position, velocity and attitude of the filter that the autopilot flew on."""
    if kind is Kind.PX4:
        if (frame := first(messages, "vehicle_local_position")) is None:
            return None
        columns: dict[str, Array] = {}
        for flag, fields in _PX4_VALID.items():
            invalid = numbers(frame, flag) == 0.0
            columns |= {name: np.where(invalid, np.nan, each) for name, each in values(frame, fields).items()}
        return with_attitude(series(frame.index, columns), angles, gap=0.2)
    if kind is Kind.TELEMETRY:
        if (frame := first(messages, "LOCAL_POSITION_NED")) is not None:
            columns = values(frame, axes({"p_{n}": "{x} m", "v_{n}": "v{x} m/s"}, n="ned", x="xyz"))
        elif (frame := first(messages, "GLOBAL_POSITION_INT")) is not None and place is not None:
            columns = _local(frame, {"lat": "lat degE7", "lon": "lon degE7", "alt": "alt mm"}, place)
            columns |= values(frame, axes({"v_{n}": "v{x} cm/s"}, n="ned", x="xyz"))
        else:
            return None
        return with_attitude(series(frame.index, columns), angles, gap=1.0)
    names = ("XKF1", "NKF1", "EKF1")
    core = _core(messages, ("NKF1", *names) if int(parameters.get("AHRS_EKF_TYPE", 3)) == 2 else names)
    if core is None:
        return None
    own = table(core, axes({"p_{n}": "P{N} m"}, **_NED) | axes({"v_{n}": "V{N} m/s"}, **_NED) | _DEGREES)
    # Until the filter runs its states are logged as zeros, of which damage changes one.
    own[(own.drop(columns=list(ANGLES)).abs() > 0.0).sum(axis=1) < 2] = np.nan
    return own


def _local(frame: pd.DataFrame, fields: Fields, place: Geodetic) -> dict[str, Array]:
    """North, east and down of places that a message holds; NaN where latitude and longitude are zero."""
    read = values(frame, fields)
    known = (read["lat"] != 0.0) | (read["lon"] != 0.0)
    lat, lon = np.where(known, read["lat"], np.nan), np.where(known, read["lon"], np.nan)
    found = pymap3d.geodetic2ned(lat, lon, read["alt"], place.lat, place.lon, place.alt, deg=False)
    return {f"p_{axis}": np.asarray(each) for axis, each in zip("ned", found, strict=True)}


#: Where the origin of the local frame is logged. Since 3.5 ORGN's type 0 is that of the filter; before it was 1.
_ORIGINS: Mapping[Kind, Mapping[str, Fields]] = {
    Kind.DATAFLASH: {"ORGN": {"lat": "Lat deg", "lon": "Lng deg", "alt": "Alt m"}},
    Kind.TELEMETRY: {
        name: {"lat": "latitude degE7", "lon": "longitude degE7", "alt": "altitude mm"}
        for name in ("GPS_GLOBAL_ORIGIN", "HOME_POSITION")
    },
    Kind.PX4: {"vehicle_local_position": {"lat": "ref_lat deg", "lon": "ref_lon deg", "alt": "ref_alt m"}},
}


def logged_origin(messages: Messages, kind: Kind) -> Geodetic | None:
    """Origin of the autopilot's local frame as it is logged."""
    for name, fields in _ORIGINS[kind].items():
        if name not in messages or (name == "HOME_POSITION" and first(messages, "LOCAL_POSITION_NED") is not None):
            continue  # home is not the origin of LOCAL_POSITION_NED
        frame = messages[name]
        places = np.column_stack([*values(frame, fields).values()])
        good = np.isfinite(places).all(axis=1) & (places[:, :2] != 0.0).any(axis=1)
        types = numbers(frame, "Type") if "Type" in frame else np.zeros(len(frame))
        for wanted in (0, 1):
            found = np.flatnonzero(good & (types == wanted))
            if len(found):
                return Geodetic(*map(float, places[found[0]]))
    return None


def origin_of_fixes(gps: pd.DataFrame | None, ekf: pd.DataFrame | None) -> Geodetic | None:
    """Place that brings the autopilot's positions onto the GPS fixes, or the first good fix without any."""
    if gps is None:
        return None
    good = gps[(gps["fix"] >= 3.0) & gps[["lat", "lon", "alt"]].notna().all(axis=1)]
    if not len(good):
        return None
    start = Geodetic(*(float(good[name].iloc[0]) for name in ("lat", "lon", "alt")))
    if ekf is None:
        return start
    # North and east of exactly zero are the filter's start values.
    position = ekf[["p_n", "p_e", "p_d"]]
    position = position[(position[["p_n", "p_e"]] != 0.0).any(axis=1)].dropna()
    if len(position) < 2:
        return start
    at = sample(position, good["t_valid"].to_numpy(), gap=0.5)
    use = np.isfinite(at).all(axis=1)
    if np.count_nonzero(use) < 5:
        return start
    fixes = (good[name].to_numpy()[use] for name in ("lat", "lon", "alt"))
    ned = pymap3d.geodetic2ned(*fixes, start.lat, start.lon, start.alt, deg=False)
    offset = np.median(np.column_stack(ned) - at[use], axis=0)
    return Geodetic(*map(float, pymap3d.ned2geodetic(*offset, start.lat, start.lon, start.alt, deg=False)))


#: Targets of the position controller: message and fields, of which one that is missing is not read. Of DataFlash the
#: first that is logged of each row counts (since 4.1, 4.0, 3.1 to 3.6 in cm).
_HORIZONTAL, _VERTICAL = (
    {
        "PSC": axes({"p_{n}": "TP{X} m", "v_{n}": "TV{X} m/s"}, n="ne", X="XY"),
        "NTUN": axes({"p_{n}": "DPos{X} cm", "v_{n}": "DVel{X} cm/s"}, n="ne", X="XY"),
    },
    {
        "PSCZ": {"p_d": "-TPZ m", "v_d": "-TVZ m/s"},
        "CTUN": {"p_d": "-DAlt m", "v_d": "-DCRt cm/s"},
    },
)
_SINCE_4_1 = {
    f"PSC{N}": axes({"p_{n}": "TP{N} m", "v_{n}": "TV{N} m/s", "v_{n}_ref": "DV{N} m/s"}, n=N.lower(), N=N)
    for N in "NED"
}
_PX4_TARGETS = {
    "vehicle_local_position_setpoint": axes(
        {"p_{n}": "{x} m | position[{k}] m", "v_{n}": "v{x} m/s | velocity[{k}] m/s"}, n="ned", x="xyz", k="012"
    ),
    "trajectory_setpoint": axes({"v_{n}_ref": "v{x} m/s | velocity[{k}] m/s"}, n="ned", x="xyz", k="012"),
}
#: Attitude targets by age: until 3.0 they are called RollIn, PitchIn and NavYaw.
_ASKED = {"roll": "DesRoll deg | RollIn deg", "pitch": "DesPitch deg | PitchIn deg", "yaw": "DesYaw deg | NavYaw deg"}


def setpoints(
    messages: Messages, kind: Kind, place: Geodetic | None, angles: pd.DataFrame | None
) -> pd.DataFrame | None:
    """Targets of telemetry and PX4: position, velocity, attitude, throttle, on the times of their fastest message."""
    parts = _px4_targets(messages) if kind is Kind.PX4 else _telemetry_targets(messages, place, angles)
    return join(parts, COLUMNS["setpoints"], gap=_GAP[kind])


def setpoint_columns(messages: Messages, vehicle: Vehicle, wanted: Collection[str]) -> Iterator["pd.Series[float]"]:
    """Columns of the table of targets of DataFlash, one by one, in the order wanted."""
    return joined_columns(_dataflash_targets(messages, vehicle, wanted), wanted, gap=_GAP[Kind.DATAFLASH])


def _dataflash_targets(messages: Messages, vehicle: Vehicle, wanted: Collection[str]) -> Iterator[pd.DataFrame]:
    """Yield what each message says of the wanted targets, and its times where it says nothing of them."""
    rows = [{name: fields} for name, fields in _SINCE_4_1.items()]
    if not any(name in messages for name in _SINCE_4_1):
        rows = [_HORIZONTAL, _VERTICAL]
    for row in rows:
        for name, fields in row.items():
            if name in messages and has(messages[name], next(iter(fields.values()))):
                frame = messages[name]
                yield table(frame, {c: field for c, field in fields.items() if c in wanted and has(frame, field)})
                break
    for name in ("ATT", "ANG"):
        if name in messages and has(frame := messages.part(name, names_of(_ASKED), of_all=True), _ASKED["roll"]):
            yield table(frame, {column: field for column, field in _ASKED.items() if column in wanted})
    if (throttle := throttle_output(messages, vehicle)) is not None:
        yield throttle


#: Firmware whose throttle output is logged in percent.
_PERCENT = ("ArduPlane", "ArduRover")


def throttle_output(messages: Messages, vehicle: Vehicle) -> pd.DataFrame | None:
    """Throttle output 0..1: CTUN.ThO, or ThrOut in thousandths before 3.4; in percent where it is no copter.

    It is below 0 where a rover brakes or goes backwards.
    """
    frame = messages.get("CTUN")
    if frame is None or not has(frame, "ThO | ThrOut"):
        return None
    output = value(frame, "ThO | ThrOut")
    if vehicle.firmware in _PERCENT and vehicle.other_craft:
        output = output / 100.0
    elif np.max(np.abs(output), initial=0.0, where=np.isfinite(output)) > 2.0:
        output = output / 1000.0
    return series(frame.index, {"throttle": output})


def _px4_targets(messages: Messages) -> Iterator[pd.DataFrame]:
    local, asked = _PX4_TARGETS.values()
    if (frame := first(messages, *_PX4_TARGETS)) is not None:
        yield table(frame, local)
    if (frame := first(messages, "trajectory_setpoint")) is not None:
        yield table(frame, asked)
    if (frame := first(messages, "vehicle_attitude_setpoint")) is not None:
        throttle = value(frame, "-thrust_body[2]")
        throttle = throttle if np.isfinite(throttle).any() else value(frame, "thrust")
        yield series(frame.index, quaternion_angles(frame, "q_d[{}]", range(4)) | {"throttle": throttle})


#: Time [s] for which a target of roll and pitch stands to the last bit, and the mean angle [rad] between it and the
#: attitude, from which on it is not the one that was flown.
_IDLE_SECONDS, _IDLE_OFF = 10.0, np.radians(5.0)


def _telemetry_targets(
    messages: Messages, place: Geodetic | None, angles: pd.DataFrame | None
) -> Iterator[pd.DataFrame]:
    if (frame := first(messages, "NAV_CONTROLLER_OUTPUT")) is not None:
        yield _without_idle(table(frame, {name: f"nav_{name} deg" for name in ("roll", "pitch")}), angles)
    if (frame := first(messages, "ATTITUDE_TARGET")) is not None:
        yield series(frame.index, quaternion_angles(frame, "q[{}]", range(4)))
    if (frame := first(messages, "POSITION_TARGET_LOCAL_NED")) is not None:
        yield _targets(frame, values(frame, axes({"p_{n}": "{x} m"}, n="ned", x="xyz")))
    elif (frame := first(messages, "POSITION_TARGET_GLOBAL_INT")) is not None and place is not None:
        columns = _local(frame, {"lat": "lat_int degE7", "lon": "lon_int degE7", "alt": "alt m"}, place)
        # MAV_FRAME_GLOBAL (0) and _INT (5) have altitudes above sea level; the others are relative to home or terrain.
        columns["p_d"][~np.isin(numbers(frame, "coordinate_frame"), (0, 5))] = np.nan
        yield _targets(frame, columns)
    if (frame := first(messages, "VFR_HUD")) is not None:
        yield series(frame.index, {"throttle": numbers(frame, "throttle") / 100.0})


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
    for start, stop in zip(starts, [*starts[1:], len(t)], strict=True):
        off = np.abs(np.mean(flown[start:stop] - asked[start:stop], axis=0))
        idle[start:stop] = t[stop - 1] - t[start] > _IDLE_SECONDS and float(off.max()) > _IDLE_OFF
    return targets[~idle]


def _targets(frame: pd.DataFrame, position: Mapping[str, Array]) -> pd.DataFrame:
    """Position and velocity targets of a POSITION_TARGET message, without those that its type_mask ignores."""
    mask = frame["type_mask"].to_numpy(dtype=np.int64)
    columns = {**position, **values(frame, axes({"v_{n}": "v{x} m/s"}, n="ned", x="xyz"))}
    columns = {name: np.where(mask & (1 << k), np.nan, each) for k, (name, each) in enumerate(columns.items())}
    # The message carries what is asked of the controller, nothing of its correction.
    return series(frame.index, columns | {f"v_{axis}_ref": columns[f"v_{axis}"] for axis in "ned"})


#: Axis of the craft, letter of RATE and PID messages, name of the mixer input.
_AXES = (("x", "R", "roll"), ("y", "P", "pitch"), ("z", "Y", "yaw"))
_OUTPUTS = tuple(f"out_{name}" for _, _, name in _AXES)

#: The table of rates as DataFlash's RATE has it.
_RATE = axes({"w_{x}_ref": "{R}Des deg/s"}, x="xyz", R="RPY") | axes({"w_{x}": "{R} deg/s"}, x="xyz", R="RPY")
_RATE |= {f"out_{name}": f"{letter}Out" for _, letter, name in _AXES} | {"out_thrust": "AOut"}
_RATE |= {"a_up": "A cm/s/s", "a_up_ref": "ADes cm/s/s"}

#: Messages with body rates of the others, and their fields. Telemetry has neither targets nor the mixer's inputs.
_BODY_RATES: Mapping[Kind, Mapping[str, Fields]] = {
    Kind.TELEMETRY: {"ATTITUDE": axes({"w_{x}": "{roll}speed rad/s"}, x="xyz", roll=("roll", "pitch", "yaw"))},
    Kind.PX4: {
        "vehicle_angular_velocity": axes({"w_{x}": "xyz[{k}] rad/s"}, x="xyz", k="012"),
        "vehicle_attitude": axes({"w_{x}": "{roll}speed rad/s"}, x="xyz", roll=("roll", "pitch", "yaw")),
    },
}
#: What PX4's rate controller was asked for and what it asked for: fields, and the longest gap [s] in them.
_PX4_CONTROL: Mapping[str, tuple[Fields, float]] = {
    "vehicle_rates_setpoint": (axes({"w_{x}_ref": "{roll} rad/s"}, x="xyz", roll=("roll", "pitch", "yaw")), 0.1),
    "actuator_controls_0": ({name: f"control[{k}]" for k, name in enumerate((*_OUTPUTS, "out_thrust"))}, 0.2),
    "vehicle_torque_setpoint": ({name: f"xyz[{k}]" for k, name in enumerate(_OUTPUTS)}, 0.1),
    "vehicle_thrust_setpoint": ({"out_thrust": "-xyz[2]"}, 0.1),
}


def rates(messages: Messages, kind: Kind) -> pd.DataFrame | None:
    """Rate controller: targets, rates and outputs; of DataFlash without RATE those of PIDR, PIDP and PIDY."""
    if kind is Kind.DATAFLASH:
        return _rates_from_pid(messages)
    for name, fields in _BODY_RATES[kind].items():
        logged = first(messages, name)
        if logged is not None and has(logged, fields["w_x"]):
            made = table(logged, fields).reindex(columns=list(COLUMNS["rates"]))
            for other, (columns, gap) in _PX4_CONTROL.items() if kind is Kind.PX4 else ():
                if (part := first(messages, other)) is not None:
                    made[list(columns)] = sample(table(part, columns), made.index.to_numpy(), gap=gap)
            return made
    return None


def rate_columns(messages: Messages, wanted: Collection[str]) -> Iterator["pd.Series[float]"]:
    """Columns of the table of rates that DataFlash has in RATE, one by one, in the order wanted.

    Each is decoded by itself: all fields at once are half as large as a log with a fast loop.
    """
    index: pd.Index[float] | None = None
    for name in wanted:
        frame = messages.part("RATE", names_of({name: _RATE[name]}), of_all=True)
        index = frame.index if index is None else index
        yield from columns_of(index, [(name, value(frame, _RATE[name]))])


def rate_times(messages: Messages) -> Array | None:
    """Return the times of the rows of RATE [s], read without its values."""
    t: Array = series(messages.part("RATE", ()).index, ()).index.to_numpy(np.float64)
    return t if len(t) else None


def _rates_from_pid(messages: Messages) -> pd.DataFrame | None:
    """Assemble the rate controller from its three PID messages (since 4.0, in rad/s)."""
    parts = []
    for axis, letter, name in _AXES:
        frame = messages.get(f"PID{letter}")
        if frame is None or not {"Tar", "Act", "P", "I", "D", "FF"} <= set(frame.columns):
            continue
        output = sum((quantity(frame, term, "") for term in ("P", "I", "D", "FF")), np.zeros(len(frame)))
        columns = {f"w_{axis}_ref": numbers(frame, "Tar"), f"w_{axis}": numbers(frame, "Act"), f"out_{name}": output}
        parts.append(series(frame.index, columns))
    return join(parts, COLUMNS["rates"], gap=_GAP[Kind.DATAFLASH])


#: Chirps of SYSTEMID mode, of which SIDS announces the axis and the length.
_CHIRP = {"axis": "", "target": "Targ", "elapsed": "Time s", "planned": "", "frequency": "F"}
_CHIRP |= axes({"w_{x}": "G{x} deg/s"}, x="xyz") | axes({"f_{x}": "A{x} m/s/s"}, x="xyz")
#: Pause [s] in a signal of PX4's autotuning that ends it.
_SILENT = 1.0


def chirp_columns(messages: Messages, wanted: Collection[str]) -> Iterator["pd.Series[float]"]:
    """Columns of the chirps of SYSTEMID mode, one by one, in the order wanted."""
    if (frame := first(messages, "SIDD")) is None:
        return
    announced, said = first(messages, "SIDS"), {"axis": "Ax", "planned": "TR"}
    for column in columns_of(frame.index, ((name, value(frame, _CHIRP[name])) for name in wanted)):
        name = str(column.name)
        if name in said and announced is not None:
            column = table(announced, {name: said[name]})[name].reindex(column.index, method="ffill")
        yield 2.0 * np.pi * column if name == "frequency" else column


def autotune(messages: Messages) -> pd.DataFrame | None:
    """Signals that PX4's autotuning adds to the rate targets, where it does; it logs no frequency."""
    frame = first(messages, "autotune_attitude_control_status")
    if frame is None:
        return None
    t = frame.index.to_numpy(np.float64)
    added = np.column_stack([value(frame, f"rate_sp[{k}]") for k in range(3)])
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
    starts = np.concatenate([[True], (np.diff(axis[rows]) != 0) | (np.diff(t[rows]) > _SILENT)])
    began = t[rows][np.maximum.accumulate(np.where(starts, np.arange(len(rows)), 0))]
    # As SID_AXIS numbers signals that are added to rate targets.
    columns = {"axis": 7.0 + axis[rows], "target": np.degrees(added[rows, axis[rows]]), "elapsed": t[rows] - began}
    return series(t[rows], columns).reindex(columns=list(COLUMNS["systemid"]))


def truth(messages: Messages) -> pd.DataFrame | None:
    """Truth of ArduPilot's simulator: position and velocity of SIM2 with the attitude of SIM."""
    if (frame := first(messages, "SIM2")) is None:
        return None
    result = table(frame, axes({"p_{n}": "P{N} m"}, **_NED) | axes({"v_{n}": "V{N} m/s"}, **_NED))
    names = ["q_w", "q_x", "q_y", "q_z"]
    result[names] = np.nan
    _, simulated = next(instances(messages, "SIM"), ("", None))
    if simulated is None or len(simulated) < 2:
        return result
    if "Q1" in simulated:
        q = np.column_stack([value(simulated, f"Q{k}") for k in range(1, 5)])
    else:
        q = quat_from_euler(*values(simulated, _DEGREES).values())
    turned = series(simulated.index, dict(zip(names, q.T, strict=True))).dropna()
    if len(turned) < 2:
        return result
    when = result.index.to_numpy()
    at = cubic_spline(turned.index.to_numpy(), continuous(turned.to_numpy()), when)
    at[np.isnan(sample(turned, when, gap=0.2))] = np.nan
    with np.errstate(invalid="ignore", divide="ignore"):  # a damaged quaternion of zeros has no direction: NaN
        result[names] = at / np.linalg.norm(at, axis=1, keepdims=True)
    return result
