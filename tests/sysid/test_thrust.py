"""Thrust per command and sag of the battery: simulated truth and honest silence (firmware: test_physical)."""

from dataclasses import replace

import numpy as np
import pytest

from logparse import MissingDataError, Vehicle
from simulation.elhesasy2024 import octocopter
from sysid import Experiment, ExperimentError, fit_thrust
from sysid.records.motor_scaling import motor_commands
from sysid.records.thrust_curve import Law, thrust_signals
from sysid.rotors.battery import sag_resistance
from sysid.rotors.thrust_regression import AIR_SIGMA
from tests.sysid.craft_flights import of_craft

CRAFT = Vehicle(pwm_min=1000.0, pwm_max=2000.0, spin_min=0.15, spin_max=0.95, thrust_expo=0.6)


def flight(
    seed=0,
    samples=1200,
    per_mass=(3.2, 3.2, 3.2, 3.2),
    density=1.1,
    spread=0.05,
    vehicle=CRAFT,
    recorded_density=None,
    **context,
):
    """Make a level flight whose motors follow four independent slow signals, thrust by the autopilot's curve."""
    rng = np.random.default_rng(seed)
    t = np.arange(samples) * 0.1
    slow = np.cumsum(rng.standard_normal((samples, 4)), axis=0)
    slow = slow - slow.mean(axis=0)
    c = np.clip(0.75 + spread * slow / slow.std(axis=0), 0.05, 0.95)
    pwm = 1000.0 + 1000.0 * (0.15 + c * 0.8)
    thrust = density / 1.225 * (0.4 * c + 0.6 * c**2)
    force = -thrust @ np.array(per_mass) + 0.05 * rng.standard_normal(samples)
    columns = dict.fromkeys(("roll", "pitch", "yaw", "v_n", "v_e", "v_d"), 0.0)
    columns |= {
        "f_z": force,
        "density": density if recorded_density is None else recorded_density,
        "voltage": 16.0,
    } | context
    return of_craft(t, pwm, np.zeros((samples, 3)), columns, vehicle, f"flight {seed}")


def test_common_coefficient_within_its_standard_error():
    model = fit_thrust([flight(1), flight(2)], mass=2.0)
    assert abs(model.common.per_mass - 3.2) < 4.0 * model.common.sigma
    assert model.common.sigma < 0.005 * 3.2
    assert model.air_sigma == pytest.approx(AIR_SIGMA)
    assert model.common.newton == pytest.approx(2.0 * model.common.per_mass)


def test_standard_errors_are_those_of_repetition():
    """Forty flights in one air: their spread is what each claims to a factor of 2.5, with slow wandering in it."""
    models = [fit_thrust([flight(seed)]) for seed in range(40)]
    spread = np.std([model.common.per_mass for model in models])
    claimed = np.sqrt(np.mean([model.common.sigma**2 for model in models]))
    assert claimed / 2.5 < spread < claimed


def test_motors_that_move_as_one_have_one_coefficient():
    made = flight(4)
    c = motor_commands(made.u[:, 0], CRAFT)
    context = made.context.assign(f_z=-4 * 3.2 * 1.1 / 1.225 * (0.4 * c + 0.6 * c**2))
    as_one = Experiment.from_arrays(made.t, np.repeat(made.u[:, :1], 4, axis=1), made.y, context=context, vehicle=CRAFT)
    model = fit_thrust([as_one])
    assert model.common.per_mass == pytest.approx(3.2, rel=1e-6)


def test_voltage_sag_does_not_change_the_coefficient():
    """A battery that sags by 10 %, rotors as the simulator drives them: k at the median voltage stays."""
    voltage = np.linspace(16.8, 15.2, 1200)
    made = flight(5, voltage=voltage)
    drive = replace(octocopter().drive, spin_min=0.15, spin_max=0.95, expo=0.6, pwm_min=1000.0, pwm_max=2000.0)
    speeds = [[drive.speed(pwm, volts) for pwm in row] for row, volts in zip(made.u, voltage, strict=True)]
    part = (np.array(speeds) / drive.speed(1950.0, 16.0)) ** 2
    model = fit_thrust([replace(made, context=made.context.assign(f_z=-3.2 * 1.1 / 1.225 * part.sum(axis=1)))])
    assert model.common.per_mass == pytest.approx(3.2, rel=1e-3)
    assert model.reference_voltage == pytest.approx(16.0)


