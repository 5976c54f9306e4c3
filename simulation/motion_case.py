"""The three flights of Motion 2018 as cases."""

import math
from pathlib import Path

import numpy as np
import pandas as pd

from simulation.atmosphere import GRAVITY
from simulation.motion2018 import (
    ACCELERATION_LIMIT,
    SPATIAL,
    SPEED_LIMIT,
    VERTICAL,
    WITH_WIND,
    Flight,
    fly_to_point,
    in_paper_axes,
    quadcopter,
)
from simulation.outcome import Fact, Outcome, Plot
from simulation.paper_log import write_paper_log

#: Name, summary and settings of each flight of section 3.
FLIGHTS = (
    ("motion-vertical", "Motion 2018: straight up from (0, 10, 17) to (0, 25, 17)", VERTICAL),
    ("motion-spatial", "Motion 2018: from (5, 3, 16) to (48, 35, 81)", SPATIAL),
    ("motion-wind", "Motion 2018: from (5, 3, 16) to (48, 35, 81) against 0.5 m/s of wind along x", WITH_WIND),
)

_NOTES = (
    "Masses, dimensions, coefficients of the drive and gains are not printed; they are chosen (docs/simulation.md), "
    "so times and peaks are those of this craft.",
    "Printed senses of rotation (1 and 3 clockwise, 2 and 4 against, 1 and 2 on one beam) leave yaw without control; "
    "here 1 and 2 turn clockwise.",
    "The paper adds the wind to the craft's velocity; here it acts through the drag, and the autopilot's integral "
    "holds against it.",
)


def simulate(name: str, summary: str, settings: Flight) -> Outcome:
    """Fly from start to target.

    Parameters
    ----------
    name : str
        Name of the case, which its log has too.
    summary : str
        What it shows, in a line.
    settings : Flight
        What the user chose.
    """
    flown = fly_to_point(settings)
    path = in_paper_axes(flown)
    per_row = max(round(0.01 / (path.index[1] - path.index[0])), 1)
    rows = pd.concat((path.iloc[:-1:per_row], path.iloc[-1:]))

    def write_log(folder: Path) -> list[Path]:
        x, y, z = settings.wind
        craft = quadcopter(settings.mass)
        return write_paper_log(flown, craft, folder, name, summary, gravity=GRAVITY, wind=(x, z, -y))

    units = {"x": "x_m", "y": "y_m", "z": "z_m", "v_x": "v_x_m_s", "v_y": "v_y_m_s", "v_z": "v_z_m_s"}
    units |= {f"w{k}": f"w{k}_rad_s" for k in range(1, 5)} | {f"a{k}": f"a{k}_rad_s2" for k in range(1, 5)}
    return Outcome(
        name=name,
        summary=summary,
        facts=_facts(settings, path),
        notes=_NOTES,
        plots=_plots(rows),
        history=rows.rename(columns=units).rename_axis("t_s"),
        write_log=write_log,
    )


def _facts(settings: Flight, path: pd.DataFrame) -> tuple[Fact, ...]:
    places, velocities = path[["x", "y", "z"]].to_numpy(), path[["v_x", "v_y", "v_z"]].to_numpy()
    speeds = np.linalg.norm(velocities, axis=1)
    rotors = path[["w1", "w2", "w3", "w4"]].to_numpy()
    accelerations = np.abs(path[["a1", "a2", "a3", "a4"]].to_numpy())

    def point(values: np.ndarray | tuple[float, ...]) -> str:
        return ", ".join(f"{value:.3g}" for value in values)

    return (
        Fact("start (x, y, z)", point(settings.start), "m"),
        Fact("target (x, y, z)", point(settings.target), "m"),
        Fact("wind (x, y, z)", point(settings.wind), "m/s"),
        Fact("step of Euler's method", settings.step, "s"),
        Fact("time of arrival", float(path.index[-1]), "s"),
        Fact("distance from the target at arrival", float(np.linalg.norm(places[-1] - settings.target)), "m"),
        Fact("speed at arrival", float(speeds[-1]), "m/s"),
        Fact("straight distance", math.dist(settings.start, settings.target), "m"),
        Fact("length of the path", float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum()), "m"),
        Fact("greatest speed", float(speeds.max()), "m/s"),
        Fact("mean speed", float(speeds.mean()), "m/s"),
        Fact("rotor speeds", f"{rotors.min():.0f} to {rotors.max():.0f}", f"rad/s (limit {SPEED_LIMIT:g})"),
        Fact("greatest rotor acceleration", float(accelerations.max()), f"rad/s² (limit {ACCELERATION_LIMIT:g})"),
    )


def _plots(rows: pd.DataFrame) -> tuple[Plot, ...]:
    speeds = rows[["v_x", "v_y", "v_z"]].rename(columns={"v_x": "x", "v_y": "y (up)", "v_z": "z"})
    return (
        Plot(
            "Coordinates in the paper's axes: x forward, y up, z right (figures 3, 7 and 11).",
            "coordinate (m)",
            rows[["x", "y", "z"]].rename(columns={"y": "y (up)"}),
        ),
        Plot("Velocities (figures 4, 8 and 12).", "velocity (m/s)", speeds),
        Plot(
            "Speeds of the rotors (figures 5, 9 and 13); the drive's limit is 490 rad/s.",
            "rotor speed (rad/s)",
            rows[["w1", "w2", "w3", "w4"]].rename(columns=lambda name: f"rotor {name[1:]}"),
        ),
        Plot(
            "Accelerations of the rotors (figures 6, 10 and 14); the drive's limit is 500 rad/s².",
            "rotor acceleration (rad/s²)",
            rows[["a1", "a2", "a3", "a4"]].rename(columns=lambda name: f"rotor {name[1:]}"),
        ),
    )
