"""EKF3's drag and the thrust curve from flight: the right ones of firmware craft, else nothing."""

import json
import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from estimation import estimate
from logparse import Finding, Severity, read_log
from sysid import Experiment, fit_rigid_body
from sysid.autopilot.drag import drag_values
from sysid.autopilot.thrust_curve import believed, hover_throttle, thrust_values
from sysid.autopilot.values import ParameterFile
from sysid.records.mixer import MIXER_DIFFERS
from sysid.records.thrust_curve import relative_density


@cache
def flown(path):
    log = read_log(path)
    return log, Experiment.from_flight(log, estimate(log.tables, date=log.start_utc), 50.0)


@cache
def fitted(path):
    _, record = flown(path)
    return fit_rigid_body([record]), record


def values(model, record, version=(4, 7)):
    return {value.name.removeprefix("EK3_DRAG_"): value.proposed for value in drag_values(model, [record], version, {})}


def test_of_a_simulated_craft():
    """The relocations of octa11 at 6 m/s: every coefficient within two of its sigmas of the truth."""
    proposed = values(*fitted("sample_logs/octa11_sydney_fast.bin"))
    craft = json.loads(Path("sample_logs/octa11_sydney_fast.json").read_text())["vehicle"]
    mass, area, linear = craft["mass_kg"], craft["drag_area_m2"], craft["drag_linear_n_s_m"]
    truth = {"BCOEF_X": mass / area[0], "BCOEF_Y": mass / area[1], "MCOEF": linear[0] / mass}
    for name, true in truth.items():
        assert abs(proposed[name].value - true) < 2.0 * proposed[name].sigma, name
        assert proposed[name].sigma < 0.35 * true


@pytest.mark.parametrize("version", [(4, 7), (4, 5)])
def test_at_the_density_flown_ekf3_computes_the_deceleration_of_the_craft(version):
    """AP_NavEKF3_AirDataFusion: rho u^2 / (2 BCOEF) + MCOEF r u; r: density's since 4.7, EAS2TAS^0.5 before."""
    model, record = fitted("sample_logs/octa11_sydney_fast.bin")
    proposed = values(model, record, version)
    s = float(np.median(relative_density(record)))
    r = s if version == (4, 7) else math.sqrt(s**-0.5)
    linear = math.sqrt(s) if model.rotor_drag else s
    for axis in "xy":
        quadratic = 1.225 * r / (2.0 * proposed[f"BCOEF_{axis.upper()}"].value)
        assert quadratic == pytest.approx(s * model.value(f"drag_quadratic_{axis}"), rel=0.35)
        total = model.value(f"drag_linear_{axis}") * linear * 5.0 + s * model.value(f"drag_quadratic_{axis}") * 25.0
        assert proposed["MCOEF"].value * r * 5.0 + quadratic * 25.0 == pytest.approx(total, rel=0.05)


def test_a_wind_that_turns_and_a_flight_without_speed_are_named():
    model, record = fitted("sample_logs/octa11_sydney_fast.bin")
    trim = model.flights[record.name]
    veered = tuple((float(t), 2.0 * k, 0.0) for k, t in enumerate(np.linspace(record.t[0], record.t[-1], 4)))
    turned = replace(model, flights={record.name: replace(trim, variation=veered)})
    assert all(
        value.value is None and "the wind changed by 4.0 m/s" in value.reason
        for value in values(turned, record).values()
    )
    still = values(*fitted("sample_logs/octa07_singapore_hot.bin"))
    assert all(parameter.value is None and "EKF3's wind would err" in parameter.reason for parameter in still.values())


def test_a_flight_that_hardly_moves_says_how_little_it_knows_of_the_square_of_speed(unpacked):
    """At 0.1 m/s through the air it was 15.7 +- 0.3 of true 22.6 kg/m^2: laws of drag hold less well than they fit."""
    true = 1.5 / 0.0663  # mass over drag area
    proposed = values(*fitted(unpacked("autopilot/autotune_quad15_after")))
    for name in ("BCOEF_X", "BCOEF_Y"):
        assert proposed[name].value is None or abs(proposed[name].value - true) < 2.0 * proposed[name].sigma


