"""Modes and events: one row for each change."""

from collections.abc import Iterable, Iterator, Mapping
from types import MappingProxyType

import numpy as np
import pandas as pd

from core.units import numbers
from logparse.canonical.fields import Kind, Messages, first
from logparse.canonical.series import distinct

#: Flight modes of ArduCopter (MODE.ModeNum, HEARTBEAT.custom_mode).
COPTER_MODES: Mapping[int, str] = MappingProxyType(
    {
        0: "STABILIZE",
        1: "ACRO",
        2: "ALT_HOLD",
        3: "AUTO",
        4: "GUIDED",
        5: "LOITER",
        6: "RTL",
        7: "CIRCLE",
        8: "POSITION",
        9: "LAND",
        10: "OF_LOITER",
        11: "DRIFT",
        13: "SPORT",
        14: "FLIP",
        15: "AUTOTUNE",
        16: "POSHOLD",
        17: "BRAKE",
        18: "THROW",
        19: "AVOID_ADSB",
        20: "GUIDED_NOGPS",
        21: "SMART_RTL",
        22: "FLOWHOLD",
        23: "FOLLOW",
        24: "ZIGZAG",
        25: "SYSTEMID",
        26: "AUTOROTATE",
        27: "AUTO_RTL",
        28: "TURTLE",
    }
)

#: Flight modes of ArduPlane, whose numbers are not those of ArduCopter.
PLANE_MODES: Mapping[int, str] = MappingProxyType(
    {
        0: "MANUAL",
        1: "CIRCLE",
        2: "STABILIZE",
        3: "TRAINING",
        4: "ACRO",
        5: "FBWA",
        6: "FBWB",
        7: "CRUISE",
        8: "AUTOTUNE",
        10: "AUTO",
        11: "RTL",
        12: "LOITER",
        13: "TAKEOFF",
        14: "AVOID_ADSB",
        15: "GUIDED",
        16: "INITIALISING",
        17: "QSTABILIZE",
        18: "QHOVER",
        19: "QLOITER",
        20: "QLAND",
        21: "QRTL",
        22: "QAUTOTUNE",
        23: "QACRO",
        24: "THERMAL",
        25: "LOITER_ALT_QLAND",
        26: "AUTOLAND",
    }
)

#: nav_state of PX4's vehicle_status.
PX4_MODES: Mapping[int, str] = MappingProxyType(
    {
        0: "MANUAL",
        1: "ALTITUDE",
        2: "POSITION",
        3: "MISSION",
        4: "HOLD",
        5: "RTL",
        6: "POSITION_SLOW",
        10: "ACRO",
        12: "DESCEND",
        13: "TERMINATION",
        14: "OFFBOARD",
        15: "STABILIZED",
        17: "TAKEOFF",
        18: "LAND",
        19: "FOLLOW",
        20: "PRECISION_LAND",
        21: "ORBIT",
        22: "VTOL_TAKEOFF",
    }
)

#: Main mode and sub mode in the custom_mode of PX4's HEARTBEAT.
PX4_CUSTOM_MODES: Mapping[tuple[int, int], str] = MappingProxyType(
    {
        (1, 0): "MANUAL",
        (2, 0): "ALTITUDE",
        (3, 0): "POSITION",
        (4, 2): "TAKEOFF",
        (4, 3): "HOLD",
        (4, 4): "MISSION",
        (4, 5): "RTL",
        (4, 6): "LAND",
        (4, 8): "FOLLOW",
        (5, 0): "ACRO",
        (6, 0): "OFFBOARD",
        (7, 0): "STABILIZED",
    }
)

