"""Commands of the mixer from motor outputs: against the autopilot's own formulae, run forwards."""

import numpy as np
import pandas as pd
import pytest

from logparse import MissingDataError, Vehicle
from logparse.craft.frames import motor_table
from sysid.records.mixer import project, rounding

COMMANDS = {"thrust": (0.4, 0.05), "roll": (0.0, 0.04), "pitch": (0.01, 0.04), "yaw": (0.0, 0.06)}


def craft(frame_class, frame_type, **changes):
    arguments = {"frame_class": frame_class, "frame_type": frame_type} | changes
    return Vehicle(motors=motor_table(frame_class, frame_type, {}), **arguments)


def mixed(vehicle, samples=200, voltage_ratio=1.0):
    """Mix random commands as AP_MotorsMatrix and AP_Motors_Thrust_Linearization do; PWM not rounded."""
    rng = np.random.default_rng(5)
    wanted = {name: mean + size * rng.uniform(-1.0, 1.0, samples) for name, (mean, size) in COMMANDS.items()}
    t = np.arange(samples) * 0.1
    motors = {}
    e = vehicle.thrust_expo
    for motor in vehicle.motors:
        thrust = wanted["thrust"] + motor.roll * wanted["roll"] + motor.pitch * wanted["pitch"]
        thrust = thrust + motor.yaw * wanted["yaw"]
        ratio = (e - 1.0 + np.sqrt((1.0 - e) ** 2 + 4.0 * e * thrust)) / (2.0 * e) if e else thrust
        actuator = vehicle.spin_min + (vehicle.spin_max - vehicle.spin_min) * ratio / voltage_ratio
        motors[f"m{motor.number}"] = vehicle.pwm_min + (vehicle.pwm_max - vehicle.pwm_min) * actuator
    return wanted, pd.DataFrame(motors, index=pd.Index(t, name="t"))


@pytest.mark.parametrize(
    ("frame_class", "frame_type"),
    [("quad", "x"), ("hexa", "plus"), ("octa", "plus"), ("octa", "v"), ("octa-quad", "x"), ("y6", "y6b")],
)
def test_commands_of_every_frame_come_back(frame_class, frame_type):
    vehicle = craft(frame_class, frame_type, pwm_min=1100.0, pwm_max=1900.0, thrust_expo=0.5)
    wanted, motors = mixed(vehicle)
    found = project(motors, vehicle, None)
    assert list(found) == list(wanted)
    for name, values in wanted.items():
        np.testing.assert_allclose(found[name], values, atol=1e-12)


def test_a_sagging_battery_is_no_thrust():
    """The autopilot raises PWM by the inverse of the voltage (MOT_BAT_VOLT_MAX), so that thrust stays."""
    vehicle = craft("octa", "x", battery_voltage_max=25.2, battery_voltage_min=19.8)
    wanted, motors = mixed(vehicle, voltage_ratio=0.85)
    found = project(motors, vehicle, np.full(len(motors), 0.85 * 25.2))
    np.testing.assert_allclose(found["thrust"], wanted["thrust"], atol=1e-12)
    without = project(motors, craft("octa", "x"), np.full(len(motors), 0.85 * 25.2))
    assert (without["thrust"] > found["thrust"]).all()


def test_patterns_that_no_command_makes_are_not_seen():
    """An octocopter has four of them: thrusts that add up to no force and no moment."""
    vehicle = craft("octa", "plus", thrust_expo=0.0)
    wanted, motors = mixed(vehicle)
    factors = np.array([[1.0, motor.roll, motor.pitch, motor.yaw] for motor in vehicle.motors])
    unseen = np.linalg.svd(factors.T)[2][4:]
    found = project(motors + 20.0 * unseen.sum(axis=0), vehicle, None)
    np.testing.assert_allclose(found["roll"], wanted["roll"], atol=1e-12)


def test_a_tricopter_makes_no_yaw_with_its_motors():
    vehicle = craft("tri", None)
    motors = pd.DataFrame({f"m{m.number}": [1400.0, 1500.0] for m in vehicle.motors}, index=[0.0, 0.1])
    assert list(project(motors, vehicle, None)) == ["thrust", "roll", "pitch"]


def test_what_is_missing_is_named():
    vehicle = craft("quad", "x")
    _, motors = mixed(vehicle)
    with pytest.raises(MissingDataError, match=r"no output is logged for m3.*SERVOn_FUNCTION"):
        project(motors.drop(columns="m3"), vehicle, None)
    with pytest.raises(MissingDataError, match="FRAME_CLASS"):
        project(motors, Vehicle(), None)


@pytest.mark.parametrize("frame_class", ["quad", "octa"])
def test_rounding_to_a_microsecond_leaves_the_noise_it_says(frame_class):
    vehicle = craft(frame_class, "x")
    wanted, motors = mixed(vehicle, samples=4000)
    found = project(motors.round(), vehicle, None)
    said = rounding(motors.round(), vehicle)
    for name, sigma in said.items():
        assert np.std(found[name] - wanted[name]) == pytest.approx(sigma, rel=0.1)
    assert rounding(motors, vehicle) == {}
