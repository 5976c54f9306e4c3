"""Advice on logging: one value for all that is lacking, which switches nothing off, in the autopilot's own words."""

from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from logparse.craft.frames import Vehicle
from logparse.craft.log_settings import Need, bit_to_set, bits_of, how_to_log, log_setting

COPTER = Vehicle(autopilot="ArduPilot", firmware="ArduCopter", version="4.5.7", frame_class="quad")
PX4 = Vehicle(autopilot="PX4", firmware="PX4", version="1.16.0")
VEHICLES = [COPTER, PX4, *(Vehicle(autopilot="ArduPilot", firmware=each) for each in ("ArduPlane", "ArduRover"))]


@given(
    # 16 bits with their sign in firmware before 3.3, 32 bits since; the parameter travels as a 32-bit float, which is
    # exact to 2**24.
    present=st.integers(-(2**15), 2**24),
    needs=st.sets(st.sampled_from(Need), min_size=1),
    vehicle=st.sampled_from(VEHICLES),
)
def test_what_was_logged_is_never_switched_off(present, needs, vehicle):
    parameter = "SDLOG_PROFILE" if vehicle.autopilot == "PX4" else "LOG_BITMASK"
    setting = log_setting(vehicle, "dataflash", {parameter: float(present)}, needs)
    if setting is None:
        assert not needs & bits_of(vehicle).keys()
        return
    assert setting.present == present
    bits = {bit.number for need, bit in bits_of(vehicle).items() if need in needs}
    for number in range(32):
        assert setting.wanted >> number & 1 == (present >> number & 1 or number in bits)
    for need in needs & bits_of(vehicle).keys():
        text = how_to_log(need, setting, vehicle, "dataflash")
        assert f"Set {parameter} to {setting.wanted} (it is {present})" in text or "is set already" in text


@pytest.mark.parametrize("value", [None, float("nan"), float("inf"), 1.4e-45, 176126.5])
def test_a_mask_that_is_none_gives_bits_and_no_value(value):
    setting = log_setting(COPTER, "dataflash", {} if value is None else {"LOG_BITMASK": value}, [Need.GPS])
    assert setting.wanted is None
    assert how_to_log(Need.GPS, setting, COPTER, "dataflash").startswith(
        "Add bit 2 (GPS) to LOG_BITMASK, keeping what is set"
    )


def test_bits_are_those_of_the_vehicle():
    """Bit 10 logs the motors of a copter, the compass of a plane and the range finder of a rover."""
    copter, _, plane, rover = (bits_of(each) for each in VEHICLES)
    assert (copter[Need.MOTORS].number, plane[Need.MOTORS].number, rover[Need.MOTORS].number) == (10, 13, 14)
    assert (copter[Need.COMPASS].number, plane[Need.COMPASS].number, rover[Need.COMPASS].number) == (13, 10, 11)


def test_bits_that_differ_are_not_named_where_nothing_tells_the_firmware():
    unknown = Vehicle(autopilot="ArduPilot")
    assert log_setting(unknown, "dataflash", {"LOG_BITMASK": 2.0}, [Need.GPS]).wanted == 6
    assert log_setting(unknown, "dataflash", {"LOG_BITMASK": 65535.0}, [Need.MOTORS]) is None
    assert "bit" not in how_to_log(Need.MOTORS, None, unknown, "dataflash")


def test_firmware_before_3_3_is_not_asked_for_the_fast_imu():
    old = Vehicle(autopilot="ArduPilot", firmware="ArduCopter", version="3.2.1")
    assert log_setting(old, "dataflash", {"LOG_BITMASK": 43006.0}, [Need.FAST_IMU]) is None
    assert "newer firmware" in how_to_log(Need.FAST_IMU, None, old, "dataflash")


@pytest.mark.parametrize("need", list(Need))
@pytest.mark.parametrize("form", ["ulog", "tlog"])
def test_px4_hears_of_px4_s_parameters_only(need, form):
    setting = log_setting(PX4, form, {"SDLOG_PROFILE": 1.0}, [need])
    text = how_to_log(need, setting, PX4, form)
    assert not any(word in text for word in ("LOG_BITMASK", "SRn_", "DataFlash", "RCOU"))


@pytest.mark.parametrize(
    ("vehicle", "form", "parameters", "said"),
    [
        (Vehicle(autopilot="PX4"), "ulog", {}, "bit 4 (high rate) to SDLOG_PROFILE"),
        (COPTER, "dataflash", {"LOG_BITMASK": 176126.0}, "add bit 0 (ATTITUDE_FAST) to LOG_BITMASK"),
        (COPTER, "dataflash", {"LOG_BITMASK": 65535.0}, "is set already"),
        (COPTER, "tlog", {"LOG_BITMASK": 176126.0}, "on board"),
        (Vehicle(autopilot="ArduPilot", firmware="Blimp"), "dataflash", {}, "log rate controller"),
    ],
)
def test_a_response_s_advice_speaks_the_autopilot_s_language_and_never_names_a_value(vehicle, form, parameters, said):
    """Responses told every log to set LOG_BITMASK: PX4's, telemetry, and one of 65535, in which all is set."""
    log = SimpleNamespace(vehicle=vehicle, format=form, parameters=parameters)
    clause = bit_to_set(Need.FAST_RATES, log)
    assert said in clause
    assert "65535" not in clause
    assert "LOG_BITMASK" not in clause or vehicle == COPTER