#: Events of ArduCopter (EV.Id) that matter to a reader of a flight.
COPTER_EVENTS: Mapping[int, str] = MappingProxyType(
    {
        10: "ARMED",
        11: "DISARMED",
        15: "AUTO_ARMED",
        16: "TAKEOFF",
        17: "LAND_COMPLETE_MAYBE",
        18: "LAND_COMPLETE",
        19: "LOST_GPS",
        21: "FLIP_START",
        22: "FLIP_END",
        25: "SET_HOME",
        26: "SIMPLE_ON",
        27: "SIMPLE_OFF",
        28: "NOT_LANDED",
        29: "SUPERSIMPLE_ON",
        30: "AUTOTUNE_INITIALISED",
        31: "AUTOTUNE_OFF",
        37: "AUTOTUNE_SUCCESS",
        38: "AUTOTUNE_FAILED",
        41: "SAVE_TRIM",
        43: "FENCE_ENABLE",
        44: "FENCE_DISABLE",
        49: "PARACHUTE_DISABLED",
        50: "PARACHUTE_ENABLED",
        51: "PARACHUTE_RELEASED",
        54: "MOTORS_EMERGENCY_STOPPED",
        55: "MOTORS_EMERGENCY_STOP_CLEARED",
        56: "MOTORS_INTERLOCK_DISABLED",
        57: "MOTORS_INTERLOCK_ENABLED",
        60: "EKF_ALT_RESET",
        61: "LAND_CANCELLED_BY_PILOT",
        62: "EKF_YAW_RESET",
        67: "GPS_PRIMARY_CHANGED",
    }
)

#: Subsystems of ArduCopter's ERR.
COPTER_SUBSYSTEMS: Mapping[int, str] = MappingProxyType(
    {
        1: "MAIN",
        2: "RADIO",
        3: "COMPASS",
        4: "OPTFLOW",
        5: "FAILSAFE_RADIO",
        6: "FAILSAFE_BATTERY",
        7: "FAILSAFE_GPS",
        8: "FAILSAFE_GCS",
        9: "FAILSAFE_FENCE",
        10: "FLIGHT_MODE",
        11: "GPS",
        12: "CRASH_CHECK",
        13: "FLIP",
        14: "AUTOTUNE",
        15: "PARACHUTES",
        16: "EKF_CHECK",
        17: "FAILSAFE_EKF_INAV",
        18: "BARO",
        19: "CPU",
        20: "FAILSAFE_ADSB",
        21: "TERRAIN",
        22: "NAVIGATION",
        23: "FAILSAFE_TERRAIN",
        24: "EKF_PRIMARY",
        25: "THRUST_LOSS_CHECK",
        26: "FAILSAFE_SENSORS",
        27: "FAILSAFE_LEAK",
        28: "PILOT_INPUT",
        29: "FAILSAFE_VIBE",
        30: "INTERNAL_ERROR",
        31: "FAILSAFE_DEADRECKON",
    }
)


def ardupilot_mode(number: int, firmware: str | None) -> str:
    """Name of a mode of ArduPlane, or else of ArduCopter; its number where it has none here."""
    return (PLANE_MODES if firmware == "ArduPlane" else COPTER_MODES).get(number, f"MODE_{number}")


def px4_custom_mode(custom_mode: int) -> str:
    """Name of the mode in PX4's HEARTBEAT.custom_mode."""
    main, sub = custom_mode >> 16 & 255, custom_mode >> 24 & 255
    return PX4_CUSTOM_MODES.get((main, sub), PX4_CUSTOM_MODES.get((main, 0), f"MODE_{main}.{sub}"))


#: Times of events, their names and details.
Part = tuple[np.ndarray, Iterable[str], Iterable[str]]

#: MAV_MODE_FLAG_SAFETY_ARMED in HEARTBEAT.base_mode, and MAV_AUTOPILOT_PX4.
_ARMED, _PX4 = 128, 12

#: Messages with texts of the autopilot.
_TEXTS = {
    Kind.DATAFLASH: ("MSG", "Message"),
    Kind.TELEMETRY: ("STATUSTEXT", "text"),
    Kind.PX4: ("logged_messages", "message"),
}


def modes(messages: Messages, kind: Kind, firmware: str | None) -> pd.DataFrame | None:
    """Flight modes with their times, repetitions dropped."""
    named = _modes(messages, kind, firmware)
    if named is None:
        return None
    t, names = named
    order, times = distinct(t)
    mode = pd.Series(np.asarray(list(names), dtype=object)[order], index=pd.Index(times, name="t"), dtype="str")
    return mode[mode != mode.shift()].to_frame("mode")


