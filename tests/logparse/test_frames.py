"""Motor numbering, where one wrong sign makes every model nonsense; and quadplanes, in hover a multirotor."""

import json
import math
import re

import pandas as pd
import pytest

from logparse import read_log
from logparse.completeness import check
from logparse.craft import frames
from logparse.craft.frames import motor_table, servo_function_motor
from sysid.loops import design, tune
from tests.logparse.quadplanes import quadplane
from tests.paths import REAL, SAMPLES, SITL

STANDARD = sorted(key for key in frames.FACTORS if key[1] not in ("vtail", "atail", "nyt-plus", "nyt-x"))


@pytest.mark.parametrize(("frame_class", "frame_type"), STANDARD)
def test_a_hovering_frame_does_not_turn_and_its_factors_agree_with_its_arms(frame_class, frame_type):
    # Equal thrust must give no roll and no yaw torque; V frames of eight motors are not symmetric fore and aft.
    motors = motor_table(frame_class, frame_type)
    assert len(motors) == frames.MOTOR_COUNTS[frame_class]
    assert sum(m.roll for m in motors) == pytest.approx(0.0, abs=1e-9)
    assert sum(m.yaw for m in motors) == pytest.approx(0.0, abs=1e-9)
    assert sum(m.pitch for m in motors) == pytest.approx(0.0, abs=0.03)
    assert sum(m.layer for m in motors) == 0
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
    assert [m.channel for m in motors] == [
        int(craft_motor["servo_output"].removeprefix("RCOU.C")) for craft_motor in truth
    ]
    for motor, true_motor in zip(motors, truth, strict=True):
        error = motor.angle - math.radians(true_motor["angle_deg_from_front_cw"])
        assert math.cos(error) == pytest.approx(1.0, abs=1e-9)
        assert motor.spin == -true_motor["yaw_factor"]


@pytest.mark.parametrize("frame", [("quad", "plus", "plus-rev"), ("quad", "x", "h"), ("octa-quad", "x", "h")])
def test_propellers_of_a_reversed_frame_turn_the_other_way(frame):
    kind, one, other = frame
    assert [m.yaw for m in motor_table(kind, one)] == [-m.yaw for m in motor_table(kind, other)]


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


def test_servo_functions_name_motors():
    assert [servo_function_motor(f) for f in (33, 40, 82, 85, 160, 179)] == [1, 8, 9, 12, 13, 32]
    assert [servo_function_motor(f) for f in (0, 1, 32, 41, 81, 86, 159)] == [None] * 7


SAMPLE = SAMPLES / "quad01_davos_esc.bin"
VTOL = REAL / "uavlogviewer__vtol.tlog"


@pytest.fixture(scope="module")
def copter():
    return read_log(SAMPLE)


@pytest.fixture(scope="module")
def winged(tmp_path_factory):
    """Return the same flight as a QuadPlane's, on its wings from 55 to 70 s."""
    path = tmp_path_factory.mktemp("quadplane") / "winged.bin"
    path.write_bytes(quadplane(SAMPLE.read_bytes(), on_wings=(55.0, 70.0)))
    return read_log(path)


def test_what_lifts_has_the_names_of_a_copter(copter, winged):
    vehicle = winged.vehicle
    assert (vehicle.firmware, vehicle.frame_class, vehicle.frame_type) == ("ArduPlane", "quad", "x")
    assert [motor.channel for motor in vehicle.motors] == [5, 6, 7, 8]
    assert vehicle.thrust_expo == copter.vehicle.thrust_expo
    assert winged.parameters["ATC_RAT_RLL_P"] == copter.parameters["ATC_RAT_RLL_P"]
    assert {"CTUN", "RATE"} <= set(winged.messages)
    assert "QTUN" not in winged.messages
    pd.testing.assert_series_equal(winged.tables.setpoints["throttle"], copter.tables.setpoints["throttle"])


def test_motors_and_controllers_count_in_hover_only(copter, winged):
    tables, on_wings = winged.tables, slice(55.0, 70.0)
    assert tables.motors.loc[on_wings].isna().all(axis=None)
    assert tables.rates.loc[on_wings, "out_roll"].isna().all()
    assert tables.rates.loc[on_wings, "w_x"].notna().all()  # measured whatever carries it
    hover = slice(35.0, 54.0)
    pd.testing.assert_frame_equal(tables.motors.loc[hover], copter.tables.motors.loc[hover])
    (flight,), (same,) = winged.flights, copter.flights
    assert (flight.start, flight.stop) == (same.start, same.stop)
    (finding,) = [finding for finding in winged.findings if finding.id == "wing-borne"]
    assert finding.evidence["seconds"] == pytest.approx(15.0, abs=0.3)


@pytest.fixture(scope="module")
def chirped(tmp_path_factory):
    path = tmp_path_factory.mktemp("quadplane") / "chirped.bin"
    path.write_bytes(quadplane((SAMPLES / "quad02_delft_systemid.bin").read_bytes()))
    return read_log(path)


def test_gains_are_proposed_by_the_craft_s_own_names(chirped):
    assert "PIDR" in chirped.messages
    tuned = tune(chirped)
    assert "Q_A_RAT_RLL_P," in tuned.proposed_file()
    assert "Q_A_RAT_RLL_P," in tuned.rollback_file()


@pytest.mark.parametrize("purpose", ["rates", "drag"])
def test_the_next_flight_is_one_that_a_quadplane_can_fly(chirped, winged, purpose):
    """Chirps by a switch in a Q mode (ArduPlane has no mode SYSTEMID), missions on the motors that lift."""
    planned = design(chirped if purpose == "rates" else winged, purpose)
    assert planned.refused is None
    text = "\n".join(planned.files.values())
    assert not re.search(r"\b(ATC_|MOT_|LOITER|ALT_HOLD|switch to SYSTEMID)", text)
    assert ("RCn_OPTION 184" in text) == (purpose == "rates")
    commands = [int(line.split("\t")[3]) for line in text.splitlines() if line.count("\t") == 11]
    assert commands[1:3] + commands[-1:] == ([] if purpose == "rates" else [84, 3000, 85])


def test_a_tailsitter_hovers_on_its_tail_and_is_left(tmp_path):
    path = tmp_path / "tailsitter.bin"
    data = quadplane(SAMPLE.read_bytes())
    path.write_bytes(data.replace(b"COMPASS_AUTODEC\0", b"Q_TAILSIT_ENABLE"))  # is 1
    log = read_log(path)
    assert log.vehicle.other_craft
    assert log.flights
    # Of an aeroplane, whose flights are not looked for, nobody can say that it did not fly.
    path.write_bytes(data.replace(b"Q_ENABLE", b"Q_DISABL"))
    plane = read_log(path)
    assert not plane.flights
    assert "no-flight" not in [finding.id for finding in check(plane)]


@pytest.mark.skipif(not VTOL.is_file(), reason="the shared logs are not here")
def test_a_tilting_tricopter_of_2018():
    """Motors 1 and 2 tilt and pull it forward from 652 to 732 s; it flew from 635.5 to 778.3 s."""
    log = read_log(VTOL)
    assert [motor.number for motor in log.vehicle.motors] == [1, 2, 4]
    (flight,) = log.flights
    assert (flight.start, flight.stop) == pytest.approx((635.5, 778.3), abs=1.0)
    aloft = log.tables.motors["m4"].loc[flight.start : flight.stop]
    on_wings = aloft[aloft.isna()].index
    assert (on_wings[0], on_wings[-1]) == pytest.approx((652.0, 732.0), abs=1.5)
