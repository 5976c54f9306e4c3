"""The craft from what logs of different ages say about it."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from logparse.craft.pwm_range import pwm_range
from logparse.craft.vehicle import describe
from tests.timed import timed


def texts(*lines):
    return {"MSG": pd.DataFrame({"Message": list(lines)}, index=pd.RangeIndex(len(lines), name="t"))}


def test_a_modern_octocopter():
    vehicle = describe(
        texts(
            "ArduCopter V4.5.7 (2a3dc4b7)",
            "ChibiOS: 6a85082c",
            "CubeOrange 00330024 32395105 30323831",
            "Frame: OCTA/X",
        ),
        format="dataflash",
        parameters={"FRAME_CLASS": 3, "FRAME_TYPE": 1, "MOT_PWM_MIN": 1100, "MOT_PWM_MAX": 1940, "MOT_THST_EXPO": 0.6},
    )
    assert (vehicle.autopilot, vehicle.firmware, vehicle.version) == ("ArduPilot", "ArduCopter", "4.5.7")
    assert (vehicle.git_hash, vehicle.board_id) == ("2a3dc4b7", "CubeOrange 00330024 32395105 30323831")
    assert (vehicle.frame_class, vehicle.frame_type, vehicle.frame_source) == ("octa", "x", "FRAME_CLASS")
    assert [m.channel for m in vehicle.motors] == list(range(1, 9))
    assert (vehicle.pwm_min, vehicle.pwm_max, vehicle.thrust_expo) == (1100, 1940, 0.6)


def outputs(*amplitudes, seed=1):
    """Make outputs of motors that take off and land together, each with its own share of that, and noise."""
    t = np.linspace(0.0, 60.0, 600)
    flown = np.interp(t, [0, 5, 8, 50, 55], [0, 0, 1, 1, 0])
    rng = np.random.default_rng(seed)

    def output(share):
        return np.rint(1100 + 500 * share * flown + 20 * rng.standard_normal(len(t)) * (share >= 0))

    shares = {f"Ch{k}": share for k, share in enumerate(amplitudes, start=1)}
    channels = {name: 0.0 if share is None else output(share) for name, share in shares.items()}
    return {"RCOU": timed(t, **channels)}


QUAD = (1.0, 1.0, 0.9, 1.1)


def beats(*kinds, autopilot=3):
    """Return heartbeats of the vehicle, and between them those of a ground station."""
    sender = {"system": [1, 255], "component": [1, 190]}
    rows = [{"type": [kind, 6], "autopilot": [autopilot, 8], **sender} for kind in kinds]
    return {"HEARTBEAT": pd.concat([pd.DataFrame(row) for row in rows])}


OLD = "ArduCopter V3.1.1 (681dafcf)"

#: Format, messages and parameters; class, type, where they are from, and the number of motors.
FRAMES = {
    "3.3 prints its class": (
        ("dataflash", texts("APM:Copter V3.3.1 (5b42ed2a)", "Frame: HEXA"), {"FRAME": 0}),
        ("hexa", "plus", "message", 6),
    ),
    "3.1, four outputs": (
        ("dataflash-text", texts(OLD) | outputs(*QUAD, *(None,) * 4), {"FRAME": 1}),
        ("quad", "x", "outputs", 4),
    ),
    "3.1, a camera mount": (
        ("dataflash-text", texts(OLD) | outputs(*QUAD, -0.5, 0.0, None, None), {"FRAME": 1}),
        ("quad", "x", "outputs", 4),
    ),
    # On an oscillating quad of 2014 single outputs hardly follow the mean of all; no other output is there.
    "motors that fight each other": (
        ("dataflash", texts(OLD) | outputs(1.0, -0.6, 0.9, -0.4, None, None, None, None), {"FRAME": 1}),
        ("quad", "x", "outputs", 4),
    ),
    "helicopter": (("dataflash", outputs(*QUAD), {"FRAME": 1, "H_SV1_POS": -60.0, "SYSID_SW_TYPE": 10}), None),
    "no outputs": (("dataflash", texts(OLD), {"FRAME": 1}), None),
    # An octocopter that only its file's name gives away was called a quad x.
    "octocopter": (("dataflash", texts(OLD) | outputs(*QUAD, *QUAD), {"FRAME": 1}), None),
    "hexacopter": (("dataflash", texts(OLD) | outputs(*QUAD, 1.0, 1.0, None, None), {"FRAME": 1}), None),
    "tricopter": (("dataflash", texts(OLD) | outputs(1.0, 1.0, None, 1.0, *(0.0,) * 4), {"FRAME": 1}), None),
    "telemetry of a hexa": (("tlog", beats(13, 13), {"FRAME": 0}), ("hexa", "plus", "MAV_TYPE", 6)),
    "telemetry without a type": (("tlog", beats(2), {}), ("quad", None, "MAV_TYPE", 4)),
    **{
        f"telemetry of type {kind}": (("tlog", beats(kind), {"FRAME_CLASS": 1, "FRAME_TYPE": 1}), None)
        for kind in (1, 10, 11, 21)
    },
    "aeroplane of PX4": (("ulog", {}, {"CA_AIRFRAME": 1, "CA_ROTOR_COUNT": 1, "SYS_AUTOSTART": 2100}), None),
    "tailsitter of PX4": (("ulog", {}, {"CA_AIRFRAME": 4, "CA_ROTOR_COUNT": 4, "SYS_AUTOSTART": 13200}), None),
    "airframe of PX4": (("ulog", {}, {"SYS_AUTOSTART": 6001}), ("hexa", "x", "SYS_AUTOSTART", 6)),
    # A mutated log of 4 kB named two thousand million rotors, and was never read to its end.
    "rotors that no craft has": (
        ("ulog", {}, {"CA_ROTOR_COUNT": 2**31 - 1, "SYS_AUTOSTART": 4001}),
        ("quad", "x", "SYS_AUTOSTART", 4),
    ),
    "y6": (("dataflash", {}, {"FRAME_CLASS": 5, "FRAME_TYPE": 0}), ("y6", "y6a", "FRAME_CLASS", 6)),
}


@pytest.mark.parametrize("craft", FRAMES)
def test_frames_are_those_that_the_log_tells(craft):
    (form, messages, parameters), expected = FRAMES[craft]
    vehicle = describe(messages, format=form, parameters=parameters)
    frame = (vehicle.frame_class, vehicle.frame_type, vehicle.frame_source, len(vehicle.motors))
    assert frame == (expected or (None, None, None, 0))


@pytest.mark.parametrize(
    ("lines", "parameters", "firmware"),
    [
        (["ArduRover V4.3.0 (12345678)"], {"FRAME_CLASS": 1, "FRAME_TYPE": 1}, "ArduRover"),
        ([], {"FRAME_CLASS": 1, "SYSID_SW_TYPE": 20}, "ArduRover"),
        ([], {"FRAME_CLASS": 2, "CRUISE_SPEED": 5.0}, "ArduRover"),
        (["ArduPlane V4.5.7 (12345678)", "Frame: QUAD/X"], {"FRAME": 1}, "ArduPlane"),
        ([], {"FRAME": 1, "SYSID_SW_TYPE": 0}, "ArduPlane"),
        ([], {"FRAME": 1, "TRIM_ARSPD_CM": 1200.0}, "ArduPlane"),
    ],
)
def test_what_is_no_multirotor_has_no_frame(lines, parameters, firmware):
    vehicle = describe(texts(*lines) | outputs(*QUAD, 0.0, 0.0), format="dataflash", parameters=parameters)
    assert vehicle.firmware == firmware
    assert (vehicle.frame_class, vehicle.motors) == (None, ())


def test_motors_are_numbered_by_function_and_not_by_output():
    functions = {5: 33, 6: 34, 7: 36, 8: 35, 1: 9}
    parameters = {"FRAME_CLASS": 1, "FRAME_TYPE": 1} | {f"SERVO{k}_FUNCTION": f for k, f in functions.items()}
    vehicle = describe({}, format="dataflash", parameters=parameters)
    assert {m.number: m.channel for m in vehicle.motors} == {1: 5, 2: 6, 3: 8, 4: 7}


def test_pwm_range_falls_back_to_the_throttle_channel():
    assert pwm_range({"MOT_PWM_MIN": 0, "MOT_PWM_MAX": 0, "RC3_MIN": 982, "RC3_MAX": 2006}).pwm_max == 2006
    assert pwm_range({"RCMAP_THROTTLE": 1, "RC1_MIN": 1010, "RC1_MAX": 1990, "RC3_MIN": 900}).pwm_min == 1010
    assert pwm_range({}).pwm(0.5) == 1500


def test_settings_that_no_motor_can_have_count_as_not_set():
    """A garbled MOT_THST_EXPO of 1e37 was a thrust of 1e37, and a coverage in that many bins."""
    odd = {"MOT_THST_EXPO": 7e37, "MOT_SPIN_MIN": -4e9, "MOT_SPIN_MAX": 1e9, "MOT_PWM_MIN": -3e9, "MOT_PWM_MAX": 2000}
    assert pwm_range(odd) == replace(pwm_range({}), thrust_expo=1.0)
    assert pwm_range({"SYS_AUTOSTART": 4001, "THR_MDL_FAC": -1e9, "MPC_MANTHR_MIN": 5.0}).thrust_expo == -1.0


def test_parameters_of_firmware_3_2_give_the_pulses_that_it_sent():
    # The Erle logs of 2014: disarmed 991, armed 1061, the highest pulse in flight 1944 us.
    levels = pwm_range(
        {
            "RC3_MIN": 991,
            "RC3_MAX": 2016,
            "THR_MIN": 130,
            "MOT_SPIN_ARMED": 70,
            "MOT_TCRV_ENABLE": 1,
            "MOT_TCRV_MIDPCT": 52,
            "MOT_TCRV_MAXPCT": 93,
        }
    )
    assert levels.pwm(levels.spin_arm) == pytest.approx(1061)
    assert int(levels.pwm(levels.spin_max)) == 1944
    # The two straight lines pass (52 of 93 %, half thrust); so must the curve (1 - e) c + e c^2.
    c = 52 / 93
    assert (1 - levels.thrust_expo) * c + levels.thrust_expo * c**2 == pytest.approx(0.5)


def test_px4_rotors_come_from_the_control_allocation():
    places = [(1, 1, 0.05), (-1, -1, 0.05), (1, -1, -0.05), (-1, 1, -0.05)]
    parameters = {"CA_ROTOR_COUNT": 4, "THR_MDL_FAC": 0.3}
    for k, (x, y, torque) in enumerate(places):
        parameters |= {
            f"CA_ROTOR{k}_PX": x,
            f"CA_ROTOR{k}_PY": y,
            f"CA_ROTOR{k}_KM": torque,
            f"PWM_MAIN_FUNC{k + 1}": 104 - k,
        }
    vehicle = describe({}, format="ulog", parameters=parameters)
    assert (vehicle.autopilot, vehicle.frame_class, vehicle.frame_type) == ("PX4", "quad", "x")
    assert [m.channel for m in vehicle.motors] == [4, 3, 2, 1]
    # PX4's generic quad X has ArduPilot's numbers and spins.
    ardupilot = describe({}, format="dataflash", parameters={"FRAME_CLASS": 1, "FRAME_TYPE": 1}).motors
    for px4, arducopter in zip(vehicle.motors, ardupilot, strict=True):
        assert px4.angle == pytest.approx(arducopter.angle)
        assert (px4.spin, px4.number) == (arducopter.spin, arducopter.number)
        assert (px4.roll, px4.pitch, px4.yaw) == pytest.approx((arducopter.roll, arducopter.pitch, arducopter.yaw))


def test_px4_range_version_and_board():
    facts = {"ver_sw": "eae80c15", "ver_hw": "CUAV_7_NANO", "ver_sw_release": str(0x011000FF)}
    messages = {"information": pd.DataFrame({"key": list(facts), "value": list(facts.values())})}
    parameters = {"SYS_AUTOSTART": 4001, "PWM_MIN": 1075, "PWM_MAX": 1950, "MPC_MANTHR_MIN": 0.1, "THR_MDL_FAC": 0.3}
    vehicle = describe(messages, format="ulog", parameters=parameters)
    assert (vehicle.version, vehicle.git_hash, vehicle.board_id) == ("1.16.0", "eae80c15", "CUAV_7_NANO")
    assert (vehicle.pwm_min, vehicle.pwm_max, vehicle.spin_min, vehicle.thrust_expo) == (1075, 1950, 0.1, 0.3)
    newer = {"SYS_AUTOSTART": 4001} | {f"PWM_MAIN_FUNC{k}": 100 + k for k in range(1, 5)}
    newer |= {f"PWM_MAIN_MIN{k}": 1100 for k in range(1, 5)} | {f"PWM_MAIN_MAX{k}": 1900 for k in range(1, 5)}
    assert (pwm_range(newer).pwm_min, pwm_range(newer).pwm_max) == (1100, 1900)
