"""Rotors with inertia and tanks that empty: conservation laws and closed forms."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from simulation import elhesasy2024, propagate
from simulation.drive import Drive, FirstOrder, QuadraticRotor
from simulation.vehicle import Multirotor, RotorMount, Tank

#: Rotors that weigh something and push nothing: only their inertia is felt.
WHEELS = (
    RotorMount(QuadraticRotor(thrust_coefficient=1e-30, torque_coefficient=1e-30), (0.2, 0.1, -0.05), 1, inertia=3e-4),
    RotorMount(QuadraticRotor(thrust_coefficient=1e-30, torque_coefficient=1e-30), (-0.2, 0.1, 0.0), 1, inertia=2e-4),
    RotorMount(QuadraticRotor(thrust_coefficient=1e-30, torque_coefficient=1e-30), (0.0, -0.2, 0.0), -1, inertia=1e-4),
)
BODY = Multirotor(
    name="body with three wheels",
    mass=2.0,
    inertia=np.array([[0.02, 0.002, -0.001], [0.002, 0.03, 0.001], [-0.001, 0.001, 0.04]]),
    rotors=WHEELS,
    drive=Drive(speed_max=1000.0, response=FirstOrder(0.05)),
)


def momentum(craft, flight):
    """Angular momentum of body and rotors in the world; a clockwise rotor turns about the body's z axis."""
    wheels = sum(
        mount.spin * mount.inertia * flight[f"w{k}"].to_numpy() for k, mount in enumerate(craft.rotors, start=1)
    )
    body = flight[["w_x", "w_y", "w_z"]].to_numpy() @ craft.inertia
    body[:, 2] += wheels
    return Rotation.from_quat(flight[["q_x", "q_y", "q_z", "q_w"]].to_numpy()).apply(body)


def test_wheels_that_speed_up_take_no_angular_momentum_from_nowhere():
    """Gyroscopic sum and the kick of accelerating rotors together: the whole keeps its momentum while it tumbles."""
    start = BODY.state(np.array([100.0, 700.0, 300.0]), rate=(1.0, -2.0, 3.0))
    flight = propagate(BODY, start, lambda t, x: np.array([800.0, 50.0, 900.0]), 3.0, dt=5e-4, gravity=0.0)
    whole = momentum(BODY, flight)
    assert np.ptp(flight["w1"]) > 600.0
    assert np.abs(whole - whole[0]).max() < 1e-8 * np.linalg.norm(whole[0])


def test_steady_wheels_keep_the_energy_of_the_body():
    """Rotors at constant speed relative to the body do work on it only through their bearings, which is none."""
    speeds = np.array([500.0, 500.0, 200.0])
    flight = propagate(BODY, BODY.state(speeds, rate=(2.0, 1.0, -1.0)), lambda t, x: speeds, 5.0, dt=5e-4, gravity=0.0)
    rate = flight[["w_x", "w_y", "w_z"]].to_numpy()
    energy = 0.5 * np.einsum("ti,ij,tj->t", rate, BODY.inertia, rate)
    assert np.abs(energy / energy[0] - 1.0).max() < 1e-8
    assert np.ptp(rate[:, 0]) > 1.0


def test_a_gyroscope_precesses_and_nutates_at_its_frequency():
    """A symmetric body with a fast wheel nutates at h / J about the transverse axes."""
    wheel = RotorMount(QuadraticRotor(thrust_coefficient=1e-30, torque_coefficient=1e-30), (0, 0, 0), 1, inertia=4e-4)
    craft = dataclasses.replace(BODY, rotors=(wheel,), inertia=np.diag((0.02, 0.02, 0.03)))
    speeds = np.array([900.0])
    flight = propagate(craft, craft.state(speeds, rate=(0.1, 0.0, 0.0)), lambda t, x: speeds, 2.0, gravity=0.0)
    frequency = 4e-4 * 900.0 / 0.02
    t = flight.index.to_numpy()
    assert flight["w_x"].to_numpy() == pytest.approx(0.1 * np.cos(frequency * t), abs=1e-6)
    assert flight["w_y"].to_numpy() == pytest.approx(0.1 * np.sin(frequency * t), abs=1e-6)


def test_an_emptying_tank_follows_its_closed_form():
    """Constant thrust on a falling mass: v = g t - (T / r) ln(m0 / (m0 - r t)), and x its integral."""
    craft = elhesasy2024.octocopter()
    rate, m0 = 0.2, craft.mass
    craft = dataclasses.replace(
        craft,
        drag_linear=(0.0, 0.0, 0.0),
        drag_area=(0.0, 0.0, 0.0),
        tank=Tank(time=(0.0, 10.0), mass=(m0, m0 - 10.0 * rate), inertia=(craft.inertia, 0.8 * craft.inertia)),
    )
    # Air of one density: the height changes the thrust by a ten thousandth per metre, so two seconds are flown.
    speeds = np.full(8, 600.0)
    flight = propagate(craft, craft.state(speeds), lambda t, x: speeds, 2.0, dt=1e-3)
    thrust = 8 * 1.105e-5 * 600.0**2
    t = flight.index.to_numpy()
    mass = m0 - rate * t
    fall = 9.80665 * t - thrust / rate * np.log(m0 / mass)
    assert np.abs(flight["v_d"] - fall).max() < 2e-3
