"""Hand-made flights: just enough of a log and its trajectory to cut records from."""

from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from estimation import STATE_COLUMNS
from logparse import Tables, Vehicle
from tests.timed import timed


@dataclass
class Log:
    tables: Tables
    flight: object
    vehicle: Vehicle
    path: Path = Path("flight.bin")


class PartsOfLog(SimpleNamespace):
    """A log of the parts that a test needs, which keeps nothing that is made of them."""

    def derived(self, make, *given):
        return make(self, *given)


def made(tables=None, vehicle=None, flight=(10.0, 50.0), north=None, east=None, down=None, yaw=0.0):
    """Make a flight of 60 s with states at 50 Hz, a given path [m] and heading [rad] over time."""
    t = np.arange(0.0, 60.0, 0.02)
    zero = np.zeros_like(t)
    position = {"p_n": north, "p_e": east, "p_d": down}
    states = dict.fromkeys(STATE_COLUMNS, zero) | {"f_z": zero - 9.8}
    for name, path in position.items():
        states[name] = zero if path is None else path(t)
        states[name.replace("p_", "v_")] = np.gradient(states[name], t)
    heading = yaw(t) if callable(yaw) else zero + yaw
    states |= {"q_w": np.cos(heading / 2.0), "q_z": np.sin(heading / 2.0)}
    sigma = timed(t, **{f"phi_{axis}": np.full_like(t, 1e-3) for axis in "ned"})
    trajectory = SimpleNamespace(
        states=timed(t, **states), sigma=sigma, origin=None, inconsistency="", unknown_position=lambda start, stop: ""
    )
    interval = flight and SimpleNamespace(start=flight[0], stop=flight[1])
    return Log(tables or Tables(), interval, vehicle or Vehicle()), trajectory
