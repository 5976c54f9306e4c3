"""The equations of motion against closed forms, conservation laws and an independent integrator."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from simulation import elhesasy2024, propagate
from simulation.atmosphere import Atmosphere

OCTA = elhesasy2024.octocopter()
N = len(OCTA.rotors)
STILL = np.zeros(N)
#: No drag, and an inertia with products, so that nothing is special about the body axes.
BARE = dataclasses.replace(
    OCTA,
    drag_linear=(0.0, 0.0, 0.0),
    drag_area=(0.0, 0.0, 0.0),
    inertia=np.array([[0.060, 0.004, -0.006], [0.004, 0.075, 0.003], [-0.006, 0.003, 0.105]]),
)


def state(position=(0, 0, 0), velocity=(0, 0, 0), quaternion=(1, 0, 0, 0), rate=(0, 0, 0), speeds=STILL):
    return np.concatenate((position, velocity, quaternion, rate, speeds)).astype(float)


def rotations(frame):
    """Body-to-NED rotations of each row."""
    return Rotation.from_quat(frame[["q_x", "q_y", "q_z", "q_w"]].to_numpy())


def test_tumbling_without_moments_keeps_energy_and_angular_momentum():
    flight = propagate(BARE, state(rate=(3.0, -2.0, 5.0)), lambda t, x: STILL, 10.0, gravity=0.0)
    rate = flight[["w_x", "w_y", "w_z"]].to_numpy()
    momentum_b = rate @ BARE.inertia
    energy = 0.5 * np.einsum("ti,ti->t", rate, momentum_b)
    momentum_n = rotations(flight).apply(momentum_b)
    # RK4 at 1 ms loses about (w dt)^4 of a revolution per revolution: parts in 1e10 over 10 s.
    assert np.abs(energy / energy[0] - 1.0).max() < 1e-9
    assert np.abs(momentum_n - momentum_n[0]).max() < 1e-9 * np.linalg.norm(momentum_n[0])


def test_moments_of_single_rotors_are_those_of_the_paper():
    """Elhesasy 2024 eq. 14-16 with the signs restored: Mx, My (nose up) and Mz of each motor.

    The paper counts Mz positive for the clockwise `+` rotors in axes with z up; with z down the reaction of a
    clockwise rotor is negative, as the geometry asks.
    """
    c = math.sqrt(0.5)
    arm, k, b = 0.35, 1.105e-5, 1.779e-7
    roll = arm * k * np.array([0, 0, -c, -c, c, c, 1, -1])
    pitch = arm * k * np.array([1, -1, c, -c, c, -c, 0, 0])
    yaw = -b * np.array([1, 1, -1, -1, -1, -1, 1, 1])
    speed, dt = 400.0, 1e-6
    for motor in range(N):
        speeds = np.zeros(N)
        speeds[motor] = speed
        flight = propagate(OCTA, state(speeds=speeds), lambda t, x, s=speeds: s, dt, dt=dt)
        moment = OCTA.inertia @ flight[["w_x", "w_y", "w_z"]].iloc[-1].to_numpy() / dt
        expected = np.array([roll[motor], pitch[motor], yaw[motor]]) * speed**2
        assert moment == pytest.approx(expected, rel=1e-5, abs=1e-7)


def test_integrator_is_of_fourth_order():
    """Halving the step divides the error by 16 as long as the error is above rounding."""
    speeds = np.linspace(600.0, 760.0, N)
    start = state(velocity=(5.0, -2.0, 1.0), rate=(1.0, -2.0, 1.5), speeds=speeds)

    def end(dt):
        return propagate(OCTA, start, lambda t, x: speeds, 0.64, dt=dt, wind=(2.0, 1.0, 0.0)).iloc[-1].to_numpy()

    exact = end(0.0005)
    errors = [np.linalg.norm(end(dt) - exact) for dt in (0.016, 0.008, 0.004)]
    orders = np.log2([errors[0] / errors[1], errors[1] / errors[2]])
    assert orders == pytest.approx([4.0, 4.0], abs=0.25)


@pytest.mark.parametrize("craft", [OCTA, elhesasy2024.quadcopter()], ids=["octocopter", "rotors with inertia"])
def test_agrees_with_an_independent_model_under_solve_ivp(craft):
    """The same physics written with vectors and SciPy's rotations, integrated by DOP853 at tight tolerance."""
    n, rotor, lag = len(craft.rotors), craft.rotors[0].rotor, craft.drive.response.time_constant
    speeds, command = np.linspace(560.0, 780.0, n), np.linspace(760.0, 600.0, n)
    wind, down = np.array([3.0, -1.5, 0.5]), np.array([0.0, 0.0, 1.0])
    air = Atmosphere.standard(500.0, warmer=7.0)
    start = craft.state(
        speeds, position=(0, 0, -20), velocity=(4, -3, 1), attitude=(0.9, 0.3, -0.2, 0.25), rate=(0.8, -1.1, 0.6)
    )
    start[6:10] /= np.linalg.norm(start[6:10])
    positions = np.array([mount.position for mount in craft.rotors])
    spins, inertia = (np.array([getattr(mount, name) for mount in craft.rotors]) for name in ("spin", "inertia"))

    def rhs(t, x):
        v, q, w, speed = x[3:6], x[6:10], x[10:13], x[13:]
        C = Rotation.from_quat([q[1], q[2], q[3], q[0]]).as_matrix()
        density = air.density_at(-x[2])
        squares, change = density / 1.225 * speed**2, (command - speed) / lag
        forces = np.outer(rotor.thrust_coefficient * squares, -down)
        moment = np.cross(positions, forces).sum(axis=0) - down * (spins * rotor.torque_coefficient * squares).sum()
        air_b = C.T @ (v - wind)
        drag = np.array(craft.drag_linear) * density / 1.225
        drag = drag + 0.5 * density * np.array(craft.drag_area) * np.linalg.norm(air_b)
        h, h_dot = (down * (spins * inertia * each).sum() for each in (speed, change))
        w_dot = np.linalg.solve(craft.inertia, moment - h_dot - np.cross(w, craft.inertia @ w + h))
        v_dot = C @ (forces.sum(axis=0) - drag * air_b) / craft.mass + 9.80665 * down
        W = np.array([[0, *-w], [w[0], 0, w[2], -w[1]], [w[1], -w[2], 0, w[0]], [w[2], w[1], -w[0], 0]])
        return np.concatenate((v, v_dot, 0.5 * W @ q, w_dot, change))

    solution = solve_ivp(rhs, (0.0, 2.0), start, method="DOP853", rtol=1e-12, atol=1e-12)
    flight = propagate(craft, start, lambda t, x: command, 2.0, dt=5e-4, atmosphere=air, wind=tuple(wind))
    # Global error of RK4 at half a millisecond, dominated by the rotor lag of 40 ms: (dt / 40 ms)^4 / 120 ~ 1e-10.
    assert flight.iloc[-1].to_numpy() == pytest.approx(solution.y[:, -1], rel=1e-7, abs=1e-7)


def test_dropped_craft_comes_to_rest_on_its_feet():
    flight = propagate(OCTA, state(position=(0, 0, -0.3), velocity=(0.4, 0, 0)), lambda t, x: STILL, 3.0, ground=True)
    last = flight.iloc[-1]
    assert abs(last["p_d"]) < 1e-4
    assert np.abs(last[["v_n", "v_e", "v_d", "w_x", "w_y", "w_z"]]).max() < 1e-3
    assert 2.0 * math.acos(min(last["q_w"], 1.0)) < 1e-3