@pytest.mark.parametrize("part", [0.25, 0.4, 0.5])
def test_thrust_follows_the_voltage_as_a_motor_s_does(part):
    """A DC motor (920 rpm/V, 0.09 ohm) against its propeller (1e-5 N s^2, 1.5e-7 N m s^2), from 16.8 to 14.3 V.

    With V inside the curve, as the autopilot compensates it, thrust at one output would be 6 to 10 % too large.
    """
    back = 60.0 / (2.0 * np.pi * 920.0)
    loss = 0.09 * 1.5e-7 / back

    def thrust(duty, volts):
        return 1e-5 * ((np.sqrt(back**2 + 4.0 * loss * volts * duty) - back) / (2.0 * loss)) ** 2

    duty = np.linspace(0.1, 0.95, 400)
    hover = np.interp(part, thrust(duty, 16.8) / thrust(0.95, 16.8), duty)
    made = flight(1, samples=12, voltage=np.repeat([16.8, 14.3], 6))
    constant = replace(made, u=np.full((12, 4), 1000.0 + 1000.0 * hover))
    signals = thrust_signals(constant, Law.COMMAND, replace(CRAFT, spin_min=0.1), 16.8)
    assert signals[-1, 0] / signals[0, 0] == pytest.approx(thrust(hover, 14.3) / thrust(hover, 16.8), rel=0.035)


def test_what_is_not_known_is_said():
    findings = fit_thrust([flight(6, density=np.nan, f_z=-9.8, vehicle=None, voltage=np.nan)]).findings
    assert {"conditions-assumed", "frame-unknown"} <= {f.id for f in findings}
    assumed = " ".join(f.reason for f in findings if f.id == "conditions-assumed")
    assert "density of the air is unknown" in assumed
    assert "without battery voltage" in assumed


def test_bad_input_is_refused():
    with pytest.raises(MissingDataError, match="accelerometer"):
        fit_thrust([flight(7, f_z=np.nan)])
    with pytest.raises(ExperimentError, match="mass must be positive"):
        fit_thrust([flight(7)], mass=0.0)
    with pytest.raises(ExperimentError, match="too few"):
        fit_thrust([flight(7, samples=60)])
    with pytest.raises(ExperimentError, match="too few"):  # less than a block
        fit_thrust([flight(7, samples=9)])


def test_hover_command_carries_the_weight():
    model = fit_thrust([flight(8)])
    c = model.hover_command
    assert 4 * 3.2 * 1.1 / 1.225 * (0.4 * c + 0.6 * c**2) == pytest.approx(9.80665, rel=1e-3)
    assert motor_commands(np.array(model.hover_pwm), CRAFT) == pytest.approx(c)


def test_flights_that_disagree_widen_the_standard_error():
    """k/m of three flights scatters by 10 %: the standard error of the mean is a tenth over the root of three."""
    model = fit_thrust([flight(k, per_mass=(3.2 * f,) * 4) for k, f in ((1, 0.96), (2, 1.0), (3, 1.04))])
    assert 3.2 * 0.04 / np.sqrt(3.0) < model.common.sigma < 3.2 * 0.08


def test_a_drift_that_no_voltage_explains_is_no_scatter_that_averages():
    """A battery whose voltage is not logged sank by a tenth in real flights; halves differed by seven stated sigmas."""
    made = flight(14, samples=3000)
    sinks = made.context["f_z"] * np.linspace(1.05, 0.95, len(made.t))
    sunk = replace(made, context=made.context.assign(f_z=sinks))
    one, other = (fit_thrust([part]).common for part in sunk.split(0.5))
    assert abs(one.per_mass - other.per_mass) < 2.0 * np.hypot(one.sigma, other.sigma)
    assert one.sigma < 0.05 * one.per_mass


