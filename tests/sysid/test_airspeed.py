"""What hover cannot tell: drag from wind, and effectiveness from outputs that do not belong to the motion."""

from dataclasses import replace

import numpy as np
import pytest

from simulation.mission import Chirp, Mission, Wait
from simulation.survey_quadcopter import quadcopter
from simulation.wind import Wind
from sysid import fit_rigid_body
from sysid.rigid_body.airspeed import MOST, doubt_of_air
from sysid.rigid_body.body_motion import Motion, rotation_matrices
from sysid.rigid_body.wind import FlightTrim
from tests.sysid.flown_craft import flown, record

SHAKEN = Mission(
    takeoff=8.0,
    steps=(
        Wait(10.0),
        Chirp("roll", 0.08, 0.5, 6.0, 15.0),
        Chirp("pitch", 0.08, 0.5, 6.0, 15.0),
        Chirp("yaw", 0.15, 0.5, 4.0, 15.0),
        Wait(10.0),
    ),
)


def motion_of(velocity, yaw):
    samples = len(velocity)
    return Motion(
        name="flight",
        t=np.arange(samples) * 0.1,
        rotation=rotation_matrices(np.zeros(samples), np.zeros(samples), yaw).reshape(-1, 9),
        density=np.ones(samples),
        linear=np.ones(samples),
        square=np.ones(samples),
        position=np.zeros((samples, 3)),
        velocity=velocity,
        acceleration=None,
        ground=0.0,
    )


def trim_of(north, sigma):
    return FlightTrim(
        wind_n=north, wind_e=0.0, wind_sigma=sigma, thrust_scale=1.0, thrust_scale_sigma=0.01, source="fit"
    )


def test_turning_at_one_velocity_tells_no_drag_and_flying_along_an_axis_tells_that_one():
    steady = np.tile([4.0, 0.0, 0.0], (400, 1))
    turning = doubt_of_air([motion_of(steady, np.linspace(0.0, 20.0, 400))], [trim_of(2.0, 0.3)], varies=True)
    assert turning.speeds == pytest.approx((0.0, 0.0), abs=1e-12)
    assert turning.of("drag_linear_x") == MOST
    swings = np.zeros((400, 3))
    swings[:, 0] = 3.0 * np.sqrt(2.0) * np.sin(2.0 * np.pi * np.arange(400) / 100.0)
    along = doubt_of_air([motion_of(swings, np.zeros(400))], [trim_of(2.0, 0.0)], varies=True)
    # Gusts of a fifth of 2 m/s against a spread of 3 m/s.
    assert along.of("drag_linear_x") == pytest.approx((0.4 / 3.0) ** 2)
    assert along.of("drag_quadratic_y") == MOST
    assert along.of("drag_linear_z") == along.of("thrust") == 0.0
    constant = doubt_of_air([motion_of(swings, np.zeros(400))], [trim_of(2.0, 0.0)], varies=False)
    assert constant.of("drag_linear_x") == 0.0


def test_a_wind_that_is_known_only_through_drag_is_as_uncertain():
    doubt = doubt_of_air([motion_of(np.zeros((50, 3)), np.zeros(50))], [trim_of(1.0, 0.5)], varies=True)
    assert doubt.widened(trim_of(1.0, 0.5)).wind_sigma == pytest.approx(np.hypot(0.5 * (1.0 + MOST), MOST))


@pytest.mark.parametrize("seed", [11, 12])
def test_a_shaken_hover_in_wind_claims_no_drag_and_a_wind_within_three_sigma(seed):
    wind = Wind(speed=2.0, from_deg=270.0, gusts=1.0)
    seen = record(flown(quadcopter(), SHAKEN, wind=wind, seed=seed), np.random.default_rng(seed), 0.05)
    model = fit_rigid_body([seen])
    for name in ("drag_linear_x", "drag_linear_y", "drag_quadratic_x", "drag_quadratic_y"):
        assert not model.parameters[name].determined
        assert "at several speeds" in model.parameters[name].reason
    trim = model.flights[seen.name]
    assert abs(trim.wind_n) < 3.0 * trim.wind_sigma
    assert abs(trim.wind_e - 2.0) < 3.0 * trim.wind_sigma
    for axis in ("roll", "pitch"):
        gain = model.parameters[f"{axis}_gain"]
        assert gain.determined
        assert gain.sigma >= 0.01 * gain.value


def test_a_constant_motor_and_outputs_of_another_flight_are_named():
    """A dead motor leaves the centre of gravity open; an axis that moved is not said to have stood still."""
    seen = record(flown(quadcopter(), SHAKEN), np.random.default_rng(5))
    dead, strange = seen.u.copy(), seen.u[::-1].copy()
    dead[:, 1] = 1000.0
    model = fit_rigid_body([replace(seen, u=dead)])
    for name in ("cg_x", "cg_y"):
        assert not model.parameters[name].determined
        assert "output of m2 is constant" in model.parameters[name].reason
    reason = fit_rigid_body([replace(seen, u=strange)]).parameters["roll_gain"].reason
    assert "although the axis moved" in reason
    assert "hardly" not in reason
