"""The rigid body from flight: accuracy on craft of known truth, prediction, the core paper's protocol, speed.

Flights with the firmware in the loop are read from ../shared/logs/sitl where that folder is. Peer in the same run where
installed: aeroid (output error by finite differences over SciPy's integrator), on the same data and parameters.
"""

import json
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from benchmarks._measure import SITL, Row, listed, row, timed
from core.units import STANDARD_GRAVITY
from estimation import estimate
from logparse import read_log
from simulation.elhesasy2024 import octocopter
from simulation.mission import Chirp, GoTo, Mission, Turn
from simulation.wind import Wind
from sysid import Experiment, fit_rigid_body, validate
from sysid.rigid_body.methods.output_error import Prior, fit_output_error
from sysid.rigid_body.motion.body_motion import OWN, SHARED, THETA, Motion, motion
from tests.sysid.flown_craft import flown as flown_craft
from tests.sysid.flown_craft import record
from tests.sysid.honesty import simulated_truth

NOT_HERE = "no logs"


#: Parameters of the problem that the peer solves too, and where both start.
SHARED_PROBLEM = {
    "thrust": 2.0,
    "drag_linear_x": 0.2,
    "drag_linear_y": 0.2,
    "drag_linear_z": 0.2,
    "drag_quadratic_x": 0.02,
    "drag_quadratic_y": 0.02,
    "drag_quadratic_z": 0.02,
    "wind_n": 0.5,
    "wind_e": 0.5,
}


def run() -> list[Row]:
    return [*simulated(), *against_aeroid(), *firmware(), *paper_protocol()]


@cache
def flown() -> Experiment:
    """Fly the octocopter of Elhesasy 2024 for three minutes in light wind and cut the record out."""
    steps = (
        GoTo(30.0, 0.0, 8.0, 8.0),
        GoTo(0.0, 0.0, 8.0, 3.0),
        GoTo(0.0, 30.0, 8.0, 8.0),
        GoTo(0.0, 0.0, 30.0, 5.0),
        Turn(100.0),
        GoTo(0.0, 0.0, 8.0, 2.0),
        GoTo(0.0, 0.0, 30.0, 3.0),
        GoTo(0.0, 0.0, 8.0, 5.0),
        Chirp("roll", 0.08, 0.5, 6.0, 12.0),
        Chirp("pitch", 0.08, 0.5, 6.0, 12.0),
        Chirp("yaw", 0.15, 0.5, 4.0, 10.0),
        Turn(200.0),
        GoTo(20.0, 20.0, 25.0, 6.0),
        GoTo(0.0, 0.0, 8.0, 6.0),
    )
    mission, wind = Mission(takeoff=8.0, steps=steps, acceleration=3.0), Wind(speed=2.0, from_deg=220.0, gusts=0.0)
    seen = record(flown_craft(octocopter(), mission, wind, altitude=400.0, seed=5), name="octocopter")
    return replace(seen, y=seen.y + 0.01 * np.random.default_rng(5).standard_normal(seen.y.shape))


def simulated() -> list[Row]:
    """Fit the octocopter: worst error of what is determined, and the time that it takes."""
    seen, craft = flown(), octocopter()
    fit_rigid_body([seen.window(seen.t[0], seen.t[0] + 20.0)])  # compiles
    model, seconds = timed(lambda: fit_rigid_body([seen], mass=craft.mass))
    judged = ("thrust", "drag", "roll_gain", "pitch_gain")
    stated = simulated_truth(craft, model.reference_voltage, (0.0, 0.0)).parameters
    truth = {name: value for name, value in stated.items() if name.startswith(judged)}
    errors = {n: model.value(n) / v - 1.0 for n, v in truth.items() if model.parameters[n].determined}
    worst = max(errors, key=lambda n: abs(errors[n]))
    sigmas = {n: abs(model.value(n) - truth[n]) / model.parameters[n].sigma for n in errors}
    farthest = max(sigmas, key=lambda n: sigmas[n])
    minutes = seen.duration / 60.0
    return [
        row("simulated octocopter: worst error", f"{100 * errors[worst]:.1f} % ({worst})", goal="3 %"),
        row("simulated octocopter: farthest", f"{sigmas[farthest]:.1f} sigma ({farthest})", goal="2 sigma"),
        row(f"full rigid body, {minutes:.1f} min at 50 Hz, CPU s", f"{seconds:.2f}", goal="< 0.5"),
    ]


