"""A level flight whose four motors follow slow independent signals, of known thrust."""

import numpy as np

from logparse import Vehicle
from tests.sysid.simulated_craft import of_craft

CRAFT = Vehicle(pwm_min=1000.0, pwm_max=2000.0, spin_min=0.15, spin_max=0.95, thrust_expo=0.6)


def flight(
    seed=0,
    samples=1200,
    per_mass=(3.2, 3.2, 3.2, 3.2),
    density=1.1,
    spread=0.05,
    vehicle=CRAFT,
    recorded_density=None,
    **context,
):
    """Make a level flight whose motors follow four independent slow signals, thrust by the autopilot's curve."""
    rng = np.random.default_rng(seed)
    t = np.arange(samples) * 0.1
    slow = np.cumsum(rng.standard_normal((samples, 4)), axis=0)
    slow = slow - slow.mean(axis=0)
    c = np.clip(0.75 + spread * slow / slow.std(axis=0), 0.05, 0.95)
    pwm = 1000.0 + 1000.0 * (0.15 + c * 0.8)
    thrust = density / 1.225 * (0.4 * c + 0.6 * c**2)
    force = -thrust @ np.array(per_mass) + 0.05 * rng.standard_normal(samples)
    columns = dict.fromkeys(("roll", "pitch", "yaw", "v_n", "v_e", "v_d"), 0.0)
    columns |= {
        "f_z": force,
        "density": density if recorded_density is None else recorded_density,
        "voltage": 16.0,
    } | context
    return of_craft(t, pwm, np.zeros((samples, 3)), columns, vehicle, f"flight {seed}")
