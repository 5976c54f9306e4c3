"""Motor numbering: one wrong sign here and every model of that frame is nonsense."""

import json
import math
from pathlib import Path

import pytest

from logparse.craft import frames
from logparse.craft.frames import motor_table, servo_function_motor

SITL = Path(__file__).resolve().parents[3] / "shared" / "logs" / "sitl"

STANDARD = sorted(key for key in frames.FACTORS if key[1] not in ("vtail", "atail", "nyt-plus", "nyt-x"))


@pytest.mark.parametrize(("frame_class", "frame_type"), STANDARD)
def test_a_hovering_frame_does_not_turn(frame_class, frame_type):
    # Equal thrust must give no roll and no yaw torque; V frames of eight motors are not symmetric fore and aft.
    motors = motor_table(frame_class, frame_type)
    assert len(motors) == frames.MOTOR_COUNTS[frame_class]
    assert sum(m.roll for m in motors) == pytest.approx(0.0, abs=1e-9)
    assert sum(m.yaw for m in motors) == pytest.approx(0.0, abs=1e-9)
    assert sum(m.pitch for m in motors) == pytest.approx(0.0, abs=0.03)
    assert sum(m.layer for m in motors) == 0


@pytest.mark.parametrize(("frame_class", "frame_type"), STANDARD)
def test_factors_are_normalised_and_agree_with_the_arms(frame_class, frame_type):
    motors = motor_table(frame_class, frame_type)
    for axis in ("roll", "pitch", "yaw"):
        assert max(abs(getattr(m, axis)) for m in motors) == pytest.approx(0.5)
    for m in motors:
        # A motor on the right (angle between 0 and pi) rolls the craft to the left, one in front pitches it up.
        assert -math.pi < m.angle <= math.pi
        assert m.roll * math.sin(m.angle) <= 1e-9
        assert m.pitch * math.cos(m.angle) >= -1e-9
        # A clockwise propeller turns the craft to the left.
        assert m.spin == (-1 if m.yaw > 0 else 1)


@pytest.mark.parametrize(
    ("name", "frame_class", "frame_type"),
    [
        ("octa01_auto_calm", "octa", "plus"),
        ("octaquad01_auto_callisto", "octa-quad", "x"),
        ("y6_01_auto", "y6", "plus"),
        ("quad06_auto", "quad", "x"),
    ],
)
def test_frames_are_those_of_the_firmware_in_the_loop(name, frame_class, frame_type):
    path = SITL / f"{name}.json"
    if not path.exists():
        pytest.skip("shared logs are not here")
    truth = json.loads(path.read_text())["truth"]["motors"]
    motors = motor_table(frame_class, frame_type)
    assert [m.channel for m in motors] == [int(each["servo_output"].removeprefix("RCOU.C")) for each in truth]
    for motor, each in zip(motors, truth, strict=True):
        error = motor.angle - math.radians(each["angle_deg_from_front_cw"])
        assert math.cos(error) == pytest.approx(1.0, abs=1e-9)
        assert motor.spin == -each["yaw_factor"]


def test_elhesasy_octocopter_has_its_clockwise_motors_above():
    # Elhesasy 2024: 1, 2, 7, 8 on the `+` above and clockwise; 3, 4, 5, 6 on the `x` below and counter-clockwise.
    motors = {m.number: m for m in motor_table("octa", "two-layer")}
    for number in (1, 2, 7, 8):
        assert (motors[number].layer, motors[number].spin) == (1, 1)
        assert math.sin(2 * motors[number].angle) == pytest.approx(0.0, abs=1e-9)
    for number in (3, 4, 5, 6):
        assert (motors[number].layer, motors[number].spin) == (-1, -1)
        assert abs(math.sin(2 * motors[number].angle)) == pytest.approx(1.0)
    # Its roll torque: 5, 6, 7 push up on the left and roll right, 3, 4, 8 the other way.
    assert all(motors[k].roll > 0 for k in (5, 6, 7))
    assert all(motors[k].roll < 0 for k in (3, 4, 8))


def test_coaxial_pairs_turn_against_each_other():
    for frame_class, frame_type in (("octa-quad", "x"), ("octa-quad", "cw-x"), ("y6", "y6b"), ("dodeca-hexa", "x")):
        pairs = {}
        for motor in motor_table(frame_class, frame_type):
            pairs.setdefault(round(motor.angle, 6), []).append(motor)
        for pair in pairs.values():
            assert sorted(m.layer for m in pair) == [-1, 1]
            assert sum(m.spin for m in pair) == 0


def test_tricopter_has_no_motor_three():
    assert [m.number for m in motor_table("tri")] == [1, 2, 4]
    assert [round(math.degrees(m.angle)) for m in motor_table("tri")] == [60, -60, 180]
    assert all(m.spin == 0 and m.yaw == 0.0 for m in motor_table("tri"))


def test_frames_that_do_not_exist_have_no_motors():
    assert motor_table("octa", "vtail") == ()
    assert motor_table("heli", "plus") == ()


def test_channels_follow_the_servo_functions():
    motors = motor_table("quad", "x", {1: 5, 2: 6, 3: 7})
    assert [m.channel for m in motors] == [5, 6, 7, None]


def test_servo_functions_name_motors():
    assert [servo_function_motor(f) for f in (33, 40, 82, 85, 160, 179)] == [1, 8, 9, 12, 13, 32]
    assert [servo_function_motor(f) for f in (0, 1, 32, 41, 81, 86, 159)] == [None] * 7
