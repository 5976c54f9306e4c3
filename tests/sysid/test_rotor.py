"""Rotor model from flight: which law, which curve, which lag, which motor, on craft of known truth."""

from dataclasses import replace

import numpy as np
import pytest

from logparse import MissingDataError
from simulation.elhesasy2024 import octocopter
from simulation.kim2017 import quadcopter
from sysid.records.thrust_curve import Law
from sysid.rotors.kim2017 import fit_kim2017
from sysid.rotors.rotor import fit_rotor
from tests.sysid.simulated_craft import flight, without


@pytest.fixture(scope="module")
def octo():
    return flight(octocopter(), 1)


def ids(model):
    return {finding.id for finding in model.findings}


def test_rotor_speeds_give_the_coefficient(octo):
    """Table 2 of Elhesasy 2024: k 1.105e-5 N s^2."""
    model = fit_rotor([octo], mass=4.3)
    assert model.law is Law.SPEED
    assert model.common.newton == pytest.approx(1.105e-5, rel=0.01)
    assert abs(model.common.newton - 1.105e-5) < 2.0 * model.common.newton_sigma
    assert not any(value.determined for value in model.per_motor.values())
    assert "too alike" in model.per_motor["m1"].reason


def test_command_curve_and_lag_are_identified():
    """From PWM alone: curvature 0.65, lag 40 ms and the 5 ms for which commands were held on average."""
    craft = octocopter()
    records = [flight(craft, seed, speeds=False, climb=1.0) for seed in (1, 2)]
    model = fit_rotor(records, mass=4.3)
    assert model.law is Law.COMMAND
    assert abs(model.expo.value - 0.65) < 3.0 * model.expo.sigma
    assert model.expo.value == pytest.approx(0.65, abs=0.03)
    assert model.time_constant.value == pytest.approx(0.045, abs=0.005)
    assert model.common.newton == pytest.approx(1.105e-5 * 1050.0**2, rel=0.03)


def test_another_curve_than_the_autopilot_s_is_found(octo):
    """The autopilot believes 0.2 where thrust bends by 0.65; PWM itself tells."""
    told = replace(octo, vehicle=replace(octo.vehicle, thrust_expo=0.2))
    model = fit_rotor([without(told, *[f"rotor_speed_{k}" for k in range(1, 9)])])
    assert model.thrust_expo == pytest.approx(0.65, abs=0.05)
    assert "thrust-differs" in ids(model)


def test_esc_numbers_that_are_the_command_are_no_rotor_speeds(octo):
    """ArduPilot's simulator reports command times a constant: thrust must not be taken for its square."""
    command = (octo.u - 1150.0) / 800.0
    context = octo.context.assign(**{f"rotor_speed_{k + 1}": 700.0 * command[:, k] for k in range(8)})
    model = fit_rotor([replace(octo, context=context)], mass=4.3)
    assert model.law is Law.COMMAND
    assert "not-logged" in ids(model)
    assert model.common.newton == pytest.approx(1.105e-5 * 1050.0**2, rel=0.03)


def test_in_stabilised_flight_the_weak_motor_shows_in_kim_2017():
    """Vertical force alone does not tell motors apart that a controller moves together; rates do."""
    craft, thrust = quadcopter(16.0), (2.8e-5, 2.8e-5, 2.1e-5, 2.8e-5)
    mounts = [
        replace(mount, rotor=replace(mount.rotor, thrust_coefficient=k))
        for mount, k in zip(craft.rotors, thrust, strict=True)
    ]
    record = flight(replace(craft, inertia=craft.inertia / 100.0, rotors=tuple(mounts)), 3)
    model = fit_rotor([record], mass=2.6)
    assert not any(value.determined for value in model.per_motor.values())
    found = fit_kim2017([record], 2.6)
    assert [each.newton for each in found.per_motor.values()] == pytest.approx(thrust, rel=0.03)


def test_what_is_missing_is_said(octo):
    hover = flight(octocopter(), 5, duration=30.0, strength=0.02, speeds=False)
    model = fit_rotor([hover])
    assert model.expo.value is None
    assert "autopilot's curve" in model.expo.reason
    assert model.time_constant.value is None
    assert model.common.determined
    assert "conditions-assumed" in ids(model)
    blind = replace(octo, context=octo.context.assign(voltage=np.nan, density=np.nan))
    assumed = " ".join(f.reason for f in fit_rotor([blind]).findings if f.id == "conditions-assumed")
    assert "density of the air is unknown" in assumed
    assert "without battery voltage" in assumed
    with pytest.raises(MissingDataError, match="accelerometer"):
        fit_rotor([without(octo, "f_z")])
