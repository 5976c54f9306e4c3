"""The thrust curve from flight: a wrong setting is named and mended, with the hover throttle that goes with it."""

from dataclasses import replace
from functools import cache

import pytest

from estimation import estimate
from logparse import Finding, Severity, read_log
from sysid import Experiment, fit_rigid_body
from sysid.autopilot.thrust_curve import believed, hover_throttle, thrust_values
from sysid.autopilot.values import ParameterFile
from sysid.records.mixer import MIXER_DIFFERS


@cache
def flown(path):
    log = read_log(path)
    return log, Experiment.from_flight(log, estimate(log.tables, date=log.start_utc), 50.0)


def values(log, record):
    setting = log.parameters_flown | {"MOT_THST_EXPO": record.vehicle.thrust_expo}
    found = thrust_values(fit_rigid_body([record]), [log], [record], setting)
    return {each.name.removeprefix("MOT_"): each for each in found}


def with_setting(record, **setting):
    return replace(record, vehicle=replace(record.vehicle, **setting))


@pytest.mark.parametrize(("wrong", "hover"), [(0.3, "less"), (0.9, "more"), (0.65, "")])
def test_a_simulated_craft_of_065_flown_with_another_setting(wrong, hover):
    """The motors' pulses are the same whatever the setting: what it makes of them differs."""
    log, record = flown("sample_logs/octa05_nairobi_turns.bin")
    found = values(log, with_setting(record, thrust_expo=wrong))
    expo, throttle = found["THST_EXPO"].proposed, found["THST_HOVER"]
    assert (expo.value is None) == (not hover)
    if not hover:
        assert "within the error" in expo.reason or "less than 3 %" in expo.reason
        assert throttle.file is ParameterFile.THROTTLE
    else:
        assert expo.value == pytest.approx(0.65, abs=0.05)
        assert throttle.file is ParameterFile.ESC  # loaded with the curve it belongs to
        ratio = throttle.proposed.value / hover_throttle(log, record).mean()
        assert (ratio < 1.0) == (hover == "less")


def test_parameters_that_did_not_fly_and_a_battery_that_sags_are_named():
    log, record = flown("sample_logs/octa05_nairobi_turns.bin")
    apart = Finding(MIXER_DIFFERS, Severity.WARNING, "motor outputs follow otherwise", "", {"slope": 1.2})
    found = values(log, replace(record, findings=(apart,)))
    assert all(each.proposed.value is None and "did not fly" in each.proposed.reason for each in found.values())


@pytest.mark.parametrize(("name", "flew"), [("minus", 0.30), ("right", 0.65)])
def test_firmware_flights_of_wrong_curves(unpacked, name, flew):
    """True curve 0.65; hover throttle 0.366 by the wrong setting, 0.284 by the right one."""
    log, record = flown(unpacked(f"autopilot/expo_quad15_{name}"))
    found = values(log, record)
    assert found["THST_EXPO"].now == pytest.approx(flew)
    assert found["SPIN_MIN"].proposed.value is None
    assert "thrust begins" in found["SPIN_MIN"].proposed.reason
    proposed = {key: each.proposed.value for key, each in found.items() if each.proposed.value is not None}
    climb = {"PSC_ACCZ_P": 0.284, "PSC_ACCZ_I": 0.568}  # flown with the firmware's 0.5 and 1
    curve = {} if flew == 0.65 else {"THST_EXPO": 0.65, "THST_HOVER": 0.284}
    assert proposed == pytest.approx(climb | curve, abs=0.02)


def test_vibration_that_the_accelerometer_folds_changes_no_curve(unpacked):
    """Hover with small climbs says 0.58 ± 0.02 where 0.65 is true and flew, which changes the loops by 1 %."""
    found = values(*flown(unpacked("autopilot/vibration_octa8_off")))
    assert found["THST_EXPO"].right
    assert found["THST_HOVER"].right


def test_thrust_that_begins_elsewhere_is_told_from_a_curve(unpacked):
    """MOT_SPIN_MIN 0.25 for motors that push from 0.15 on; the curve that goes with 0.15 is 0.65."""
    _, record = flown(unpacked("autopilot/expo_quad15_right"))
    wrong = with_setting(record, spin_min=0.25)
    meant, sigma, begin_sigma = believed(fit_rigid_body([wrong]), [wrong])
    assert meant.spin_min == pytest.approx(0.15, abs=4.0 * 0.8 * begin_sigma)
    assert meant.thrust_expo == pytest.approx(0.65, abs=2.0 * sigma)
