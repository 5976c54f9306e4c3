"""The recovery of Kim 2017 (section on simulation, figure 12) as a case."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from simulation import kim2017
from simulation.atmosphere import GRAVITY
from simulation.errors import DivergenceError, ParameterError
from simulation.outcome import Fact, Outcome, Plot
from simulation.paper_log import write_paper_log


@dataclass(frozen=True, slots=True, kw_only=True)
class Recovery:
    """What of the recovery can be changed."""

    voltage: float = 16.0  #: Of the battery, V: coefficients and gain follow it.
    #: Where the craft starts, deg.
    roll: float = 20.0
    pitch: float = 20.0
    duration: float = 20.0  #: s.
    #: Gains of the height loop; see `kim2017.HeightGains`.
    height_p: float = -80.0
    height_i: float = -200.0
    height_rate: float = -120.0

    def __post_init__(self) -> None:
        if not (abs(self.roll) <= 85.0 and abs(self.pitch) <= 85.0):
            raise ParameterError(f"roll {self.roll:g} and pitch {self.pitch:g} deg must lie within 85 deg")
        if not 0.5 <= self.duration <= 600.0:
            raise ParameterError(f"duration {self.duration:g} s must lie in 0.5 to 600 s")


_NOTES = (
    "The printed height PI (Kp -80, Ki -200) alone cannot hold height: its cubic has roots to the right for any "
    "actuation. A term on the climb rate is added.",
    "The printed inertias (3.63, 3.25, 5.51 kg m²) are about a hundred times those of a craft of 2.6 kg, but the "
    "printed input matrix and gain rest on them, so they are used.",
    "Table 2 with Table 3 lifts 94 % of the weight at 16 V; the integral of the height loop supplies the rest.",
)


def simulate(name: str, summary: str, settings: Recovery) -> Outcome:
    """Level the craft from the start of Table 5.

    Parameters
    ----------
    name : str
        Name of the case, which its log has too.
    summary : str
        What it shows, in a line.
    settings : Recovery
        What the user chose.
    """
    height_gains = kim2017.HeightGains(
        proportional=settings.height_p, integral=settings.height_i, rate=settings.height_rate
    )
    fault = kim2017.height_fault(height_gains, settings.voltage)
    try:
        path = kim2017.recovery(
            voltage=settings.voltage,
            duration=settings.duration,
            roll_deg=settings.roll,
            pitch_deg=settings.pitch,
            height=height_gains,
        )
    except DivergenceError as error:
        if not fault:
            raise
        raise DivergenceError(f"{error}; {fault}") from error
    w, x, y, z = (path[f"q_{axis}"] for axis in "wxyz")
    angles = pd.DataFrame(
        {
            "roll": np.degrees(np.arctan2(2 * (y * z + w * x), 1 - 2 * (x * x + y * y))),
            "pitch": np.degrees(np.arcsin(np.clip(2 * (w * y - x * z), -1.0, 1.0))),
            "yaw": np.degrees(np.unwrap(np.arctan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z)))),
        },
        index=path.index,
    )

    def write_log(folder: Path) -> list[Path]:
        return write_paper_log(path, kim2017.quadcopter(settings.voltage), folder, name, summary, gravity=GRAVITY)

    rows = slice(None, None, 10)
    rates = path[["w_x", "w_y", "w_z"]].rename(columns={"w_x": "roll rate", "w_y": "pitch rate", "w_z": "yaw rate"})
    speeds = path[["w1", "w2", "w3", "w4"]].rename(columns=lambda column: f"motor {column[1:]}")
    height = pd.DataFrame({"height above the target": -path["p_d"]})
    history = pd.concat((angles.add_suffix("_deg"), path), axis=1).iloc[rows].rename_axis("t_s")
    return Outcome(
        name=name,
        summary=summary,
        facts=_facts(settings, path, angles),
        notes=(f"{fault[0].upper()}{fault[1:]}.", *_NOTES) if fault else _NOTES,
        fault=fault,
        plots=(
            Plot(
                "Roll and pitch go to zero (figure 12).",
                "angle (deg)",
                angles[["roll", "pitch"]].iloc[rows],
            ),
            Plot("Yaw is not controlled and turns on (figure 12).", "yaw (deg)", angles[["yaw"]].iloc[rows]),
            Plot("Angular rates.", "rate (deg/s)", rates.iloc[rows] * (180.0 / np.pi)),
            Plot("Height: the craft starts 0.30 m below its target.", "height (m)", height.iloc[rows]),
            Plot("Speeds of the rotors.", "rotor speed (rad/s)", speeds.iloc[rows]),
        ),
        history=history,
        write_log=write_log,
    )


def _facts(settings: Recovery, path: pd.DataFrame, angles: pd.DataFrame) -> tuple[Fact, ...]:
    gain = kim2017.gain(settings.voltage)
    columns = [0, 1, 2, 3, 5, 6]
    off = np.abs(gain[:, columns] / kim2017.PRINTED_GAIN[:, columns] - 1.0).max()
    level = angles[["roll", "pitch"]].abs().max(axis=1)
    outside = level.index[level > 1.0]
    below = path.index[path["p_d"].abs() > 0.05]

    def after(times: pd.Index) -> float | str:
        if len(times) == 0:
            return 0.0
        return float(times[-1]) if times[-1] < path.index[-1] else "not within the flight"

    levelled, reached = after(outside), after(below)
    return (
        Fact("battery voltage", settings.voltage, "V"),
        Fact("start: roll, pitch", f"{settings.roll:g}, {settings.pitch:g}", "deg"),
        Fact("gain against eq. 25 (16 V), largest difference", 100.0 * float(off), "%"),
        Fact("roll and pitch within 1 deg after", levelled, "" if isinstance(levelled, str) else "s"),
        Fact("height within 5 cm after", reached, "" if isinstance(reached, str) else "s"),
        Fact("yaw rate at the end", float(np.degrees(path["w_z"].iloc[-1])), "deg/s"),
        Fact("drift north, east", f"{path['p_n'].iloc[-1]:.2f}, {path['p_e'].iloc[-1]:.2f}", "m"),
        Fact("greatest rotor speed", float(path[["w1", "w2", "w3", "w4"]].max().max()), "rad/s"),
    )