def against_aeroid() -> list[Row]:
    """Solve one output-error problem with both: 20 s of free run, nine parameters."""
    seen = flown().window(flown().t[0], flown().t[0] + 20.0)
    flight = motion(seen, seen.vehicle, float(seen.context["voltage"].median()))
    flight = Motion(
        **{
            name: value[::5] if isinstance(value, np.ndarray) and len(value) == len(flight.t) else value
            for name, value in ((f, getattr(flight, f)) for f in flight.__dataclass_fields__)
        }
    )
    ours, seconds = _ours(flight)
    try:
        import aeroid
    except ImportError:
        return [row("output error, 20 s, 9 parameters, CPU s", f"{seconds:.3f}", peer="not installed", goal="> 20")]
    theirs, their_seconds = _theirs(aeroid, flight)
    errors = _position_error(flight, ours), _position_error(flight, theirs)
    ratio = f"{their_seconds / seconds:.0f} x" if errors[0] < 1.1 * errors[1] else "another answer"
    return [
        (
            f"output error, 20 s, 9 parameters, CPU s (RMS of position {errors[0]:.3f} m, theirs {errors[1]:.3f} m)",
            f"{seconds:.3f}",
            f"{their_seconds:.1f}",
            ratio,
            "> 20",
        )
    ]


def _position_error(flight: Motion, found: dict[str, float]) -> float:
    """Run freely with what was found; the root mean square that the path is off, m."""
    values = dict.fromkeys(THETA, 0.0) | {"thrust_expo": 0.65} | found
    theta = np.array([*(values[name] for name in THETA), 0.0, 1.0, found["wind_n"], found["wind_e"]])
    path = flight.run(theta, np.ones((len(flight.t), 1)), law=0)
    return float(np.sqrt(np.mean((path[:, :3] - flight.position) ** 2)))


def _ours(flight: Motion) -> tuple[dict[str, float], float]:
    count = SHARED + len(OWN) + 2
    start, sigma = np.zeros(count), np.zeros(count)
    names = [*THETA, *OWN, "wind_n", "wind_e"]
    start[names.index("thrust_expo")], start[names.index("thrust_scale")] = 0.65, 1.0
    for name, value in SHARED_PROBLEM.items():
        start[names.index(name)], sigma[names.index(name)] = value, np.inf
    prior = Prior(start.copy(), sigma, np.full(count, -100.0), np.full(count, 100.0))
    shapes = [np.ones((len(flight.t), 1))]

    def work() -> Any:
        return fit_output_error([flight], shapes, start, prior, law=0, window_seconds=None)

    work()  # compiles
    fit, seconds = timed(work)
    found = dict(zip(names, map(float, fit.values), strict=True))
    return {name: found[name] for name in SHARED_PROBLEM}, seconds


def _theirs(aeroid, flight: Motion) -> tuple[dict[str, float], float]:
    pull = flight.density * (0.35 * flight.linear + 0.65 * flight.square)
    controls = {f"r{k}": flight.rotation[:, k] for k in range(9)} | {"pull": pull, "density": flight.density}
    states = ("x", "y", "z", "vx", "vy", "vz")

    def dynamics(_t, state, u, p):
        turn = u[:9].reshape(3, 3)
        air = turn.T @ (state[3:] - np.array([p["wind_n"], p["wind_e"], 0.0]))
        speed = np.sqrt(air @ air)
        linear = np.array([p["drag_linear_x"], p["drag_linear_y"], p["drag_linear_z"]])
        square = np.array([p["drag_quadratic_x"], p["drag_quadratic_y"], p["drag_quadratic_z"]])
        force = -u[10] * (linear + square * speed) * air
        force[2] -= p["thrust"] * u[9]
        acceleration = turn @ force
        acceleration[2] += STANDARD_GRAVITY
        return np.concatenate([state[3:], acceleration])

    model = aeroid.Model(
        states=states, controls=tuple(controls), parameters=dict(SHARED_PROBLEM), dynamics=dynamics, outputs=states[:3],
        measurement=lambda _t, state, _u, _p: state[:3],
    )  # fmt: skip
    measured = dict(zip(states, np.hstack([flight.position, flight.velocity]).T, strict=True))
    data = aeroid.FlightData(time=flight.t - flight.t[0], channels={**measured, **controls})
    result, seconds = timed(lambda: aeroid.identify(model, data, list(SHARED_PROBLEM)))
    return {name: result.parameters[name] for name in SHARED_PROBLEM}, seconds