def _modes(messages: Messages, kind: Kind, firmware: str | None) -> tuple[pd.Index, Iterator[str]] | None:
    """Return times and names of the modes that are logged."""
    if kind is Kind.DATAFLASH:
        frame = first(messages, "MODE")
        column = next((name for name in ("ModeNum", "Mode") if frame is not None and name in frame), None)
        return (
            None
            if frame is None or column is None
            else (
                frame.index,
                (_mode_name(value, firmware) for value in frame[column]),
            )
        )
    if kind is Kind.TELEMETRY:
        if (frame := first(messages, "HEARTBEAT")) is None:
            return None
        px4 = int(frame["autopilot"].iloc[0]) == _PX4
        numbered = (int(value) for value in frame["custom_mode"])
        return frame.index, (px4_custom_mode(each) if px4 else ardupilot_mode(each, firmware) for each in numbered)
    frame = first(messages, "vehicle_status")
    if frame is None or "nav_state" not in frame:
        return None
    return frame.index, (PX4_MODES.get(int(value), f"MODE_{int(value)}") for value in frame["nav_state"])


def _mode_name(value: object, firmware: str | None) -> str:
    """Mode by number; text logs of 3.1 have the name instead."""
    try:
        return ardupilot_mode(int(float(str(value))), firmware)
    except (ValueError, OverflowError):
        return str(value).strip().upper().replace(" ", "_")


def events(messages: Messages, kind: Kind) -> pd.DataFrame | None:
    """Arming, take-off and landing, errors and texts, in order of time; an event repeated without change goes."""
    parts = {Kind.DATAFLASH: _dataflash, Kind.TELEMETRY: _telemetry, Kind.PX4: _px4}[kind](messages)
    rows = [row for part in (*parts, *_texts(messages, *_TEXTS[kind])) for row in zip(*part, strict=True)]
    order, times = distinct([float(t) for t, _, _ in rows])
    if not len(order):
        return None
    table = pd.DataFrame(
        {
            "event": pd.array([rows[k][1] for k in order], dtype="str"),
            "detail": pd.array([rows[k][2] for k in order], dtype="str"),
        },
        index=pd.Index(times, name="t", dtype=np.float64),
    )
    return table[(table != table.shift()).any(axis=1)]


def _texts(messages: Messages, name: str, column: str) -> Iterator[Part]:
    frame = first(messages, name)
    if frame is not None and column in frame:
        texts = [str(text).strip("\x00 ") for text in frame[column]]
        yield frame.index.to_numpy(), ["MESSAGE"] * len(texts), texts


def _changes(frame: pd.DataFrame, state: np.ndarray, on: str, off: str) -> Part:
    """Events where a state changes; the state at the start counts only when it is on."""
    changed = np.append(state[:1], state[1:] != state[:-1])
    names = [on if value else off for value in state[changed]]
    return frame.index.to_numpy()[changed], names, [""] * len(names)


def _dataflash(messages: Messages) -> Iterator[Part]:
    if "EV" in messages:
        frame = messages["EV"]
        ids = numbers(frame, "Id")
        known = np.isfinite(ids)
        names = [COPTER_EVENTS.get(int(k), f"EVENT_{int(k)}") for k in ids[known]]
        yield frame.index.to_numpy()[known], names, [""] * len(names)
    if "ERR" in messages:
        frame = messages["ERR"]
        subsystems, codes = numbers(frame, "Subsys"), numbers(frame, "ECode")
        known = np.isfinite(subsystems) & np.isfinite(codes)
        texts = [
            f"{COPTER_SUBSYSTEMS.get(int(subsystem), f'SUBSYSTEM_{int(subsystem)}')} {int(code)}"
            for subsystem, code in zip(subsystems[known], codes[known], strict=True)
        ]
        yield frame.index.to_numpy()[known], ["ERROR"] * len(texts), texts
    if "ARM" in messages and "EV" not in messages:
        frame = messages["ARM"]
        names = ["ARMED" if state else "DISARMED" for state in numbers(frame, "ArmState")]
        yield frame.index.to_numpy(), names, [""] * len(names)


def _telemetry(messages: Messages) -> Iterator[Part]:
    if (frame := first(messages, "HEARTBEAT")) is not None:
        armed = (frame["base_mode"].to_numpy(dtype=np.int64) & _ARMED) != 0
        yield _changes(frame, armed, "ARMED", "DISARMED")


def _px4(messages: Messages) -> Iterator[Part]:
    for name, column, state, on, off in (
        ("vehicle_status", "arming_state", 2, "ARMED", "DISARMED"),
        ("vehicle_land_detected", "landed", 0, "TAKEOFF", "LAND_COMPLETE"),
    ):
        frame = first(messages, name)
        if frame is not None and column in frame:
            yield _changes(frame, frame[column].to_numpy() == state, on, off)
