"""Craft and flights of the papers against what they print."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.signal import lti, step
from scipy.spatial.transform import Rotation

from simulation import CASES, ParameterError, guntur2019, kim2017, motion2018, propagate
from simulation.controllers import hover_linearisation
from simulation.drive import Drive
from simulation.guntur2019 import MOTORS, PAYLOADS
from simulation.motion2018 import DRIVE, SPATIAL, VERTICAL, WITH_WIND, fly_to_point, in_paper_axes


def model(voltage=16.0):
    return hover_linearisation(kim2017.quadcopter(voltage), kim2017.at_voltage(kim2017.TRIM_SPEEDS, voltage))


def test_input_matrix_is_eq_23_but_for_the_yaw_row():
    """Roll and pitch rows agree to the printed digits; the yaw row is printed 3.28 (feet per metre) times too large."""
    _, B = model()
    assert B[2:4] == pytest.approx(kim2017.PRINTED_INPUT[:2], abs=0.6e-4)
    assert kim2017.PRINTED_INPUT[2] / B[4] == pytest.approx(np.full(4, 1 / 0.3048), rel=0.02)


def test_gain_is_eq_25():
    """The unrounded model gives the printed gain to 0.2 % in angles and integrals, 0.6 % in roll and pitch rate.

    The yaw-rate column (0.3 to 0.5 in print) follows the yaw row of the model, and is printed to one digit.
    """
    ratio = kim2017.gain() / kim2017.PRINTED_GAIN
    assert ratio[:, [0, 1, 5, 6]] == pytest.approx(np.ones((4, 4)), abs=0.002)
    assert ratio[:, [2, 3]] == pytest.approx(np.ones((4, 2)), abs=0.006)
    assert kim2017.gain()[:, 4] == pytest.approx(kim2017.PRINTED_GAIN[:, 4], abs=0.05)


def test_recovery_levels_the_craft_and_lets_it_yaw():
    """Figure 12: roll and pitch go to zero, height to its target, and yaw turns on because nothing controls it."""
    flight = kim2017.recovery()
    attitude = Rotation.from_quat(flight[["q_x", "q_y", "q_z", "q_w"]].to_numpy()).as_euler("ZYX", degrees=True)
    assert attitude[0] == pytest.approx([0.0, 20.0, 20.0], abs=1e-6)
    after = flight.index > 3.0
    assert np.abs(attitude[after, 1:]).max() < 1.0
    assert np.abs(flight["p_d"][flight.index > 15.0]).max() < 0.03
    assert flight["w_z"].iloc[-1] > 0.5


def test_unstable_height_is_told_with_the_flight():
    outcome = CASES["kim-recovery"].run({"height_p": 80.0, "duration": 1.0})
    assert "height_p = 80" in outcome.fault
    assert "height_p = 80" in outcome.notes[0]


CRAFT = motion2018.quadcopter()


def spin_up(drive, command, duration=0.4, dt=1e-4, start=200.0):
    """Speed of a rotor over time after a step of the command, the craft without weight."""
    craft = dataclasses.replace(CRAFT, drive=Drive(speed_max=490.0, response=drive))
    speeds = np.full(4, command)
    path = propagate(craft, craft.state(np.full(4, start)), lambda t, x: speeds, duration, dt=dt, gravity=0.0)
    return path["w1"]


def test_drive_steps_as_its_transfer_function():
    """A step of 5 rad/s stays within all limits: SciPy's response of (T s + 1) / (a3 s^3 + a2 s^2 + a1 s + 1)."""
    speed = spin_up(DRIVE, 205.0)
    transfer = lti([DRIVE.lead, 1.0], [DRIVE.a3, DRIVE.a2, DRIVE.a1, 1.0])
    _, expected = step(transfer, T=speed.index.to_numpy())
    assert np.abs(speed.to_numpy() - (200.0 + 5.0 * expected)).max() < 1e-6
    assert speed.iloc[-1] == pytest.approx(205.0, abs=1e-3)


def test_drive_keeps_the_printed_limits():
    """From 200 to beyond 490 rad/s at 500 rad/s^2 takes 0.58 s, and there the rotor stays."""
    speed = spin_up(DRIVE, 600.0, duration=1.5)
    t = speed.index.to_numpy()
    assert np.abs(np.diff(speed)).max() / 1e-4 <= 500.0 + 1e-6
    assert speed.max() <= 490.0 + 0.05
    ramp = (t > 0.1) & (t < 0.5)
    assert np.polyfit(t[ramp], speed.to_numpy()[ramp], 1)[0] == pytest.approx(500.0, rel=1e-6)
    assert t[speed > 489.0][0] == pytest.approx(0.58, abs=0.01)
    down = spin_up(DRIVE, 0.0, duration=1.5)
    assert down.min() >= -0.05
    assert np.diff(down).min() / 1e-4 >= -500.0 - 1e-6


