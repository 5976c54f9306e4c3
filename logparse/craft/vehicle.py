"""The craft as its log describes it: firmware, frame, motors and how commands become PWM."""

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import asdict, replace

import numpy as np
import pandas as pd

from core.units import numbers
from logparse.craft.frames import (
    FRAME_CLASSES,
    FRAME_TYPES,
    MOTOR_COUNTS,
    Motor,
    Vehicle,
    motor_table,
    servo_function_motor,
)
from logparse.craft.pwm_range import pwm_range
from logparse.craft.quadplane import lifted_by_motors


def describe(
    messages: Mapping[str, pd.DataFrame],
    *,
    format: str,  # noqa: A002 -- the public argument's name
    parameters: Mapping[str, float],
    elsewhere: Iterable[str] = (),
) -> Vehicle:
    """Report what a log knows about its craft."""
    if format == "ulog":
        return _describe_px4(messages, parameters)
    texts = [*printed(messages)]
    if not any(map(_FIRMWARE.match, texts)):  # what prints its firmware prints the rest beside it
        texts += elsewhere
    firmware, version, git_hash = _firmware(messages, texts)
    firmware = firmware or _firmware_of(parameters)
    frame_class: str | None = None
    frame_type: str | None = None
    source: str | None = None
    if firmware in (None, *_COPTERS) or lifted_by_motors(firmware, parameters):
        frame_class, frame_type, source = _frame(messages, texts, parameters)
    motors: tuple[Motor, ...] = ()
    if frame_class is not None:
        # Heartbeats name no type: motors are taken to sit as most do (`frame-unknown`).
        geometry = frame_type or ("x" if source == "MAV_TYPE" else None)
        motors = motor_table(frame_class, geometry, _channels(parameters, frame_class, format))
    if frame_class == "y6" and frame_type not in ("y6b", "y6f"):
        frame_type = "y6a"
    autopilot = _autopilot(messages)
    if autopilot is None and (firmware is not None or "FORMAT_VERSION" in parameters or format.startswith("dataflash")):
        autopilot = "ArduPilot"
    return Vehicle(
        autopilot=autopilot,
        firmware=firmware,
        version=version,
        git_hash=git_hash,
        board_id=_board(texts),
        frame_class=frame_class,
        frame_type=frame_type,
        frame_source=source,
        motors=motors,
        **asdict(pwm_range(parameters)),
        battery_voltage_max=_first(parameters, "MOT_BAT_VOLT_MAX", "MOT_THST_BAT_MAX"),
        battery_voltage_min=_first(parameters, "MOT_BAT_VOLT_MIN", "MOT_THST_BAT_MIN"),
    )


def is_simulated(parameters: Mapping[str, float]) -> bool:
    """Return whether a log is of the firmware's own simulator, from the parameters that only such a build has."""
    return any(name.startswith("SIM_") for name in parameters)


def _first(parameters: Mapping[str, float], *names: str) -> float:
    """Value of the first parameter that exists, 0 when none does."""
    for name in names:
        value = parameters.get(name)
        if value is not None and math.isfinite(value):
            return float(value)
    return 0.0


def printed(messages: Mapping[str, pd.DataFrame]) -> Iterable[str]:
    """Return the text messages of the autopilot in the order logged, without repetition."""
    seen: dict[str, None] = {}
    for name, column in (("MSG", "Message"), ("STATUSTEXT", "text")):
        if name in messages and column in messages[name]:
            for text in messages[name][column].unique():
                if isinstance(text, str):
                    seen.setdefault(text.strip("\x00 "))
    return seen


_FIRMWARE = re.compile(
    r"^(?P<name>ArduCopter|APM:Copter|ArduPlane|APM:Plane|ArduRover|APM:Rover|ArduSub|Blimp|AntennaTracker|ACM)"
    r"\s+V(?P<version>\d[\w.\-]*)(?:\s+\((?P<hash>[0-9a-fA-F]{6,40})\))?"
)


