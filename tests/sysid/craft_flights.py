"""Flights of the papers' craft with known truth, integrated by `simulation`, and records of them with noise of sensors.

`flight` hovers under a controller of its own while every axis is shaken, `flown` flies a mission as the simulator does.
"""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd

from core.units import STANDARD_GRAVITY
from logparse import Motor, Vehicle
from simulation.atmosphere import Atmosphere
from simulation.elhesasy2024 import octocopter
from simulation.fly import Setup, SimulatedFlight, attitude, fly, propagate
from simulation.instruments import attitude_angles
from simulation.mission import FlownChirp, GoTo, Mission, Turn, Wait
from simulation.place import Place, Wind
from simulation.sensors import rotate_to_body
from simulation.vehicle import Multirotor
from sysid import Experiment, fit_rigid_body
from sysid.records.context import standard_density
from sysid.rigid_body.body_motion import BodyMotion
from tests.timed import timed


def described(craft: Multirotor) -> Vehicle:
    """Describe the craft as an autopilot would log it."""
    drive = craft.drive
    motors = tuple(
        Motor(
            number=k,
            channel=k,
            angle=math.atan2(mount.position[1], mount.position[0]),
            spin=mount.spin,
            layer=mount.layer,
            roll=-mount.position[1],
            pitch=mount.position[0],
            yaw=-float(mount.spin),
        )
        for k, mount in enumerate(craft.rotors, start=1)
    )
    return Vehicle(
        motors=motors,
        pwm_min=drive.pwm_min,
        pwm_max=drive.pwm_max,
        spin_min=drive.spin_min,
        spin_max=drive.spin_max,
        thrust_expo=drive.expo,
    )


def of_craft(t, u, position, context, vehicle: Vehicle | None, name: str, **more) -> Experiment:
    """Make a record of motors m1, m2, ... and position x, y, z."""
    return Experiment.from_arrays(
        t,
        u,
        position,
        name=name,
        input_names=[f"m{k + 1}" for k in range(u.shape[1])],
        output_names=("x", "y", "z"),
        context=timed(t, **context),
        vehicle=vehicle,
        **more,
    )


def flight(
    craft: Multirotor,
    seed: int = 0,
    duration: float = 60.0,
    rate: float = 50.0,
    strength: float = 1.0,
    noise: float = 1.0,
    shake: float = 0.0,
    climb: float = 0.6,
    wander: float = 3.0,
    speeds: bool = True,
    density: float = 1.225,
) -> Experiment:
    """Hover about the origin under PD control with multisine excitation of every axis.

    `strength` scales the excitation, `noise` that of the sensors (gyro 3 mrad/s, accelerometer 0.05 m/s^2, height
    2 cm, attitude 2 mrad), `shake` a random motion of each motor by itself, relative to its hover speed squared.
    """
    rng = np.random.default_rng(seed)
    n, mass = len(craft.rotors), craft.mass
    k = np.array([m.rotor.thrust(1.0, density) for m in craft.rotors])
    b = np.array([m.rotor.torque(1.0, density) for m in craft.rotors])
    x, y = (np.array([m.position[axis] for m in craft.rotors]) for axis in (0, 1))
    spin = np.array([m.spin for m in craft.rotors])
    allocation = np.linalg.pinv(np.vstack([k, -y * k, x * k, -spin * b]))
    inertia = np.diag(craft.inertia)
    tones = {axis: (rng.uniform(0.1, 2.5, 6), rng.uniform(0.0, 2.0 * np.pi, 6)) for axis in ("roll", "pitch", "yaw")}
    slow = {axis: (rng.uniform(0.05, 0.4, 4), rng.uniform(0.0, 2.0 * np.pi, 4)) for axis in ("n", "e", "d")}
    steps = round(duration / 0.01)
    alone = rng.standard_normal((steps + 1, n))
    for row in range(1, steps + 1):
        alone[row] = 0.9 * alone[row - 1] + math.sqrt(1.0 - 0.81) * alone[row]

    def sum_of(tone, t):
        return float(np.sin(2.0 * np.pi * tone[0] * t + tone[1]).sum()) / math.sqrt(len(tone[0]) / 2.0)

    def command(t, state):
        roll, pitch, yaw = attitude(state)
        target = np.array([wander * strength * sum_of(slow[a], t) for a in ("n", "e")])
        pull = 0.5 * (target - state[0:2]) - 0.9 * state[3:5]
        tilt = np.clip(pull / STANDARD_GRAVITY, -0.35, 0.35)
        want_pitch, want_roll = -tilt[0], tilt[1]
        bump = [strength * sum_of(tones[a], t) for a in ("roll", "pitch", "yaw")]
        moment = inertia * np.array(
            [
                16.0 * (want_roll - roll) - 6.0 * state[10] + 1.5 * bump[0],
                16.0 * (want_pitch - pitch) - 6.0 * state[11] + 1.5 * bump[1],
                1.0 * (0.0 - yaw) - 1.5 * state[12] + 0.4 * bump[2],
            ]
        )
        height = -climb * strength * sum_of(slow["d"], t)
        lift = (
            mass
            * (STANDARD_GRAVITY + 2.0 * (state[2] - height) + 2.5 * state[5])
            / max(math.cos(roll) * math.cos(pitch), 0.5)
        )
        squares = allocation @ np.array([lift, *moment])
        squares = squares * (1.0 + shake * alone[min(round(t / 0.01), steps)])
        return np.sqrt(np.clip(squares, (0.05 * craft.drive.speed_max) ** 2, craft.drive.speed_max**2))

    hover = math.sqrt(mass * STANDARD_GRAVITY / k.sum())
    commands: list[np.ndarray] = []

    def recorded(t, state):
        commands.append(command(t, state))
        return commands[-1]

    start = np.zeros(13 + n)
    start[6], start[13:] = 1.0, hover
    states = propagate(
        craft,
        start,
        recorded,
        duration,
        dt=0.002,
        hold=5,
        gravity=STANDARD_GRAVITY,
        atmosphere=Atmosphere.standard(0.0),
    )
    every = round(1.0 / (rate * 0.002))
    rows = states.iloc[::every]
    wanted = np.repeat(np.array(commands), 5, axis=0)[::every][: len(rows)]
    rows = rows.iloc[: len(wanted)]
    clean = _record(craft, rows, wanted, speeds, density, k, f"{craft.name} {seed}")
    return disturbed(clean, rng, noise) if noise > 0.0 else clean


