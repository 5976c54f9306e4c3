"""Where the motors of a multirotor sit and which way they turn: ArduPilot's frames, by motor number.

The numbers are those of ArduPilot's mixer (`AP_MotorsMatrix`, `AP_MotorsTri`; FRAME_CLASS and FRAME_TYPE are
its parameters). Motor k of a table is driven by the servo output whose SERVOn_FUNCTION is 32 + k (1 to 8),
73 + k (9 to 12) or 147 + k (13 to 32).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

#: FRAME_CLASS (Copter 3.5 and later).
FRAME_CLASSES: Mapping[int, str] = MappingProxyType(
    {
        1: "quad",
        2: "hexa",
        3: "octa",
        4: "octa-quad",
        5: "y6",
        6: "heli",
        7: "tri",
        8: "single",
        9: "coax",
        10: "bicopter",
        11: "heli-dual",
        12: "dodeca-hexa",
        13: "heli-quad",
        14: "deca",
    }
)

#: FRAME_TYPE, and FRAME of Copter before 3.5.
FRAME_TYPES: Mapping[int, str] = MappingProxyType(
    {
        0: "plus",
        1: "x",
        2: "v",
        3: "h",
        4: "vtail",
        5: "atail",
        6: "plus-rev",
        10: "y6b",
        11: "y6f",
        12: "bf-x",
        13: "dji-x",
        14: "cw-x",
        15: "i",
        16: "nyt-plus",
        17: "nyt-x",
        18: "bf-x-rev",
        19: "y4",
        20: "x-cor",
        21: "cw-x-cor",
    }
)


@dataclass(frozen=True, slots=True)
class Motor:
    """One motor of the autopilot's frame."""

    number: int  #: Motor number of the frame, from 1 (SERVOn_FUNCTION 33-40, 82-85).
    channel: int | None  #: Servo output that drives it, from 1; None when the log does not tell.
    angle: float  #: Direction of the arm seen from above, rad clockwise from the nose, in (-pi, pi].
    #: Rotation seen from above: +1 clockwise, -1 counter-clockwise. A clockwise propeller pushes the craft's nose to
    #: the left (negative yaw torque). 0 where the frame does not prescribe it (tricopter, V-tail fronts).
    spin: int
    layer: int  #: +1 upper and -1 lower motor of a coaxial pair or two-layer frame, 0 otherwise.
    #: Mixer factors as ArduPilot normalises them (AP_MotorsMatrix), roll right / pitch up / yaw right positive.
    roll: float
    pitch: float
    yaw: float


#: Firmware of robots that are no multirotors.
OTHER_CRAFT = frozenset({"ArduPlane", "ArduRover", "ArduSub", "AntennaTracker", "Blimp"})


@dataclass(frozen=True, slots=True, kw_only=True)
class Vehicle:
    """What a log says about the craft; None where it says nothing.

    `frame_class` is ``"quad"``, ``"hexa"``, ``"octa"``, ``"octa-quad"``, ``"y6"``, ``"tri"`` ...; `frame_type` is
    ``"plus"``, ``"x"``, ``"v"``, ``"h"`` ...; `frame_source` says where both come from: ``"FRAME_CLASS"``,
    ``"message"``, ``"MAV_TYPE"``, ``"CA_ROTOR"``, ``"SYS_AUTOSTART"``, or ``"outputs"`` when the log names only the
    type and outputs 1 to 4 alone drive motors. Robots that are no multirotors have no frame.
    PWM limits in us; spin fractions and `thrust_expo` as in MOT_SPIN_ARM, MOT_SPIN_MIN, MOT_SPIN_MAX and
    MOT_THST_EXPO; voltages of MOT_BAT_VOLT_MAX / _MIN in V (0: no compensation).
    """

    autopilot: str | None = None
    firmware: str | None = None
    version: str | None = None
    git_hash: str | None = None
    board_id: str | None = None
    frame_class: str | None = None
    frame_type: str | None = None
    frame_source: str | None = None
    motors: tuple[Motor, ...] = ()
    pwm_min: float = 1000.0
    pwm_max: float = 2000.0
    spin_arm: float = 0.1
    spin_min: float = 0.15
    spin_max: float = 0.95
    thrust_expo: float = 0.65
    battery_voltage_max: float = 0.0
    battery_voltage_min: float = 0.0

    @property
    def other_craft(self) -> bool:
        """Whether it is a robot that is no multirotor; a QuadPlane is one in hover."""
        return self.firmware in OTHER_CRAFT and not self.motors


# Yaw factors: a clockwise propeller turns the craft to the left.
_CW, _CCW = -1.0, 1.0


