"""A level flight whose four motors follow slow independent signals, of known thrust."""

import numpy as np
import pandas as pd

from logparse import Vehicle
from sysid import Experiment

CRAFT = Vehicle(pwm_min=1000.0, pwm_max=2000.0, spin_min=0.15, spin_max=0.95, thrust_expo=0.6)


def flight(
    seed=0, samples=1200, per_mass=(3.2, 3.2, 3.2, 3.2), density=1.1, spread=0.05, vehicle=CRAFT, told=None, **context
):
    """Make a level flight whose motors follow four independent slow signals, thrust by the autopilot's curve."""
    rng = np.random.default_rng(seed)
    t = np.arange(samples) * 0.1
    slow = np.cumsum(rng.standard_normal((samples, 4)), axis=0)
    slow = slow - slow.mean(axis=0)
    c = np.clip(0.75 + spread * slow / slow.std(axis=0), 0.05, 0.95)
    pwm = 1000.0 + 1000.0 * (0.15 + c * 0.8)
    thrust = density / 1.225 * (0.4 * c + 0.6 * c**2)
    columns = {
        "f_z": -thrust @ np.array(per_mass) + 0.05 * rng.standard_normal(samples),
        "roll": 0.0,
        "pitch": 0.0,
        "yaw": 0.0,
        "v_n": 0.0,
        "v_e": 0.0,
        "v_d": 0.0,
        "density": density if told is None else told,
        "voltage": 16.0,
    } | context
    return Experiment.from_arrays(
        t,
        pwm,
        np.zeros(samples),
        name=f"flight {seed}",
        input_names=["m1", "m2", "m3", "m4"],
        context=pd.DataFrame(columns, index=t),
        vehicle=vehicle,
    )