def disturbed(record: Experiment, rng: np.random.Generator, noise: float = 1.0) -> Experiment:
    """Add sensor noise to a record flown without."""
    sigma = dict.fromkeys(("roll", "pitch", "yaw"), 0.002)
    sigma |= {f"w_{a}": 0.003 for a in "xyz"} | {f"f_{a}": 0.05 for a in "xyz"} | {f"v_{a}": 0.03 for a in "ned"}
    columns = {
        name: record.context[name] + noise * size * rng.standard_normal(len(record.t)) for name, size in sigma.items()
    }
    y = record.y + noise * 0.02 * rng.standard_normal(record.y.shape)
    return replace(record, y=y, context=record.context.assign(**columns))


def context_of(rows: pd.DataFrame, force, velocity, **columns):
    """Return what a record of motion holds beside commands and position: attitude, rates, forces, speeds and more."""
    return {
        **dict(zip(("roll", "pitch", "yaw"), attitude_angles(rows), strict=True)),
        **{f"w_{axis}": rows[f"w_{axis}"].to_numpy() for axis in "xyz"},
        **{f"f_{axis}": values for axis, values in zip("xyz", force, strict=True)},
        **{f"v_{axis}": values for axis, values in zip("ned", velocity, strict=True)},
        **columns,
    }


def _record(craft, rows, wanted, speeds, density, k, name):
    n = len(craft.rotors)
    v = rows[["v_n", "v_e", "v_d"]].to_numpy()
    v_b = rotate_to_body(rows[["q_w", "q_x", "q_y", "q_z"]].to_numpy(), v)
    turned = rows[[f"w{i + 1}" for i in range(n)]].to_numpy()
    drag = np.array(craft.drag_linear) * v_b + 0.5 * density * np.array(craft.drag_area) * np.abs(v_b) * v_b
    force = -drag / craft.mass
    force[:, 2] -= (turned**2 @ k) / craft.mass
    context = context_of(rows, force.T, v.T, density=density, voltage=craft.drive.voltage_reference)
    if speeds:
        context |= {f"rotor_speed_{i + 1}": turned[:, i] for i in range(n)}
    drive, e = craft.drive, craft.drive.expo
    level = (wanted / drive.speed_max) ** 2
    a = level if e == 0.0 else (e - 1.0 + np.sqrt((1.0 - e) ** 2 + 4.0 * e * level)) / (2.0 * e)
    pwm = drive.pwm_at_zero_thrust + a * (drive.pwm_at_full_thrust - drive.pwm_at_zero_thrust)
    position = rows[["p_n", "p_e", "p_d"]].to_numpy() * np.array([1.0, 1.0, -1.0])
    t = rows.index.to_numpy()
    return of_craft(t, pwm, position, context, described(craft), name)


def without(record: Experiment, *columns: str) -> Experiment:
    """Drop columns of a record's context."""
    return replace(record, context=record.context.drop(columns=list(columns)))