def _arms(*arms: tuple[float, float]) -> tuple[tuple[float, float, float], ...]:
    """Roll, pitch and yaw factor of motors given by arm angle [deg clockwise from the nose] and yaw factor."""
    return tuple((-math.sin(math.radians(angle)), math.cos(math.radians(angle)), yaw) for angle, yaw in arms)


def _alternating(first: float, step: float, count: int) -> tuple[tuple[float, float, float], ...]:
    """Motors numbered clockwise from `first` [deg], counter-clockwise and clockwise in turn."""
    return _arms(*((first + k * step, _CCW if k % 2 == 0 else _CW) for k in range(count)))


def _reversed(factors: Sequence[tuple[float, float, float]]) -> tuple[tuple[float, float, float], ...]:
    """Return the same arms with every propeller turning the other way."""
    return tuple((roll, pitch, -yaw) for roll, pitch, yaw in factors)


_QUAD_X = _arms((45, _CCW), (-135, _CCW), (-45, _CW), (135, _CW))
_QUAD_PLUS = _arms((90, _CCW), (-90, _CCW), (0, _CW), (180, _CW))
_QUAD_BF_X = _arms((135, _CW), (45, _CCW), (-135, _CCW), (-45, _CW))
_OCTA_QUAD_X = _arms((45, _CCW), (-45, _CW), (-135, _CCW), (135, _CW), (-45, _CCW), (45, _CW), (135, _CCW), (-135, _CW))
_OCTA_QUAD_BF_X = _arms(
    (135, _CW), (45, _CCW), (-135, _CCW), (-45, _CW), (135, _CCW), (45, _CW), (-135, _CW), (-45, _CCW)
)
_OCTA_PLUS = _arms((0, _CW), (180, _CW), (45, _CCW), (135, _CCW), (-45, _CCW), (-135, _CCW), (-90, _CW), (90, _CW))