def _firmware(messages: Mapping[str, pd.DataFrame], texts: Iterable[str]) -> tuple[str | None, str | None, str | None]:
    """Find the firmware's name, version and git hash."""
    for text in texts:
        match = _FIRMWARE.match(text)
        if match:
            return match["name"].replace("APM:", "Ardu"), match["version"], match["hash"]
    if "AUTOPILOT_VERSION" in messages and len(messages["AUTOPILOT_VERSION"]):
        version = numbers(messages["AUTOPILOT_VERSION"], "flight_sw_version")[-1]
        if version > 0.0 and np.isfinite(version):
            packed = int(version)
            return None, f"{packed >> 24}.{packed >> 16 & 255}.{packed >> 8 & 255}", None
    return None, None, None


#: Firmware of copters; the frames of others are not those of multirotors, even where their parameters have one name.
_COPTERS = ("ArduCopter", "ACM")

#: SYSID_SW_TYPE: which vehicle's firmware the parameters are of.
_SOFTWARE_TYPES: Mapping[int, str] = {
    0: "ArduPlane",
    4: "AntennaTracker",
    10: "ArduCopter",
    20: "ArduRover",
    40: "ArduSub",
}

#: Parameters that only one vehicle's firmware has.
_TELLING_PARAMETERS: Mapping[str, str] = {
    "CRUISE_SPEED": "ArduRover",
    "TRIM_ARSPD_CM": "ArduPlane",
    "AIRSPEED_CRUISE": "ArduPlane",
    "ATC_RAT_RLL_P": "ArduCopter",
}


def _firmware_of(parameters: Mapping[str, float]) -> str | None:
    """Return the firmware by its parameters, in a log that lost the message that names it."""
    kind = parameters.get("SYSID_SW_TYPE")
    if kind is not None:
        return _SOFTWARE_TYPES.get(int(kind))
    return next((firmware for name, firmware in _TELLING_PARAMETERS.items() if name in parameters), None)


_BOARD = re.compile(r"^\S+ [0-9A-Fa-f]{8} [0-9A-Fa-f]{8} [0-9A-Fa-f]{8}$")
_SITL_ID = re.compile(r"^[0-9a-f]{32}$")


def _board(texts: Iterable[str]) -> str | None:
    """Board name and its serial number, as the autopilot prints them; its simulator prints a bare hash."""
    for text in texts:
        if _BOARD.match(text):
            return text
        if _SITL_ID.match(text):
            return f"SITL {text}"
    return None


def _autopilot(messages: Mapping[str, pd.DataFrame]) -> str | None:
    """Name the autopilot of a telemetry log by its heartbeats."""
    beats = vehicle_heartbeats(messages)
    if beats is None or not len(beats):
        return None
    often = beats["autopilot"].mode()
    return {3: "ArduPilot", 12: "PX4"}.get(int(often.iloc[0])) if len(often) else None


#: MAV_TYPE of what is no multirotor: aeroplanes, helicopters, balloons, rockets, rovers, boats, VTOLs, parafoils.
_NO_MULTIROTORS = frozenset((1, 3, 4, 7, 8, 9, 10, 11, 12, 16, 17, 19, 20, 21, 22, 23, 24, 25, 28))

#: MAV_TYPE of vehicles that fly on rotors, and what frame class it names.
_MAV_TYPES: Mapping[int, str] = {2: "quad", 13: "hexa", 14: "octa", 15: "tri", 29: "dodeca-hexa", 35: "deca"}


def vehicle_heartbeats(messages: Mapping[str, pd.DataFrame]) -> pd.DataFrame | None:
    """Heartbeats of the vehicle's autopilot in a telemetry log, those of the ground station left out.

    The vehicle is the sender with an autopilot (MAV_AUTOPILOT other than invalid) that is heard most often.
    """
    if "HEARTBEAT" not in messages:
        return None
    beats = messages["HEARTBEAT"]
    # MAV_AUTOPILOT_INVALID is 8; ground stations, gimbals and companions use it or their own MAV_TYPE (6, 18, 26).
    beats = beats[(beats["autopilot"] != 8) & ~beats["type"].isin([6, 18, 26])]
    senders = [name for name in ("system", "component") if name in beats]
    if senders and len(beats):
        counts = beats.groupby(senders).size()
        best = counts.index[int(np.argmax(counts.to_numpy()))]
        for name, value in zip(senders, best if isinstance(best, tuple) else (best,), strict=True):
            beats = beats[beats[name] == value]
    return beats


