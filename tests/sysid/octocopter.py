"""The octocopter of Elhesasy 2024 on an exciting flight, its rigid body, and level motion for the kernels."""

from functools import cache

import numpy as np

from core.units import STANDARD_GRAVITY
from simulation.elhesasy2024 import octocopter
from simulation.place import Wind
from sysid import fit_rigid_body
from sysid.rigid_body.body_motion import BodyMotion
from tests.sysid.flown_craft import flown, record

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
