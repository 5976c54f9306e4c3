"""Names of flight modes and events of the autopilots."""

from collections.abc import Mapping
from types import MappingProxyType

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