#: Factors (roll, pitch, yaw) of motors 1, 2, ... before normalisation, by frame class and type.
FACTORS: Mapping[tuple[str, str], tuple[tuple[float, float, float], ...]] = MappingProxyType(
    {
        ("quad", "plus"): _QUAD_PLUS,
        ("quad", "plus-rev"): _reversed(_QUAD_PLUS),
        ("quad", "nyt-plus"): tuple((roll, pitch, 0.0) for roll, pitch, _ in _QUAD_PLUS),
        ("quad", "x"): _QUAD_X,
        ("quad", "h"): _reversed(_QUAD_X),
        ("quad", "nyt-x"): tuple((roll, pitch, 0.0) for roll, pitch, _ in _QUAD_X),
        ("quad", "v"): _arms((45, 0.7981), (-135, 1.0), (-45, -0.7981), (135, -1.0)),
        ("quad", "bf-x"): _QUAD_BF_X,
        ("quad", "bf-x-rev"): _reversed(_QUAD_BF_X),
        ("quad", "dji-x"): _alternating(45, -90, 4),
        ("quad", "cw-x"): _alternating(45, 90, 4),
        ("quad", "vtail"): (
            (-math.sin(math.radians(60)), 0.5, 0.0),
            (0.0, -math.cos(math.radians(20)), _CW),
            (math.sin(math.radians(60)), 0.5, 0.0),
            (0.0, -math.cos(math.radians(20)), _CCW),
        ),
        ("quad", "atail"): (
            (-math.sin(math.radians(60)), 0.5, 0.0),
            (0.0, -math.cos(math.radians(20)), _CCW),
            (math.sin(math.radians(60)), 0.5, 0.0),
            (0.0, -math.cos(math.radians(20)), _CW),
        ),
        ("quad", "y4"): ((-1.0, 1.0, _CCW), (0.0, -1.0, _CW), (0.0, -1.0, _CCW), (1.0, 1.0, _CW)),
        ("hexa", "plus"): _arms((0, _CW), (180, _CCW), (-120, _CW), (60, _CCW), (-60, _CCW), (120, _CW)),
        ("hexa", "x"): _arms((90, _CW), (-90, _CCW), (-30, _CW), (150, _CCW), (30, _CCW), (-150, _CW)),
        ("hexa", "h"): (
            (-1.0, 0.0, _CW),
            (1.0, 0.0, _CCW),
            (1.0, 1.0, _CW),
            (-1.0, -1.0, _CCW),
            (-1.0, 1.0, _CCW),
            (1.0, -1.0, _CW),
        ),
        ("hexa", "dji-x"): _alternating(30, -60, 6),
        ("hexa", "cw-x"): _alternating(30, 60, 6),
        ("octa", "plus"): _OCTA_PLUS,
        ("octa", "two-layer"): _OCTA_PLUS,
        ("octa", "x"): _arms(
            (22.5, _CW),
            (-157.5, _CW),
            (67.5, _CCW),
            (157.5, _CCW),
            (-22.5, _CCW),
            (-112.5, _CCW),
            (-67.5, _CW),
            (112.5, _CW),
        ),
        ("octa", "v"): (
            (0.83, 0.34, _CW),
            (-0.67, -0.32, _CW),
            (0.67, -0.32, _CCW),
            (-0.5, -1.0, _CCW),
            (1.0, 1.0, _CCW),
            (-0.83, 0.34, _CCW),
            (-1.0, 1.0, _CW),
            (0.5, -1.0, _CW),
        ),
        ("octa", "h"): (
            (-1.0, 1.0, _CW),
            (1.0, -1.0, _CW),
            (-1.0, 0.333, _CCW),
            (-1.0, -1.0, _CCW),
            (1.0, 1.0, _CCW),
            (1.0, -0.333, _CCW),
            (1.0, 0.333, _CW),
            (-1.0, -0.333, _CW),
        ),
        ("octa", "i"): (
            (0.333, -1.0, _CW),
            (-0.333, 1.0, _CW),
            (1.0, -1.0, _CCW),
            (0.333, 1.0, _CCW),
            (-0.333, -1.0, _CCW),
            (-1.0, 1.0, _CCW),
            (-1.0, -1.0, _CW),
            (1.0, 1.0, _CW),
        ),
        ("octa", "dji-x"): _alternating(22.5, -45, 8),
        ("octa", "cw-x"): _alternating(22.5, 45, 8),
        ("octa-quad", "plus"): _arms(
            (0, _CCW), (-90, _CW), (180, _CCW), (90, _CW), (-90, _CCW), (0, _CW), (90, _CCW), (180, _CW)
        ),
        ("octa-quad", "x"): _OCTA_QUAD_X,
        ("octa-quad", "h"): _reversed(_OCTA_QUAD_X),
        ("octa-quad", "v"): _arms(
            (45, 0.7981),
            (-45, -0.7981),
            (-135, 1.0),
            (135, -1.0),
            (-45, 0.7981),
            (45, -0.7981),
            (135, 1.0),
            (-135, -1.0),
        ),
        ("octa-quad", "cw-x"): _arms(
            (45, _CCW), (45, _CW), (135, _CW), (135, _CCW), (-135, _CCW), (-135, _CW), (-45, _CW), (-45, _CCW)
        ),
        ("octa-quad", "bf-x"): _OCTA_QUAD_BF_X,
        ("octa-quad", "bf-x-rev"): _reversed(_OCTA_QUAD_BF_X),
        ("octa-quad", "x-cor"): _arms(
            (45, _CCW), (-45, _CW), (-135, _CCW), (135, _CW), (-45, _CW), (45, _CCW), (135, _CW), (-135, _CCW)
        ),
        ("octa-quad", "cw-x-cor"): _arms(
            (45, _CCW), (45, _CCW), (135, _CW), (135, _CW), (-135, _CCW), (-135, _CCW), (-45, _CW), (-45, _CW)
        ),
        ("y6", "y6a"): (
            (-1.0, 0.666, _CCW),
            (1.0, 0.666, _CW),
            (1.0, 0.666, _CCW),
            (0.0, -1.333, _CW),
            (-1.0, 0.666, _CW),
            (0.0, -1.333, _CCW),
        ),
        ("y6", "y6b"): (
            (-1.0, 0.5, _CW),
            (-1.0, 0.5, _CCW),
            (0.0, -1.0, _CW),
            (0.0, -1.0, _CCW),
            (1.0, 0.5, _CW),
            (1.0, 0.5, _CCW),
        ),
        ("y6", "y6f"): (
            (0.0, -1.0, _CCW),
            (-1.0, 0.5, _CCW),
            (1.0, 0.5, _CCW),
            (0.0, -1.0, _CW),
            (-1.0, 0.5, _CW),
            (1.0, 0.5, _CW),
        ),
        ("deca", "plus"): _alternating(0, 36, 10),
        ("deca", "x"): _alternating(18, 36, 10),
        ("dodeca-hexa", "plus"): _arms(
            *((60 * (k // 2), _CCW if k % 4 in (0, 3) else _CW) for k in range(12)),
        ),
        ("dodeca-hexa", "x"): _arms(
            *((30 + 60 * (k // 2), _CCW if k % 4 in (0, 3) else _CW) for k in range(12)),
        ),
    }
)

#: Upper motors of frames in two layers; the others of the frame are the lower ones.
_UPPER: Mapping[tuple[str, str], frozenset[int]] = MappingProxyType(
    {
        # Elhesasy 2024: two crossed quads, numbered as octa-plus.
        ("octa", "two-layer"): frozenset({1, 2, 7, 8}),
        ("octa-quad", "plus"): frozenset({1, 2, 3, 4}),
        ("octa-quad", "x"): frozenset({1, 2, 3, 4}),
        ("octa-quad", "h"): frozenset({1, 2, 3, 4}),
        ("octa-quad", "v"): frozenset({1, 2, 3, 4}),
        ("octa-quad", "x-cor"): frozenset({1, 2, 3, 4}),
        ("octa-quad", "bf-x"): frozenset({1, 2, 3, 4}),
        ("octa-quad", "bf-x-rev"): frozenset({1, 2, 3, 4}),
        ("octa-quad", "cw-x"): frozenset({1, 3, 5, 7}),
        ("octa-quad", "cw-x-cor"): frozenset({1, 3, 5, 7}),
        ("y6", "y6a"): frozenset({2, 5, 6}),
        ("y6", "y6b"): frozenset({1, 3, 5}),
        ("y6", "y6f"): frozenset({1, 2, 3}),
        ("dodeca-hexa", "plus"): frozenset({1, 3, 5, 7, 9, 11}),
        ("dodeca-hexa", "x"): frozenset({1, 3, 5, 7, 9, 11}),
    }
)

#: Motors of a coaxial arm in frames that are otherwise in one plane.
_Y4_LAYERS: Mapping[int, int] = MappingProxyType({2: 1, 3: -1})

#: Number, arm [deg], roll and pitch factor of the tricopter's motors: there is no motor 3.
_TRI = ((1, 60.0, -0.5, 0.5), (2, -60.0, 0.5, 0.5), (4, 180.0, 0.0, -0.5))

#: Number of motors by frame class.
MOTOR_COUNTS: Mapping[str, int] = MappingProxyType(
    {"quad": 4, "hexa": 6, "octa": 8, "octa-quad": 8, "y6": 6, "tri": 3, "deca": 10, "dodeca-hexa": 12}
)


def motor_table(
    frame_class: str, frame_type: str | None = None, channels: Mapping[int, int] | None = None
) -> tuple[Motor, ...]:
    """List the motors of a frame, by motor number."""

    def channel(number: int) -> int | None:
        return number if channels is None else channels.get(number)

    if frame_class == "tri":
        # AP_MotorsTri yaws with a tail servo, so its motors have no yaw factor and no prescribed spin.
        sign = -1.0 if frame_type == "plus-rev" else 1.0
        return tuple(
            Motor(number, channel(number), _arm_angle(sign * angle), 0, 0, roll, sign * pitch, 0.0)
            for number, angle, roll, pitch in _TRI
        )
    if frame_class == "y6" and frame_type not in ("y6b", "y6f"):
        frame_type = "y6a"
    if frame_class == "deca" and frame_type == "cw-x":
        frame_type = "x"
    key = (frame_class, frame_type or "")
    factors = FACTORS.get(key)
    if factors is None:
        return ()
    upper = _UPPER.get(key)
    largest = [max(abs(row[axis]) for row in factors) for axis in range(3)]
    motors = []
    for number, row in enumerate(factors, start=1):
        roll, pitch, yaw = (0.5 * value / top if top > 0.0 else 0.0 for value, top in zip(row, largest, strict=True))
        layer = 0 if upper is None else (1 if number in upper else -1)
        if key == ("quad", "y4"):
            layer = _Y4_LAYERS.get(number, 0)
        spin = 0 if yaw == 0.0 else (-1 if yaw > 0.0 else 1)
        # The arms of a Y6 stand 120 deg apart; its mixer factors are rounded or reweighted.
        arm = math.copysign(60.0, -roll) if frame_class == "y6" and roll else math.degrees(math.atan2(-row[0], row[1]))
        motors.append(Motor(number, channel(number), _arm_angle(arm), spin, layer, roll, pitch, yaw))
    return tuple(motors)


def _arm_angle(degrees: float) -> float:
    """Direction of an arm in rad clockwise from the nose, in (-pi, pi]."""
    angle = math.radians(degrees)
    return math.pi if math.isclose(abs(angle), math.pi) else angle


def servo_function_motor(function: int) -> int | None:
    """Motor number that SERVOn_FUNCTION assigns to a servo output, or None when it is not a motor."""
    if 33 <= function <= 40:
        return function - 32
    if 82 <= function <= 85:
        return function - 73
    if 160 <= function <= 179:
        return function - 147
    return None