@pytest.mark.parametrize("flight", [VERTICAL, SPATIAL, WITH_WIND], ids=["vertical", "spatial", "with wind"])
def test_flights_of_the_paper_arrive(flight):
    """Within 0.1 m and below 0.1 m/s, rotors within 490 rad/s and 500 rad/s^2, by Euler's method at 1e-4 s."""
    path = in_paper_axes(fly_to_point(flight))
    last = path.iloc[-1]
    assert np.linalg.norm(last[["x", "y", "z"]].to_numpy() - flight.target) < 0.1
    assert np.linalg.norm(last[["v_x", "v_y", "v_z"]]) < 0.1
    assert path[["w1", "w2", "w3", "w4"]].max().max() < 490.0
    assert path[["a1", "a2", "a3", "a4"]].abs().max().max() <= 500.0 + 1e-6
    assert np.linalg.norm(path[["v_x", "v_y", "v_z"]], axis=1).max() < 1.05 * flight.speed


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"target": (0.0, -5.0, 0.0)}, "above the ground, not 10 and -5 m"),
        ({"target": (math.nan, 5.0, 0.0)}, "finite numbers"),
        ({"mass": 0.1}, "the four motors alone weigh"),
        ({"mass": 3.0}, r"hover takes 520 rad/s of the 490 rad/s"),
        ({"speed": 90.0}, "speed 90 m/s"),
        ({"step": 3e-4}, r"step 0\.0003 s must divide"),
        ({"step": 0.0}, "step 0 s must divide"),
    ],
)
def test_impossible_flights_are_refused(change, message):
    with pytest.raises(ParameterError, match=message):
        fly_to_point(dataclasses.replace(VERTICAL, **change))


ROTOR = guntur2019.rotor()


def blade_thrust(v, speed, across, sinking, density=1.225):
    """Thrust by integrating lift along the blade, averaged over a turn: the printed formula before its integration.

    Pitch angle th0 + th1 r/R; perpendicular flow small against the tangential one, which in forward flight is
    ``w r + U sin(psi)``, whose square averages to ``(w r)^2 + U^2 / 2``.
    """
    R, chord, blades, slope = 0.102, 0.0274, 2, 5.7
    angle = math.atan2(0.1016, 2.0 * math.pi * 0.75 * R)

    def element(r):
        theta = 2.0 * angle - 4.0 / 3.0 * angle * r / R
        tangential = speed * r
        return (
            0.5
            * density
            * slope
            * blades
            * chord
            * (theta * (tangential**2 + 0.5 * across**2) + (sinking - v) * tangential)
        )

    return quad(element, 0.0, R, epsabs=1e-12)[0]


@pytest.mark.parametrize("across", [0.0, 3.0, 12.0])
@pytest.mark.parametrize("sinking", [-6.0, -1.0, 0.0, 1.5])
@pytest.mark.parametrize("speed", [300.0, 700.0, 1500.0])
def test_solution_balances_blade_elements_and_momentum(speed, across, sinking):
    """Against an outside root finder on the two sides written anew, the blade side by numerical integration."""
    area = math.pi * 0.102**2

    def residual(v):
        momentum = 2.0 * v * 1.225 * area * math.sqrt(across**2 + (sinking - v) ** 2)
        return momentum - blade_thrust(v, speed, across, sinking)

    v = brentq(residual, -60.0, 60.0, xtol=1e-13)
    assert ROTOR.induced_velocity(speed, across=across, sinking=sinking) == pytest.approx(v, rel=1e-8)
    assert ROTOR.thrust(speed, across=across, sinking=sinking) == pytest.approx(
        blade_thrust(v, speed, across, sinking), rel=1e-8
    )


def test_feasibility_of_five_motors_with_three_cells():
    """KV 740 and 750 turn too slowly for three quarters of the tank or more at 11.1 V; power limits nobody."""
    table = guntur2019.feasibility()
    assert len(table) == len(MOTORS) * len(PAYLOADS)
    failed = table[~table["feasible"]]
    assert set(zip(failed["motor"], failed["payload"], strict=True)) == {
        (name, payload) for name in ("MT-4006-13 740KV", "AX-2810Q-750KV") for payload in (1.0, 0.75)
    }
    assert (table["power"] < table["limit_power"]).all()
    assert table["hover_rpm"].between(6000, 9300).all()