#: Back and forth at several speeds, up and down, every axis shaken, with turns between: what tells every parameter.
EXCITING = Mission(
    takeoff=8.0,
    steps=(
        GoTo(30.0, 0.0, 8.0, 8.0),
        GoTo(0.0, 0.0, 8.0, 3.0),
        GoTo(0.0, 30.0, 8.0, 8.0),
        GoTo(0.0, 0.0, 8.0, 3.0),
        GoTo(0.0, 0.0, 30.0, 5.0),
        Turn(100.0),
        GoTo(0.0, 0.0, 8.0, 2.0),
        GoTo(25.0, 25.0, 20.0, 6.0),
        FlownChirp("roll", 0.08, 0.5, 6.0, 12.0, placed=True),
        FlownChirp("pitch", 0.08, 0.5, 6.0, 12.0, placed=True),
        FlownChirp("yaw", 0.15, 0.5, 4.0, 10.0, placed=True),
        FlownChirp("throttle", 0.1, 0.5, 3.0, 8.0, placed=True),
        Turn(200.0),
        GoTo(0.0, 0.0, 10.0, 6.0),
        Wait(3.0),
    ),
    acceleration=3.0,
)
HOVER = Mission(takeoff=8.0, steps=(Wait(40.0),))


def flown(
    craft: Multirotor,
    mission: Mission = EXCITING,
    wind: Wind | None = None,
    altitude: float = 0.0,
    seed: int = 0,
    rate: float = 50.0,
) -> SimulatedFlight:
    """Fly a mission; `altitude` above the sea in m."""
    place = Place(name="test", lat_deg=47.0, lon_deg=8.0, alt=altitude)
    return fly(Setup(mission=mission, place=place, vehicle=craft, wind=wind or Wind(), seed=seed), rate=rate)


def record(
    flight: SimulatedFlight, rng: np.random.Generator | None = None, position: float = 0.01, name: str = "flight"
):
    """Cut the airborne part out, with noise on position [m] and tenths of it on velocity [m/s]."""
    craft, place = flight.setup.vehicle, flight.setup.place
    rows = flight.truth.loc[flight.airborne[0] + 2.0 : flight.airborne[1] - 3.0]

    def noisy(values, sigma):
        return values if rng is None else values + sigma * rng.standard_normal(len(values))

    context = context_of(
        rows,
        [noisy(rows[f"f_{axis}"].to_numpy(), 0.05) for axis in "xyz"],
        [noisy(rows[f"v_{axis}"].to_numpy(), 0.1 * position) for axis in "ned"],
        density=standard_density(place.alt - rows["p_d"].to_numpy()),
        voltage=rows["voltage"].to_numpy(),
        # The attitude is the truth's.
        **{f"phi_{axis}": 1e-5 for axis in "ned"},
    )
    context["yaw"] = np.unwrap(context["yaw"])
    pwm = rows[[f"m{k + 1}" for k in range(len(craft.rotors))]].to_numpy()
    place_up = [noisy(rows[f"p_{a}"].to_numpy() * s, position) for a, s in zip("ned", (1, 1, -1), strict=True)]
    return of_craft(rows.index.to_numpy(), pwm, np.column_stack(place_up), context, described(craft), name)


# The octocopter of Elhesasy 2024 on the exciting flight, its rigid body, and level motion for the kernels.

RATE = 25.0


@cache
def exciting(rate=RATE):
    return flown(octocopter(), wind=Wind(speed=2.0, from_deg=220.0, gusts=0.0), altitude=200.0, rate=rate)


@cache
def fitted():
    return fit_rigid_body([record(exciting(), np.random.default_rng(1))], mass=octocopter().mass)


def level(samples, dt=0.02, thrust_over_weight=1.0):
    """Make a flight with level attitude, one motor's worth of command and sea-level air."""
    states = np.zeros((samples, 18))
    states[:, [6, 10, 14]] = 1.0
    return BodyMotion(
        name="level",
        t=np.arange(samples) * dt,
        states=states,
        density=np.ones(samples),
        linear=np.full(samples, thrust_over_weight),
        square=np.full(samples, thrust_over_weight),
        ground=1e-9,
        attitude_sigma=np.zeros(3),
        input_interval=dt,
    )


def parameters(**given):
    """Arrange parameters for the kernels: thrust equal to weight, no drag, no wind."""
    drag = [f"{law}{axis}" for law in "lq" for axis in "xyz"]
    names = ["thrust", "expo", *drag, "climb", "tx", "ty", "lag", "exponent", "scale", "n", "e"]
    return np.array([given.get(name, {"thrust": STANDARD_GRAVITY, "scale": 1.0}.get(name, 0.0)) for name in names])