@cache
def flight(name: str) -> Experiment:
    log = read_log(SITL / f"{name}.BIN")
    return Experiment.from_flight(log, estimate(log.tables), rate=50.0)


def firmware() -> list[Row]:
    """Judge parameters on flights of known truth from sea level to 2850 m, and prediction on others."""
    if not SITL.is_dir():
        return [row("firmware in the loop", NOT_HERE)]
    rows = []
    for names in (("octa07_loiter_sticks",), ("octa09_systemid_mixer",), ("octa01_auto_calm", "octa05_auto_quito")):
        facts = json.loads((SITL / f"{names[0]}.json").read_text())["truth"]
        model = fit_rigid_body([flight(name) for name in names], mass=facts["mass_kg"])
        volts = model.reference_voltage / facts["model_inputs"]["maxVoltage"]
        full = facts["max_thrust_per_motor_N_sea_level_static_full_voltage"] * volts**2 / facts["mass_kg"]
        expo = facts["model_inputs"]["propExpo"]
        hover = model.value("thrust") * (0.55 - 0.2475 * model.value("thrust_expo")) / (full * (0.55 - 0.2475 * expo))
        label = ", ".join(names)
        rows.append(row(f"{label}: thrust at hover command", f"{100 * (hover - 1):+.2f} %", goal="2 %"))
        for axis, inertia in (("roll", "Ixx"), ("pitch", "Iyy")):
            gain = model.parameters[f"{axis}_gain"]
            expected = facts["arm_length_m"] * full * facts["mass_kg"] / facts["inertia_kgm2"][inertia]
            text = f"{100 * (gain.value / expected - 1):+.1f} %" if gain.determined else "not determined"
            rows.append(row(f"{label}: {axis} effectiveness", text, goal="5 %"))
        momentum = facts["mdrag_coef_used"] * np.sqrt(1.225 * facts["true_prop_area_per_motor"])
        linear = momentum * np.sqrt(facts["num_motors"] * STANDARD_GRAVITY / facts["mass_kg"])
        drag = linear * 4.0 + 0.6125 * facts["areaCd_m2"] / facts["mass_kg"] * 16.0
        for axis in "xyz":
            text = f"{100 * (model.drag(axis, 4.0)[0] / drag - 1.0):+.1f} %"
            known = model.parameters[f"drag_quadratic_{axis}"].determined
            what = f"{label}: drag along {axis} at 4 m/s"
            rows.append(row(what, text if known else "not determined", goal="15 %"))
    model = fit_rigid_body([flight("octa01_auto_calm"), flight("octa07_loiter_sticks")])
    result = validate(model, [flight("octa02_auto_wind2"), flight("octa05_auto_quito")], horizons=(1.0, 5.0))
    for horizon, target in ((1.0, "0.03 m"), (5.0, "0.35 m")):
        part = result.horizons[result.horizons["horizon"] == horizon]
        ratio = (part["rmse_constant_velocity"] / part["rmse"]).min()
        rows.append(
            (
                f"{horizon:g} s ahead on other flights, worst axis",
                f"{part['rmse'].max():.3f} m",
                f"{part['rmse_constant_velocity'].max():.2f} m (constant velocity)",
                f"{ratio:.0f} x at least",
                target,
            )
        )
    return rows


def paper_protocol() -> list[Row]:
    """Fit three flights of the core paper's protocol, run freely over every other flight of it."""
    if not SITL.is_dir():
        return [row("core paper's protocol", NOT_HERE)]
    model = fit_rigid_body([flight(f"paper0{k}") for k in (1, 2, 3)])
    others = [flight(path.stem) for path in sorted(SITL.glob("paper*.BIN")) if path.stem[-2:] not in ("01", "02", "03")]
    rows = []
    for seconds, what in ((None, "whole flight"), (30.0, "first 30 s")):
        average = validate(model.trimmed(others, seconds=seconds), others, horizons=()).average
        numbers = listed(average[axis] for axis in "xyz")
        label = f"paper protocol, {len(others)} flights, wind and thrust scale from {what}: RMSE x, y, z"
        rows.append(
            row(
                label,
                f"{numbers} m",
                peer="Elhesasy 2024, own flights",
                goal="0.32, 0.27, 0.25 m" if not seconds else "-",
            )
        )
    return rows