def test_a_flight_of_the_firmware_without_drag_tells_the_right_ones(unpacked):
    """EKF3 knew no wind there; with the right ones it errs by 0.13 m/s, with the simulator's hint by 0.49."""
    model, record = fitted(unpacked("autopilot/drag_octa_off"))
    proposed = values(model, record)
    for name, true in {"BCOEF_X": 17.21, "BCOEF_Y": 17.21, "MCOEF": 0.254}.items():
        assert proposed[name].value == pytest.approx(true, rel=0.05)
        assert abs(proposed[name].value - true) < 2.0 * proposed[name].sigma
    model, record = fitted(unpacked("autopilot/drag_octa_true"))
    setting = {"EK3_DRAG_BCOEF_X": 17.209, "EK3_DRAG_BCOEF_Y": 17.209, "EK3_DRAG_MCOEF": 0.248}
    assert all(value.proposed.value is None for value in drag_values(model, [record], (4, 7), setting))


def proposals(log, record):
    setting = log.parameters_flown | {"MOT_THST_EXPO": record.vehicle.thrust_expo}
    proposed = thrust_values(fit_rigid_body([record]), [log], [record], setting)
    return {value.name.removeprefix("MOT_"): value for value in proposed}


def with_setting(record, **setting):
    return replace(record, vehicle=replace(record.vehicle, **setting))


@pytest.mark.parametrize(("wrong", "hover"), [(0.3, "less"), (0.65, "")])
def test_a_simulated_craft_of_065_flown_with_another_setting(wrong, hover):
    """The motors' pulses are the same whatever the setting: what it makes of them differs."""
    log, record = flown("sample_logs/octa05_nairobi_turns.bin")
    proposed = proposals(log, with_setting(record, thrust_expo=wrong))
    expo, throttle = proposed["THST_EXPO"].proposed, proposed["THST_HOVER"]
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
    proposed = proposals(log, replace(record, findings=(apart,)))
    assert all(value.proposed.value is None and "did not fly" in value.proposed.reason for value in proposed.values())


@pytest.mark.parametrize(("name", "flew"), [("minus", 0.30), ("right", 0.65)])
def test_firmware_flights_of_wrong_curves(unpacked, name, flew):
    """True curve 0.65; hover throttle 0.366 by the wrong setting, 0.284 by the right one."""
    log, record = flown(unpacked(f"autopilot/expo_quad15_{name}"))
    changes = proposals(log, record)
    assert changes["THST_EXPO"].now == pytest.approx(flew)
    assert changes["SPIN_MIN"].proposed.value is None
    assert "thrust begins" in changes["SPIN_MIN"].proposed.reason
    proposed = {key: value.proposed.value for key, value in changes.items() if value.proposed.value is not None}
    climb = {"PSC_ACCZ_P": 0.284, "PSC_ACCZ_I": 0.568}  # flown with the firmware's 0.5 and 1
    curve = {} if flew == 0.65 else {"THST_EXPO": 0.65, "THST_HOVER": 0.284}
    assert proposed == pytest.approx(climb | curve, abs=0.02)


def test_vibration_that_the_accelerometer_folds_changes_no_curve(unpacked):
    """Hover with small climbs says 0.58 ± 0.02 where 0.65 is true and flew: neither proposed nor called right."""
    proposed = proposals(*flown(unpacked("autopilot/vibration_octa8_off")))
    assert proposed["THST_EXPO"].proposed.value is None
    assert not proposed["THST_EXPO"].right
    assert proposed["THST_HOVER"].right


def test_thrust_that_begins_elsewhere_is_told_from_a_curve(unpacked):
    """MOT_SPIN_MIN 0.25 for motors that push from 0.15 on; the curve that goes with 0.15 is 0.65."""
    _, record = flown(unpacked("autopilot/expo_quad15_right"))
    wrong = with_setting(record, spin_min=0.25)
    meant, sigma, begin_sigma = believed(fit_rigid_body([wrong]), [wrong])
    assert meant.spin_min == pytest.approx(0.15, abs=4.0 * 0.8 * begin_sigma)
    assert meant.thrust_expo == pytest.approx(0.65, abs=2.0 * sigma)
