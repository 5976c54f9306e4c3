"""The craft as its log describes it: firmware, frame, motors and how commands become PWM."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Motor:
    """One motor of the autopilot's frame.

    Attributes
    ----------
    number : int
        Motor number of the frame, from 1 (SERVOn_FUNCTION 33-40, 82-85).
    channel : int or None
        Servo output that drives it, from 1; None when the log does not tell.
    angle : float
        Direction of the arm seen from above, rad clockwise from the nose, in (-pi, pi].
    spin : int
        Rotation seen from above: +1 clockwise, -1 counter-clockwise. A clockwise propeller pushes the craft's
        nose to the left (negative yaw torque).
    layer : int
        +1 upper and -1 lower motor of a coaxial pair or two-layer frame, 0 otherwise.
    roll, pitch, yaw : float
        Mixer factors as ArduPilot normalises them (AP_MotorsMatrix), roll right / pitch up / yaw right positive.
    """

    number: int
    channel: int | None
    angle: float
    spin: int
    layer: int
    roll: float
    pitch: float
    yaw: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Vehicle:
    """What a log says about the craft; None where it says nothing.

    `frame_class` is ``"quad"``, ``"hexa"``, ``"octa"``, ``"octa-quad"``, ``"y6"``, ``"tri"`` ...; `frame_type` is
    ``"plus"``, ``"x"``, ``"v"``, ``"h"`` ... PWM limits in us; spin fractions and `thrust_expo` as in MOT_SPIN_ARM,
    MOT_SPIN_MIN, MOT_SPIN_MAX and MOT_THST_EXPO; voltages of MOT_BAT_VOLT_MAX / _MIN in V (0: no compensation).
    """

    autopilot: str | None = None
    firmware: str | None = None
    version: str | None = None
    git_hash: str | None = None
    board_id: str | None = None
    frame_class: str | None = None
    frame_type: str | None = None
    motors: tuple[Motor, ...] = ()
    pwm_min: float = 1000.0
    pwm_max: float = 2000.0
    spin_arm: float = 0.1
    spin_min: float = 0.15
    spin_max: float = 0.95
    thrust_expo: float = 0.65
    battery_voltage_max: float = 0.0
    battery_voltage_min: float = 0.0
