"""Logs of a simulated rate loop, whose response is a formula, written and read again."""

from pathlib import Path
from typing import Any

from logparse import FlightLog, read_log
from simulation.axis_loop import AxisPlant, AxisRun, LoopGains, Shaking, run_axis, write_rate_log

PLANT = AxisPlant(gain=300.0, damping=2.0, lag=0.03, delay=0.004)
GAINS = LoopGains.crossing_at(PLANT, 3.0)
CHIRP = Shaking(duration=40.0, chirp=(0.4, 40.0, 0.08), chirp_seconds=39.0, gust=0.4, noise=0.005)
STICKS = Shaking(duration=90.0, stick=0.2, gust=0.2, noise=0.003)


def logged(folder: Path, axes: AxisRun | dict[str, AxisRun], *, rate: float = 100.0, **how: Any) -> FlightLog:
    """Log axes by name, or one that rolled, in a file of its own in the folder; `how` as for `write_rate_log`."""
    path = folder / f"{len(list(folder.iterdir()))}.BIN"
    write_rate_log(path, axes if isinstance(axes, dict) else {"roll": axes}, rate=rate, **how)
    return read_log(path)


def flown(
    folder: Path, excitation: Shaking = CHIRP, seed: int = 1, plant: AxisPlant = PLANT, rate: float = 100.0
) -> FlightLog:
    """Fly a craft whose loop crosses over at 3 Hz, and log its roll."""
    run = run_axis(plant, LoopGains.crossing_at(plant, 3.0), excitation, seed)
    return logged(folder, run, rate=rate, filter_hz=plant.filter_hz)
