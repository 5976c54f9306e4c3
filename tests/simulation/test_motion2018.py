"""Motion 2018: drive, inertias, autopilot and the three flights of section 3."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.signal import lti, step

from simulation import ParameterError, motion2018, propagate
from simulation.drive import Drive
from simulation.motion2018 import DRIVE, SPATIAL, VERTICAL, WITH_WIND, fly_to_point, in_paper_axes

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


def test_printed_senses_of_rotation_leave_yaw_without_control():
    """1 and 3 clockwise, 2 and 4 against, with 1-2 and 3-4 on the beams: the allocation has rank three."""
    arms = np.array([mount.position for mount in CRAFT.rotors])

    def allocation(spins):
        return np.vstack((np.ones(4), -arms[:, 1], arms[:, 0], -0.016 * np.array(spins)))

    assert np.linalg.matrix_rank(allocation([1, -1, 1, -1])) == 3
    assert np.linalg.matrix_rank(allocation([mount.spin for mount in CRAFT.rotors])) == 4


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