_FRAME_MESSAGE = re.compile(r"^Frame: (?P<class>[A-Z0-9_ ]+?)(?:/(?P<type>\w+))?$")
_CLASS_WORDS = {
    "OCTAQUAD": "octa-quad",
    "OCTA_QUAD": "octa-quad",
    "DODECAHEXA": "dodeca-hexa",
    "DODECA_HEXA": "dodeca-hexa",
}
_TYPE_WORDS = {"PLUSREV": "plus-rev", "X_REV": "bf-x-rev", "DEFAULT": "y6a"}


def _frame(
    messages: Mapping[str, pd.DataFrame], texts: Iterable[str], parameters: Mapping[str, float]
) -> tuple[str | None, str | None, str | None]:
    """Find frame class, type and where they come from.

    Copter 3.5 and later has FRAME_CLASS and FRAME_TYPE. Before, the class is built into the firmware (3.2 and
    later print it) and FRAME holds the type.
    """
    said_class = said_type = None
    for text in texts:
        match = _FRAME_MESSAGE.match(text)
        if match and match["class"] != "UNSUPPORTED":
            said_class = _CLASS_WORDS.get(match["class"], match["class"].lower())
            said_type = match["type"]
    if said_type is not None:
        said_type = _TYPE_WORDS.get(said_type.upper(), said_type.lower().replace("_", "-"))
    number = parameters.get("FRAME_TYPE", parameters.get("FRAME"))
    frame_type = None if number is None else FRAME_TYPES.get(int(number))
    if frame_type is None:
        frame_type = said_type

    beats = vehicle_heartbeats(messages)
    kinds = pd.Series(dtype=float) if beats is None else beats["type"].mode()
    beat = int(kinds.iloc[0]) if len(kinds) else None
    if beat in _NO_MULTIROTORS and not parameters.get("Q_ENABLE"):
        return None, None, None
    declared = FRAME_CLASSES.get(int(parameters.get("FRAME_CLASS", 0)))
    if declared is not None:
        return declared, frame_type, "FRAME_CLASS"
    if said_class in FRAME_CLASSES.values():
        return said_class, frame_type, "message"
    if "MOT" in messages:
        # Before 3.1 the motors have their own message with one column each.
        count = sum(bool(re.fullmatch(r"Mot\d+", str(column))) for column in messages["MOT"])
        for name in ("quad", "hexa", "octa"):
            if MOTOR_COUNTS[name] == count:
                return name, frame_type, "message"
    if beat is not None and beat in _MAV_TYPES:
        return _MAV_TYPES[beat], frame_type, "MAV_TYPE"
    if "FRAME" in parameters and frame_type in ("y6b", "y6f"):
        return "y6", frame_type, "message"
    helicopter = any(name.startswith(("H_SV", "H_SWASH", "H_RSC")) for name in parameters)
    if "FRAME" in parameters and not helicopter and four_motors(messages):
        return "quad", frame_type, "outputs"
    return None, None, None


#: Correlation with outputs 1 to 4 above which another output may drive a motor.
_LIKE_A_MOTOR = 0.5


