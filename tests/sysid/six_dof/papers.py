"""The papers' craft measured by motion capture, and what a body with six degrees of freedom should find of them."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from simulation.vehicle import Multirotor
from sysid import Experiment, SixDofModel
from sysid.rigid_body.six_dof.body_record import BodyQuantity
from tests.sysid.craft_flights import flight
from tests.sysid.honesty import Stated

#: Noise of motion capture over that of an autopilot's sensors.
NOISE = 0.2
#: Of the rotors' telemetry, rad/s.
SPEED_NOISE = 0.5
#: Speed at which drag is judged as a whole, m/s: the simulator's linear drag does not go with rotor speed, as the
#: model's does, so that the two parts trade.
DRAG_SPEED = 2.5
RATE = 100.0
AIR = 1.225


def measured(craft: Multirotor, seed: int, quantity: BodyQuantity, seconds: float = 80.0) -> Experiment:
    """Fly a craft, every motor shaken by itself, and measure its motion with its rotor speeds or its PWM."""
    record = flight(craft, seed, duration=seconds, rate=RATE, noise=NOISE, wander=4.0, shake=0.05, density=AIR)
    names = record.input_names
    units = dict.fromkeys(names, str(quantity))
    if quantity is BodyQuantity.PWM:
        return replace(record, units=units)
    speeds = record.context[[f"rotor_speed_{name[1:]}" for name in names]].to_numpy()
    noise = SPEED_NOISE * np.random.default_rng(seed + 1000).standard_normal(speeds.shape)
    return replace(record, u=speeds + noise, units=units)


def truth(craft: Multirotor, model: SixDofModel) -> dict[str, float]:
    """Return what is true of the parameters whose truth is known, in the units of the model."""
    speeds = model.kinds.quantity is BodyQuantity.SPEED
    thrusts = np.array([mount.rotor.thrust(1.0, AIR) for mount in craft.rotors])
    torques = np.array([mount.rotor.torque(1.0, AIR) for mount in craft.rotors])
    full = (1.0 if speeds else craft.drive.speed_max**2) * model.shape.scale
    inertia, arm = np.diag(craft.inertia), float(np.hypot(*craft.rotors[0].position[:2]))
    out = {
        "thrust": thrusts.mean() * full / craft.mass,
        "roll_gain": thrusts.mean() * full * arm / inertia[0],
        "pitch_gain": thrusts.mean() * full * arm / inertia[1],
        "inertia_x": (inertia[1] - inertia[2]) / inertia[0],
        "inertia_y": (inertia[2] - inertia[0]) / inertia[1],
        "inertia_z": (inertia[0] - inertia[1]) / inertia[2],
        **dict.fromkeys(("tilt_x", "tilt_y", "roll_offset", "pitch_offset"), 0.0),
        **dict.fromkeys(("roll_damping", "pitch_damping", "yaw_damping", "roll_by_speed", "pitch_by_speed"), 0.0),
    }
    alike = np.ptp(torques / thrusts) < 1e-3 * torques.max() / thrusts.max()
    if alike:
        out |= {"yaw_gain": torques.mean() * full / inertia[2], "yaw_offset": 0.0}
    for k, share in enumerate(thrusts / thrusts.mean(), start=1):
        out[f"share_m{k}"] = float(share)
        if speeds:
            out[f"telemetry_lag_m{k}"] = 0.0
        else:
            # A command is held over its sample, which is worth half of one.
            out |= {f"delay_m{k}": 0.5 / RATE, f"lag_m{k}": craft.drive.response.time_constant}
    if not speeds:
        out |= {"expo": craft.drive.expo, "thrust_drift": 0.0}
    return out


def stated(model: SixDofModel, craft: Multirotor, name: str) -> Iterator[Stated]:
    """Yield what a model states of a craft; parameters of one kind, such as the motors' lags, under one name."""
    expected, method = truth(craft, model), f"six degrees of freedom, {model.kinds.quantity}"
    for parameter in model.parameters.values():
        if parameter.value is not None and parameter.sigma is not None and parameter.name in expected:
            kind = parameter.name.partition("_m")[0] if parameter.name[-1].isdigit() else parameter.name
            yield Stated(name, method, kind, parameter.value, parameter.sigma, expected[parameter.name])
    for k, axis in enumerate("xyz"):
        weights = {f"drag_rotor_{axis}": 1.0, f"drag_quadratic_{axis}": DRAG_SPEED}
        at = [model.estimated.index(weight) for weight in weights]
        slope = np.array(list(weights.values()))
        sigma = float(np.sqrt(slope @ model.covariance[np.ix_(at, at)] @ slope))
        whole = sum(factor * model.value(weight) for weight, factor in weights.items())
        drag = (craft.drag_linear[k] + DRAG_SPEED * 0.5 * AIR * craft.drag_area[k]) / craft.mass
        yield Stated(name, method, f"drag at {DRAG_SPEED:g} m/s over speed, {axis}", whole, sigma, drag)