def test_air_that_presses_on_a_leaning_craft_widens_the_standard_error():
    """A craft of 0.8 kg that leant by 0.35 rad into 8 m/s came out 12 % too weak at a stated 3.6 %."""
    made = flight(14)
    leant = replace(made, context=made.context.assign(f_x=0.35 * made.context["f_z"], f_y=0.0))
    sigma = fit_thrust([leant]).common.sigma
    assert sigma == pytest.approx(3.2 * 0.35**2, rel=0.05)


@pytest.mark.parametrize("change", [0.8, 1.05])
def test_a_load_that_is_dropped_in_flight_is_named(change):
    """After a fifth of the mass was dropped a flight was healthy, with no event, and thrust 25 % off for its rest."""
    made = flight(15, samples=3000)
    half = len(made.t) // 2
    force = made.context["f_z"].to_numpy() * np.where(np.arange(len(made.t)) < half, 1.0, change)
    voltage = np.full(len(made.t), 16.0)
    model = fit_thrust([replace(made, context=made.context.assign(f_z=force, voltage=voltage))])
    findings = [finding for finding in model.findings if finding.id == "thrust-changed-in-flight"]
    assert len(findings) == (abs(change - 1.0) > 0.12)
    if findings:
        assert findings[0].evidence["change"] == pytest.approx(change - 1.0, abs=0.02)
        assert findings[0].evidence["time"] == pytest.approx(made.t[half], abs=1.5)


def test_unknown_air_widens_the_standard_error():
    """Flown at 1000 m (1.112 kg/m^3) without barometer and altitude: the truth is within two standard errors."""
    model = fit_thrust([flight(12, density=1.112, recorded_density=np.nan)])
    on_another_day = np.hypot(model.common.sigma, model.air_sigma * model.common.per_mass)
    assert on_another_day > 0.1 * model.common.per_mass
    assert abs(model.common.per_mass - 3.2) < 2.0 * on_another_day


TRUTH = 0.021


def pack(seed: int, *, changes: float = 4.0, current_noise: float = 0.5, voltage_noise: float = 0.03):
    """Fly on a pack with a curved open-circuit voltage; sensors have white noise, gusts move the current."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 180.0, 0.1)
    keep = np.exp(-0.1 / 1.5)
    load = np.zeros(len(t))
    for k in range(1, len(t)):
        load[k] = keep * load[k - 1] + np.sqrt(1.0 - keep**2) * rng.normal(0.0, changes)
    current = 18.0 + load
    drawn = np.cumsum(current) * 0.1 / (18.0 * 180.0)
    voltage = 16.6 - 1.4 * drawn + 0.5 * np.exp(-drawn / 0.1) - TRUTH * current
    return t, voltage + rng.normal(0.0, voltage_noise, len(t)), current + rng.normal(0.0, current_noise, len(t))


def test_errors_are_as_large_as_sigma_says():
    resistances = [sag_resistance(*pack(seed)) for seed in range(40)]
    errors = np.array([(resistance.value - TRUTH) / resistance.sigma for resistance in resistances])
    assert 0.7 < np.sqrt(np.mean(errors**2)) < 1.4
    assert abs(np.mean(errors)) < 0.5
    assert np.median([resistance.sigma for resistance in resistances]) < 0.1 * TRUTH


def test_noise_of_the_current_sensor_does_not_make_it_small():
    resistances = [sag_resistance(*pack(seed, current_noise=4.0)).value for seed in range(10)]
    assert np.mean(resistances) == pytest.approx(TRUTH, rel=0.05)


def test_what_nothing_shows_is_not_stated():
    steady = sag_resistance(*pack(1, changes=0.02))
    assert steady.value is None
    assert "hardly changes" in steady.reason
    t, voltage, current = pack(1)
    assert "no sensor" in sag_resistance(t, voltage, np.zeros(len(t))).reason
    assert "not logged" in sag_resistance(t[:9], voltage[:9], current[:9]).reason