def four_motors(messages: Mapping[str, pd.DataFrame]) -> bool:
    """Return whether logged outputs 1 to 4 drive motors and no other output can.

    Outputs of motors rise and fall together from disarming over take-off to landing; servos, and outputs that pass the
    pilot's channels on, do not. More than four motors are never concluded from outputs that move.
    """
    outputs = messages.get("RCOU")
    if outputs is None or len(outputs) < 2:
        return False
    whole = np.isfinite(outputs.select_dtypes("number").to_numpy(np.float64)).all(axis=1)
    numbered = {
        int(match[1]): outputs[column].to_numpy(np.float64)[whole]
        for column in outputs
        if (match := re.fullmatch(r"C(?:h|han)?(\d+)", str(column)))
    }
    pulses = {k: values for k, values in numbered.items() if np.mean((values >= 800.0) & (values <= 2250.0)) > 0.5}
    if not {1, 2, 3, 4} <= set(pulses):
        return False
    mean = np.mean([pulses[k] for k in range(1, 5)], axis=0)
    if mean.std() < 1.0:
        # The motors never turned: others stand at the same pulse where they are motors too.
        return not any(abs(float(np.median(pulses[k] - mean))) < 1.0 for k in pulses if k > 4)
    like = {
        k: bool(values.std() > 0.0 and np.corrcoef(values, mean)[0, 1] > _LIKE_A_MOTOR) for k, values in pulses.items()
    }
    return all(pulses[k].std() > 0.0 for k in range(1, 5)) and not any(like[k] for k in like if k > 4)


def _channels(
    parameters: Mapping[str, float],
    frame_class: str,
    format: str,  # noqa: A002 -- the public argument's name
) -> Mapping[int, int] | None:
    """Servo output of each motor number; None when the log keeps to the convention that motor k is on output k."""
    channels: dict[int, int] = {}
    for name, value in parameters.items():
        match = re.fullmatch(r"SERVO(\d+)_FUNCTION", name)
        if match and math.isfinite(value):
            motor = servo_function_motor(int(value))
            if motor is not None:
                channels.setdefault(motor, int(match[1]))
    needed = MOTOR_COUNTS.get(frame_class, 0)
    # Copter 3.5 assigns its motors without writing the functions, and a damaged log can lack some of them.
    if len(channels) < min(needed, 3) or needed == 0:
        return None
    if not format.startswith("dataflash") and all(motor == output for motor, output in channels.items()):
        # Telemetry with an incomplete download of parameters: what is known keeps to the convention, so may the rest.
        absent = {k: k for k in range(1, needed + 1) if k not in channels and f"SERVO{k}_FUNCTION" not in parameters}
        channels |= absent
    return channels


def assumed_outputs(motors: Iterable[Motor], parameters: Mapping[str, float]) -> tuple[int, ...]:
    """Return the motors taken to be on the output of their number although other motors have a SERVOn_FUNCTION."""
    if not any(
        re.fullmatch(r"SERVO\d+_FUNCTION", name) and math.isfinite(value) and servo_function_motor(int(value))
        for name, value in parameters.items()
    ):
        return ()
    return tuple(
        motor.number
        for motor in motors
        if motor.channel == motor.number and f"SERVO{motor.channel}_FUNCTION" not in parameters
    )


def _describe_px4(messages: Mapping[str, pd.DataFrame], parameters: Mapping[str, float]) -> Vehicle:
    """Describe the craft of a PX4 log by its control allocation (CA_ROTORn) or airframe (SYS_AUTOSTART) parameters."""
    motors, frame_class, frame_type, source = _px4_motors(parameters)
    vehicle = Vehicle(
        autopilot="PX4",
        firmware="PX4",
        frame_class=frame_class,
        frame_type=frame_type,
        frame_source=source,
        motors=motors,
        **asdict(pwm_range(parameters)),
    )
    info = messages.get("information")
    if info is not None and {"key", "value"} <= set(info.columns):
        facts = dict(zip(info["key"], info["value"], strict=True))
        git_hash, board = facts.get("ver_sw"), facts.get("ver_hw")
        release = str(facts.get("ver_sw_release", ""))
        packed = int(release) if re.fullmatch("[0-9]{1,10}", release) else 0
        vehicle = replace(
            vehicle,
            version=f"{packed >> 24}.{packed >> 16 & 255}.{packed >> 8 & 255}" if packed else None,
            git_hash=None if git_hash is None else str(git_hash),
            board_id=None if board is None else str(board),
        )
    return vehicle


