"""The equations of motion against closed forms, conservation laws and an independent integrator; the cascade."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from simulation import DivergenceError, Setup, elhesasy2024, fly, propagate
from simulation._kernels import FLYING, mix
from simulation.atmosphere import Atmosphere
from simulation.controllers import Cascade, mixer
from simulation.mission import GoTo, Mission, Wait
from simulation.place import Place, Wind
from simulation.sensors import Inertial, Navigation, Sensors
from simulation.vehicle import Tank

OCTA = elhesasy2024.octocopter()
N = len(OCTA.rotors)
STILL = np.zeros(N)


def state(position=(0, 0, 0), velocity=(0, 0, 0), quaternion=(1, 0, 0, 0), rate=(0, 0, 0), speeds=STILL):
    return np.concatenate((position, velocity, quaternion, rate, speeds)).astype(float)


#: A craft whose rotors take part in its angular momentum, with products of inertia: nothing is special about its axes.
SKEWED = dataclasses.replace(
    elhesasy2024.quadcopter(),
    inertia=np.array([[0.016, 0.002, -0.001], [0.002, 0.018, 0.001], [-0.001, 0.001, 0.029]]),
)


@pytest.mark.parametrize("craft", [OCTA, SKEWED], ids=["octocopter", "rotors with inertia"])
def test_agrees_with_an_independent_model_under_solve_ivp(craft):
    """The same physics written with vectors and SciPy's rotations, integrated by DOP853 at tight tolerance.

    What it says of gyroscopic moments and of rotors that speed up holds for tumbling, nutation and momentum as well.
    """
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
        h, h_dot = (down * (spins * inertia * motion).sum() for motion in (speed, change))
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


SEA = Place(name="sea", lat_deg=45.0, lon_deg=0.0, alt=0.0)
#: Instruments without any error, to see the craft alone.
PERFECT = Sensors(
    inertial=Inertial(gyro_noise=0.0, accel_noise=0.0, gyro_vibration=0.0, accel_vibration=0.0),
    navigation=Navigation(position=0.0, velocity=0.0, tilt=0.0, yaw=0.0),
)


def setup(*steps, wind=Wind(), sensors=PERFECT, **changes):  # noqa: B008 - frozen
    mission = Mission(takeoff=5.0, steps=steps, disarmed=0.5, armed=0.5)
    return dataclasses.replace(Setup(mission=mission, place=SEA, vehicle=OCTA, wind=wind, sensors=sensors), **changes)


def test_mixer_is_that_of_octa_plus():
    """ArduPilot's AP_MotorsMatrix: sine and cosine of the arm, +-0.5; clockwise motors turn the nose left."""
    c = math.sqrt(0.5)
    roll = 0.5 * np.array([0, 0, -c, -c, c, c, 1, -1])
    pitch = 0.5 * np.array([1, -1, c, -c, c, -c, 0, 0])
    yaw = 0.5 * np.array([-1, -1, 1, 1, 1, 1, -1, -1])
    assert mixer(OCTA) == pytest.approx(np.column_stack((roll, pitch, yaw)), abs=1e-12)
    # An autopilot knows the frame, and not where the centre of gravity is.
    ahead = tuple(
        dataclasses.replace(mount, position=(mount.position[0] + 0.03, *mount.position[1:])) for mount in OCTA.rotors
    )
    assert mixer(dataclasses.replace(OCTA, rotors=ahead)) == pytest.approx(mixer(OCTA), abs=1e-12)


def test_allocation_gives_up_yaw_before_roll():
    factors, u = mixer(OCTA), np.empty(8)
    assert not mix(0.5, 0.2, 0.0, 0.1, factors, u)
    assert u == pytest.approx(0.5 + factors @ [0.2, 0.0, 0.1])
    assert mix(0.5, 0.8, 0.0, 1.0, factors, u)
    assert u.min() >= 0.0
    assert u.max() <= 1.0
    assert u @ factors[:, 0] == pytest.approx(0.8 * (factors[:, 0] @ factors[:, 0]), rel=1e-6)


def test_relocation_arrives_and_stays_upright_in_wind():
    flight = fly(setup(Wait(1), GoTo(12.0, -6.0, 9.0), Wait(6), wind=Wind(speed=3.0, from_deg=300.0, gusts=0.0)))
    end = flight.truth.loc[: flight.reference.land].iloc[-1]
    # Integral action: the steady wind leaves decimetres after six seconds.
    assert end[["p_n", "p_e", "p_d"]].to_numpy() == pytest.approx([12.0, -6.0, -9.0], abs=0.15)
    airborne = flight.truth[flight.truth["state"] == FLYING]
    assert np.degrees(np.abs(airborne[["roll", "pitch"]].to_numpy()).max()) < 20.0


def test_unstable_gains_stop_with_time_and_state():
    wild = Cascade(roll_rate=(3.0, 0.0, 0.0), pitch_rate=(3.0, 0.0, 0.0), angle_p=(40.0, 40.0, 2.5))
    with pytest.raises(DivergenceError, match=r"at \d+\.\d+ s"):
        fly(setup(Wait(5), GoTo(20, 0, 10), cascade=wild, wind=Wind(speed=3.0)))
