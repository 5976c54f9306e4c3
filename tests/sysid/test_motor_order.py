"""Motor outputs against what the mixer asks for: in which order, and back to its commands."""

from dataclasses import replace

import numpy as np
import pytest

from logparse import MissingDataError, Tables, Vehicle
from logparse.craft.frames import motor_table
from sysid.records.mixer import expectation, known_slope, mixer_differs, project, rounding
from sysid.records.motor_scaling import command_for, curve, curve_slope, motor_commands, motor_pwm
from sysid.rotors.motor_faults.outputs import check_outputs
from tests.timed import timed

QUAD_X = ("quad", "x")
FRAMES = [QUAD_X, ("octa", "plus")]

SECONDS, LOOP, EVERY, MOTORS = 60.0, 100.0, 2, 10
#: Angular acceleration of roll, pitch and yaw, rad/s^2 per unit of the controller's output.
GAIN = np.array([90.0, 80.0, 15.0])


def craft(frame):
    return Vehicle(
        motors=motor_table(*frame), pwm_min=1000.0, pwm_max=2000.0, spin_min=0.15, spin_max=0.95, thrust_expo=0.65
    )


def flown(vehicle, seed, yaw_gain=1.0, chirp=False):
    """Return a flight of a mixer with slow random commands: RATE at 50 Hz, motors in whole us at 10 Hz, gyro at 25 Hz.

    With a chirp, outputs move faster than motors are logged. What the craft does shows 0.03 s later, beside gusts.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(round(SECONDS * LOOP)) / LOOP
    kernel = np.exp(-np.arange(0.0, 3.0, 1.0 / LOOP))
    noise = rng.standard_normal((len(t) + len(kernel), 7))
    slow = np.column_stack([np.convolve(column, kernel, "same")[: len(t)] for column in noise.T]) / np.sqrt(LOOP)
    outputs = np.array([0.3, 0.0, 0.01, -0.01]) + 0.01 * slow[:, :4]
    if chirp:
        swept = np.sin(2.0 * np.pi * (1.0 * t + 0.5 * (14.0 / SECONDS) * t**2))
        for axis in range(3):
            third = (t >= axis * SECONDS / 3.0) & (t < (axis + 1) * SECONDS / 3.0)
            outputs[:, 1 + axis] += 0.03 * swept * third
    outputs += 0.001 * rng.standard_normal(outputs.shape)
    factors = np.array([[motor.roll, motor.pitch, motor.yaw] for motor in vehicle.motors])
    thrust = 1.05 * expectation(outputs * np.array([1.0, 1.0, 1.0, yaw_gain]), factors)
    pwm = np.array([[motor_pwm(command_for(float(one), 0.65), vehicle) for one in row] for row in thrust[::MOTORS]])
    moments = (outputs[:, 1:] + 0.002 * slow[:, 4:]) * GAIN
    rates = np.cumsum(np.roll(moments - moments.mean(axis=0), 3, axis=0), axis=0) / LOOP
    lift, roll, pitch, yaw = outputs[::EVERY].T
    x, y, z = (rates + 0.003 * rng.standard_normal(rates.shape))[:: 2 * EVERY].T
    return Tables(
        motors=timed(t[::MOTORS], **{f"m{k + 1}": pwm[:, k].round() for k in range(len(vehicle.motors))}),
        rates=timed(t[::EVERY], out_thrust=lift, out_roll=roll, out_pitch=pitch, out_yaw=yaw),
        imu=timed(t[:: 2 * EVERY], gyro_x=x, gyro_y=y, gyro_z=z),
    )


def without_thrust(tables):
    """Return what PIDR, PIDP and PIDY leave of the rate controller."""
    return tables.changed(rates=tables.rates.assign(out_thrust=np.nan))


def reordered(tables, order):
    return tables.changed(motors=tables.motors.iloc[:, list(order)].set_axis(tables.motors.columns, axis=1))


def orders(vehicle, seed):
    """Two swapped, all rotated by one, reversed."""
    count = len(vehicle.motors)
    swapped = list(range(count))
    i, j = np.random.default_rng(seed).choice(count, 2, replace=False)
    swapped[i], swapped[j] = swapped[j], swapped[i]
    return swapped, [*range(1, count), 0], list(range(count))[::-1]


def followed(findings, vehicle):
    """Return which motor of the mixer each output follows, from 0, by the one finding that says so."""
    (finding,) = findings
    assert finding.id == "motor-order"
    names = (finding.evidence[key].split(", ") for key in ("motors", "follow"))
    names_of = dict(zip(*names, strict=True))
    return [int(names_of.get(f"m{k + 1}", f"m{k + 1}")[1:]) - 1 for k in range(len(vehicle.motors))]


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("chirp", [False, True])
def test_another_order_is_found_and_named(frame, chirp):
    """A chirp aliases in outputs at 10 Hz: in their means another order looked as good as the right one."""
    vehicle = craft(frame)
    for seed in range(3):
        tables = flown(vehicle, seed, 0.8 if seed % 2 else 1.0, chirp)
        for seen in (tables, without_thrust(tables)):
            for order in orders(vehicle, seed):
                assert followed(check_outputs(reordered(seen, order), vehicle, 0.0, SECONDS), vehicle) == order


@pytest.mark.parametrize("frame", FRAMES)
def test_rates_as_slow_as_the_motors_tell_the_order_too(frame):
    vehicle = craft(frame)
    tables = flown(vehicle, 5)
    # Rows of the controller lie between those of the motors, as where both are logged by turns.
    slow = tables.changed(rates=tables.rates.iloc[3::5])
    assert not check_outputs(slow, vehicle, 0.0, SECONDS)
    for order in orders(vehicle, 5):
        assert followed(check_outputs(reordered(slow, order), vehicle, 0.0, SECONDS), vehicle) == order


def test_flights_in_order_raise_nothing():
    for seed in range(10):
        for frame in FRAMES:
            vehicle = craft(frame)
            tables = flown(vehicle, 100 + seed, 0.5 + 0.05 * seed, chirp=seed % 2 == 1)
            for seen in (tables, without_thrust(tables)):
                assert not check_outputs(seen, vehicle, 0.0, SECONDS)


def test_what_is_needed_is_said():
    vehicle = craft(QUAD_X)
    tables = flown(vehicle, 1)
    with pytest.raises(MissingDataError, match="RATE"):
        check_outputs(tables.changed(rates=None), vehicle, 0.0, SECONDS)
    with pytest.raises(MissingDataError, match="frame"):
        check_outputs(tables, Vehicle(), 0.0, SECONDS)
    with pytest.raises(MissingDataError, match="only"):
        check_outputs(tables, vehicle, 0.0, 8.0)


@pytest.mark.parametrize("value", [1e200, np.nan])
def test_a_number_that_no_controller_gives_costs_its_row_alone(value):
    """A flipped bit makes 0.01 to 1e200: three garbled logs in sixty ended in an error of the solver."""
    vehicle = craft(QUAD_X)
    tables = flown(vehicle, 1)
    for name in ("out_roll", "out_thrust"):
        rates = tables.rates.copy()
        rates.iloc[400, rates.columns.get_loc(name)] = value
        assert not check_outputs(tables.changed(rates=rates), vehicle, 0.0, SECONDS)


@pytest.mark.parametrize("expo", [0.2, 0.65, 0.95])
def test_a_curve_that_did_not_fly_is_measured_by_what_it_makes_of_outputs(expo):
    """With MOT_THST_EXPO 0.35 off in the log, gains of rotation were 15 to 27 % off (5 standard errors)."""
    flew = craft(QUAD_X)
    tables = flown(flew, 3, chirp=True)
    finding = mixer_differs(tables, replace(flew, thrust_expo=expo), 0.0, SECONDS)
    command = float(motor_commands(tables.motors.to_numpy(), flew).mean())

    def stiffness(e):
        return float(curve_slope(np.array(command), e) / curve(np.array(command), e))

    if expo == flew.thrust_expo:
        assert not finding
    else:
        assert known_slope(finding) == pytest.approx(stiffness(expo) / stiffness(flew.thrust_expo), rel=0.02)
        assert "MOT_THST_EXPO" in finding[0].reason


def test_a_controller_that_motors_do_not_follow_says_nothing_of_the_curve():
    tables = flown(craft(QUAD_X), 4, chirp=True)
    noisy = tables.rates + 0.05 * np.random.default_rng(0).standard_normal(tables.rates.shape)
    assert not mixer_differs(tables.changed(rates=noisy), replace(craft(QUAD_X), thrust_expo=0.2), 0.0, SECONDS)
    assert not mixer_differs(without_thrust(tables), replace(craft(QUAD_X), thrust_expo=0.2), 0.0, SECONDS)


COMMANDS = {"thrust": (0.4, 0.05), "roll": (0.0, 0.04), "pitch": (0.01, 0.04), "yaw": (0.0, 0.06)}


def framed(frame_class, frame_type, **changes):
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
    return wanted, timed(t, **motors)


@pytest.mark.parametrize(
    ("frame_class", "frame_type"),
    [("quad", "x"), ("hexa", "plus"), ("octa", "plus"), ("octa", "v"), ("octa-quad", "x"), ("y6", "y6b")],
)
def test_commands_of_every_frame_come_back(frame_class, frame_type):
    vehicle = framed(frame_class, frame_type, pwm_min=1100.0, pwm_max=1900.0, thrust_expo=0.5)
    wanted, motors = mixed(vehicle)
    commands = project(motors, vehicle, None)
    assert list(commands) == list(wanted)
    for name, values in wanted.items():
        np.testing.assert_allclose(commands[name], values, atol=1e-12)


def test_a_sagging_battery_is_no_thrust():
    """The autopilot raises PWM by the inverse of the voltage (MOT_BAT_VOLT_MAX), so that thrust stays."""
    vehicle = framed("octa", "x", battery_voltage_max=25.2, battery_voltage_min=19.8)
    wanted, motors = mixed(vehicle, voltage_ratio=0.85)
    commands = project(motors, vehicle, np.full(len(motors), 0.85 * 25.2))
    np.testing.assert_allclose(commands["thrust"], wanted["thrust"], atol=1e-12)
    without = project(motors, framed("octa", "x"), np.full(len(motors), 0.85 * 25.2))
    assert (without["thrust"] > commands["thrust"]).all()


def test_patterns_that_no_command_makes_are_not_seen():
    """An octocopter has four of them: thrusts that add up to no force and no moment."""
    vehicle = framed("octa", "plus", thrust_expo=0.0)
    wanted, motors = mixed(vehicle)
    factors = np.array([[1.0, motor.roll, motor.pitch, motor.yaw] for motor in vehicle.motors])
    unseen = np.linalg.svd(factors.T)[2][4:]
    commands = project(motors + 20.0 * unseen.sum(axis=0), vehicle, None)
    np.testing.assert_allclose(commands["roll"], wanted["roll"], atol=1e-12)


def test_a_tricopter_makes_no_yaw_with_its_motors():
    vehicle = framed("tri", None)
    motors = timed([0.0, 0.1], **{f"m{m.number}": [1400.0, 1500.0] for m in vehicle.motors})
    assert list(project(motors, vehicle, None)) == ["thrust", "roll", "pitch"]


def test_what_is_missing_is_named():
    vehicle = framed("quad", "x")
    _, motors = mixed(vehicle)
    with pytest.raises(MissingDataError, match=r"no output is logged for m3.*SERVOn_FUNCTION"):
        project(motors.drop(columns="m3"), vehicle, None)
    with pytest.raises(MissingDataError, match="FRAME_CLASS"):
        project(motors, Vehicle(), None)


def test_rounding_to_a_microsecond_leaves_the_noise_it_says():
    vehicle = framed("quad", "x")
    wanted, motors = mixed(vehicle, samples=4000)
    commands = project(motors.round(), vehicle, None)
    said = rounding(motors.round(), vehicle)
    for name, sigma in said.items():
        assert np.std(commands[name] - wanted[name]) == pytest.approx(sigma, rel=0.1)
    assert rounding(motors, vehicle) == {}