#: First airframe number of each hundred or thousand that PX4 gives to a multirotor frame.
_PX4_AIRFRAMES = (
    (4000, 4999, "quad", "x"),
    (5000, 5999, "quad", "plus"),
    (6000, 6999, "hexa", "x"),
    (7000, 7999, "hexa", "plus"),
    (8000, 8999, "octa", "x"),
    (9000, 9999, "octa", "plus"),
    (12000, 12999, "octa-quad", "x"),
)


#: CA_AIRFRAME of craft that hover level, and part of a rotor's thrust that points up where it lifts.
_MULTIROTOR, _STANDARD_VTOL, _UPRIGHT = 0, 2, 0.5
#: The function of an output that is PX4's first motor, and how many motors it knows: a larger number is damage.
_FIRST_MOTOR, _MOST_MOTORS = 101, 12


def _px4_motors(
    parameters: Mapping[str, float],
) -> tuple[tuple[Motor, ...], str | None, str | None, str | None]:
    """Motors, class, type and source of the frame. PX4 numbers the motors of its standard frames as ArduPilot does."""
    channels: dict[int, int] = {}
    for bank, offset in (("MAIN", 0), ("AUX", 0 if not any(n.startswith("PWM_MAIN_FUNC") for n in parameters) else 8)):
        for k in range(1, 17):
            function = int(parameters.get(f"PWM_{bank}_FUNC{k}", 0))
            if 0 <= function - _FIRST_MOTOR < _MOST_MOTORS:
                channels.setdefault(function - _FIRST_MOTOR + 1, k + offset)
    count = int(parameters.get("CA_ROTOR_COUNT", 0))
    count = count if count <= _MOST_MOTORS else 0
    if int(parameters.get("CA_AIRFRAME", 0)) not in (_MULTIROTOR, _STANDARD_VTOL):
        # An aeroplane, a tilting VTOL, a rover, a helicopter: what rotors they have do not make them a multirotor.
        return (), None, None, None
    # The rotor that pushes a VTOL forward comes after those that lift it.
    lifting = [k for k in range(count) if parameters.get(f"CA_ROTOR{k}_AZ", -1.0) < -_UPRIGHT]
    if lifting == list(range(len(lifting))) and (count := len(lifting)):
        rows = []
        for k in range(count):
            x, y = (float(parameters.get(f"CA_ROTOR{k}_P{axis}", 0.0)) for axis in "XY")
            rows.append((-y, x, float(np.sign(parameters.get(f"CA_ROTOR{k}_KM", 0.05)))))
        largest = [max(max(abs(row[axis]) for row in rows), 1e-9) for axis in range(3)]
        motors = tuple(
            Motor(
                number=number,
                channel=channels.get(number, number if not channels else None),
                angle=math.atan2(-roll, pitch),
                spin=-int(yaw),
                layer=0,
                roll=0.5 * roll / largest[0],
                pitch=0.5 * pitch / largest[1],
                yaw=0.5 * yaw / largest[2],
            )
            for number, (roll, pitch, yaw) in enumerate(rows, start=1)
        )
        angles = {round(motor.angle, 2) for motor in motors}
        if len(angles) == count:
            frame_class = {3: "tri", 4: "quad", 6: "hexa", 8: "octa"}.get(count)
        else:
            frame_class = {6: "y6", 8: "octa-quad"}.get(count)
        frame_type = "plus" if any(abs(motor.angle) < 0.1 for motor in motors) else "x"
        return motors, frame_class, frame_type, "CA_ROTOR"
    airframe = int(parameters.get("SYS_AUTOSTART", 0))
    for first, last, frame_class, frame_type in _PX4_AIRFRAMES:
        if first <= airframe <= last:
            return motor_table(frame_class, frame_type, channels or None), frame_class, frame_type, "SYS_AUTOSTART"
    return (), None, None, None
