"""Rates and outputs of the rate loop as logs have them: slow rows, noise alone, and the air that gains share."""

from dataclasses import replace

import numpy as np
import pytest

from logparse import Finding, Severity, Vehicle
from logparse.craft.frames import motor_table
from sysid.records.mixer import MIXER_DIFFERS
from sysid.records.motor_scaling import command_for
from sysid.records.motor_signals import motor_signals
from sysid.records.resampling import join_rows, logged_rate
from sysid.records.thrust_curve import Law, lagged
from sysid.rigid_body.body_parameters import RELATIVE, gain_error, held_against_torque, rotation_doubt
from sysid.rigid_body.model_record import BodyParameter
from sysid.rigid_body.rotation import AxisFit, RotationFit, fit_rotation
from tests.sysid.craft_flights import of_craft

QUAD = Vehicle(frame_class="quad", frame_type="x", motors=motor_table("quad", "x"), thrust_expo=0.0)
FINE, LAG, DELAY, GAIN = 0.0025, 0.035, 0.0125, 60.0


def hovering(outputs, rates, rate):
    """Return a record at 50 Hz of a quadcopter whose RATE had `rate` rows a second, of columns at 400 Hz."""
    fine = np.arange(len(outputs)) * FINE
    t, at = np.arange(0.0, fine[-1], 0.02), np.arange(0.004, fine[-1], 1.0 / rate)
    columns = {}
    for k, (output, axis) in enumerate(zip(("roll", "pitch", "yaw"), "xyz", strict=True)):
        for name, values in ((f"out_{output}", outputs), (f"rate_{axis}", rates)):
            columns[name] = np.interp(t, at, np.interp(at, fine, values[:, k]))
    columns |= {f"w_{axis}": columns[f"rate_{axis}"] for axis in "xyz"}
    columns |= {"density": np.full(len(t), 1.225), "voltage": np.full(len(t), 16.0), "out_thrust": np.full(len(t), 0.4)}
    # Thrust of 0.4 on a straight curve.
    pwm = np.full((len(t), 4), 1000.0 + 1000.0 * (0.15 + 0.4 * 0.8))
    return of_craft(t, pwm, np.zeros((len(t), 3)), columns, QUAD, "hover")


def chirped(rate):
    """Chirp each axis from 0.5 to 7 Hz, and turn as a lag, a delay and the levers of the frame make it."""
    t = np.arange(0.0, 60.0, FINE)
    outputs, rates = np.zeros((len(t), 3)), np.zeros((len(t), 3))
    for k in range(3):
        inside = (t > 20.0 * k) & (t < 20.0 * k + 18.0)
        swept = t[inside] - t[inside][0]
        growth = np.log(14.0) / 18.0
        outputs[inside, k] = 0.08 * np.sin(2.0 * np.pi * 0.5 * np.expm1(growth * swept) / growth)
        torque = lagged(np.interp(t - DELAY, t, outputs[:, k]), LAG, FINE)
        levers = 4.0 * np.sqrt(0.5) * 0.5 if k < 2 else 4.0 * 0.5
        rates[:, k] = np.cumsum(GAIN * levers * torque) * FINE
    rates += 2e-3 * np.random.default_rng(3).standard_normal(rates.shape)
    return hovering(outputs, rates, rate)


def test_methods_take_the_mixer_that_flew():
    """With MOT_THST_EXPO wrong in the log alone Kim's and Refinement's inertia kept the mixer's error."""
    record = chirped(50.0)
    finding = Finding(MIXER_DIFFERS, Severity.WARNING, "", "", {"slope": 1.2})
    plain, warned = (
        motor_signals(data, Law.COMMAND, data.vehicle, 16.0, 0.0).signals
        for data in (record, replace(record, findings=(*record.findings, finding)))
    )
    mean = plain.mean(axis=1, keepdims=True)
    np.testing.assert_allclose(warned - mean, 1.2 * (plain - mean), atol=1e-9)


def test_the_rate_of_rows_shows_in_the_straight_lines_between_them():
    rng, t = np.random.default_rng(1), np.arange(0.0, 20.0, 0.02)
    for rate in (10.0, 7.0, 50.0):
        at = np.arange(0.007, 20.0, 1.0 / rate)
        values = np.interp(t, at, rng.standard_normal(len(at)))
        assert logged_rate(values[:, None], 0.02) == pytest.approx(rate, rel=0.1)
    assert logged_rate(np.zeros((100, 1)), 0.02) == pytest.approx(50.0)


@pytest.mark.parametrize(("rate", "within"), [(50.0, 0.015), (10.0, 0.04)])
def test_slow_rows_tell_effectiveness_below_where_they_fold(rate, within):
    """Up to 10 Hz, above half of the rate of the rows, gains came out 4 to 10 % too small at a stated 2 to 6 %."""
    record = chirped(rate)
    rotation = fit_rotation([record], record.vehicle, 16.0)
    for axis in ("roll", "pitch"):
        assert rotation.axes[axis].gain == pytest.approx(GAIN, rel=within)
    assert motor_signals(record, Law.COMMAND, record.vehicle, 16.0, 0.0).fast == (rate > 20.0)


