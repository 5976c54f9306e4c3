"""EKF3's drag from flight: the right ones of firmware craft, in the firmware's definition, else nothing."""

import json
import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from estimation import estimate
from logparse import read_log
from sysid import Experiment, fit_rigid_body
from sysid.autopilot.drag import drag_values
from sysid.records.thrust_curve import relative_density


@cache
def fitted(path):
    log = read_log(path)
    record = Experiment.from_flight(log, estimate(log.tables, date=log.start_utc), 50.0)
    return fit_rigid_body([record]), record


def values(model, record, version=(4, 7)):
    return {each.name.removeprefix("EK3_DRAG_"): each.proposed for each in drag_values(model, [record], version, {})}


def test_of_a_simulated_craft():
    """The relocations of octa11 at 6 m/s: every coefficient within two of its sigmas of the truth."""
    found = values(*fitted("sample_logs/octa11_sydney_fast.bin"))
    craft = json.loads(Path("sample_logs/octa11_sydney_fast.json").read_text())["vehicle"]
    mass, area, linear = craft["mass_kg"], craft["drag_area_m2"], craft["drag_linear_n_s_m"]
    truth = {"BCOEF_X": mass / area[0], "BCOEF_Y": mass / area[1], "MCOEF": linear[0] / mass}
    for name, true in truth.items():
        assert abs(found[name].value - true) < 2.0 * found[name].sigma, name
        assert found[name].sigma < 0.35 * true


@pytest.mark.parametrize("version", [(4, 7), (4, 5)])
def test_at_the_density_flown_ekf3_computes_the_deceleration_of_the_craft(version):
    """AP_NavEKF3_AirDataFusion: rho u^2 / (2 BCOEF) + MCOEF r u; r: density's since 4.7, EAS2TAS^0.5 before."""
    model, record = fitted("sample_logs/octa11_sydney_fast.bin")
    found = values(model, record, version)
    s = float(np.median(relative_density(record)))
    r = s if version == (4, 7) else math.sqrt(s**-0.5)
    linear = math.sqrt(s) if model.rotor_drag else s
    for axis in "xy":
        quadratic = 1.225 * r / (2.0 * found[f"BCOEF_{axis.upper()}"].value)
        assert quadratic == pytest.approx(s * model.value(f"drag_quadratic_{axis}"), rel=0.35)
        total = model.value(f"drag_linear_{axis}") * linear * 5.0 + s * model.value(f"drag_quadratic_{axis}") * 25.0
        assert found["MCOEF"].value * r * 5.0 + quadratic * 25.0 == pytest.approx(total, rel=0.05)


def test_a_wind_that_turns_and_a_flight_without_speed_are_named():
    model, record = fitted("sample_logs/octa11_sydney_fast.bin")
    trim = model.flights[record.name]
    veered = tuple((float(t), 2.0 * k, 0.0) for k, t in enumerate(np.linspace(record.t[0], record.t[-1], 4)))
    turned = replace(model, flights={record.name: replace(trim, variation=veered)})
    assert all(
        each.value is None and "the wind changed by 4.0 m/s" in each.reason for each in values(turned, record).values()
    )
    still = values(*fitted("sample_logs/octa07_singapore_hot.bin"))
    assert all(each.value is None and "EKF3's wind would err" in each.reason for each in still.values())


def test_a_flight_of_the_firmware_without_drag_tells_the_right_ones(unpacked):
    """EKF3 knew no wind there; with the right ones it errs by 0.13 m/s, with the simulator's hint by 0.49."""
    model, record = fitted(unpacked("autopilot/drag_octa_off"))
    found = values(model, record)
    for name, true in {"BCOEF_X": 17.21, "BCOEF_Y": 17.21, "MCOEF": 0.254}.items():
        assert found[name].value == pytest.approx(true, rel=0.05)
        assert abs(found[name].value - true) < 2.0 * found[name].sigma
    assert all(each.proposed.value is None for each in drag_values(*_flown(unpacked("autopilot/drag_octa_true"))))


def _flown(path):
    model, record = fitted(path)
    return model, [record], (4, 7), {"EK3_DRAG_BCOEF_X": 17.209, "EK3_DRAG_BCOEF_Y": 17.209, "EK3_DRAG_MCOEF": 0.248}