@pytest.mark.parametrize("expo", [0.0, 0.65])
def test_a_low_battery_is_no_weaker_craft(expo):
    """At 15.2 V motors turn the craft by (15.2 / 16)^2; the gain is that at 16 V, whatever the curve."""
    record, volts = chirped(50.0), 15.2
    context = record.context.assign(voltage=volts)
    context[["rate_x", "rate_y", "rate_z"]] *= (volts / 16.0) ** 2
    # Thrust of 0.4 by the curve: what the controller asks for is what the motors are told.
    pwm = np.full((len(record.t), 4), 1000.0 + 1000.0 * (0.15 + 0.8 * command_for(0.4, expo)))
    low = replace(record, u=pwm, context=context, vehicle=replace(record.vehicle, thrust_expo=expo))
    rotation = fit_rotation([low], low.vehicle, 16.0)
    for axis in ("roll", "pitch"):
        assert rotation.axes[axis].gain == pytest.approx(GAIN, rel=0.015)
    signals = motor_signals(low, Law.COMMAND, low.vehicle, 16.0, expo).signals
    assert signals.mean() == pytest.approx(0.4 * (volts / 16.0) ** 2, rel=1e-3)


def test_a_controller_that_answers_to_noise_shows_in_a_craft_driven_by_its_own_rate():
    """In calm hovers of four craft yaw torque over inertia came out nine times too large at a stated 9 %."""
    seen = AxisFit(
        gain=43.1,
        gain_sigma=0.7,
        damping=-37.0,
        damping_sigma=1.0,
        coherent=0.913,
        lead=0.025,
        lead_sigma=0.0,
        moved=0.0026,
    )
    assert "controller to noise" in rotation_doubt("yaw", seen, "rate controller's outputs")
    assert rotation_doubt("yaw", replace(seen, damping=-0.5, damping_sigma=0.2), "rate controller's outputs") == ""


def test_a_gain_from_slow_rows_errs_by_the_noise_that_folded():
    """Noise that folded at 10 Hz made a roll gain 26 % small at a stated 10 %, with 0.03 rad/s and 91 % coherent."""
    seen = AxisFit(
        gain=61.8, gain_sigma=0.5, damping=1.6, damping_sigma=0.4, coherent=0.911, lead=0.0, lead_sigma=0.0, moved=0.03
    )
    assert gain_error("roll", seen, 10.0, 0.0) > 0.26 * seen.gain > RELATIVE["roll_gain"] * seen.gain
    assert gain_error("roll", seen, 50.0, 0.0) < 0.1 * seen.gain


def test_a_lag_of_thrust_beyond_that_of_torque_is_not_believed():
    """Of motors whose torque follows within 57 ms, a thrust that seemed to lag by 111 ms (truth 23) had been stated."""
    axis = AxisFit(
        gain=60.0, gain_sigma=1.0, damping=0.0, damping_sigma=0.1, coherent=0.99, lead=0.0, lead_sigma=0.0, moved=0.2
    )
    source = "rate controller's outputs"
    turning = RotationFit(axes={"roll": axis}, lag=0.04, delay=0.017, lag_sigma=0.005, source=source, rate=50.0)
    lag = BodyParameter(name="motor_lag", unit="s", value=0.111, sigma=0.013, determined=True, reason="", used=0.111)
    doubted = held_against_torque(lag, turning)
    assert (doubted.value, doubted.used) == (None, 0.111)
    assert "within 0.057 s" in doubted.reason
    assert held_against_torque(replace(lag, value=0.07), turning).value == 0.07


def test_slow_rows_are_joined_as_the_signal_swung():
    """Straight lines took an eighth of swings at 2 Hz from commands of 10 Hz, and curvature came out 12 % too high."""
    fine, rows = np.arange(0.0, 20.0, 0.02), np.arange(0.0, 20.1, 0.1)
    for hz, within in ((0.5, 0.01), (2.0, 0.02), (3.0, 0.06)):
        swing = np.sin(2.0 * np.pi * hz * rows + 0.3)
        lines = np.interp(fine, rows, swing)[:, None]
        joined, middle = join_rows(lines, 0.02, 0.1)[:, 0], slice(100, -100)
        truth = np.sin(2.0 * np.pi * hz * fine + 0.3)[middle]
        part = float(joined[middle] @ truth / (truth @ truth))
        assert part == pytest.approx(1.0, abs=within)
    assert join_rows(lines, 0.02, 0.02) is lines
    # A step of 300 us rings by a fifth at most, and is forgotten within four rows.
    step = np.interp(fine, rows, np.where(rows < 10.0, 1400.0, 1700.0))[:, None]
    joined = join_rows(step, 0.02, 0.1)
    assert np.ptp(joined) < 1.4 * 300.0
    assert np.abs(joined - step)[np.abs(fine - 9.95) > 0.5].max() < 1.0
