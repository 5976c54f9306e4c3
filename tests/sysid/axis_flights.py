"""One axis flown by `simulation.axis_loop`, whose response is a formula: as a log that was read, or as records.

`flown` and `logged` give logs, `recorded` rows of a run, `flown_loop` and `loop_of_flight` the loop that a chirp tells.
"""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from logparse import FlightLog, read_log
from simulation.axis_loop import (
    AxisPlant,
    AxisRun,
    LoopGains,
    Shaking,
    gains_of,
    run_axis,
    settings_of,
    true_loop,
    write_rate_log,
)
from sysid.frequency.records import AxisRecord
from sysid.loops.controller import LoopSettings
from sysid.loops.loop import LoopRecord, RateLoop, loop_of_records
from sysid.loops.margins import margins_of
from sysid.loops.search import AxisTuning

PLANT = AxisPlant(gain=300.0, damping=2.0, lag=0.03, delay=0.004)
GAINS = LoopGains.crossing_at(PLANT, 3.0)
CHIRP = Shaking(duration=40.0, chirp=(0.4, 40.0, 0.08), chirp_seconds=39.0, gust=0.4, noise=0.005)
STICKS = Shaking(duration=90.0, stick=0.2, gust=0.2, noise=0.003)
#: Frequencies of true margins.
HZ = np.geomspace(0.1, 120.0, 4000)
#: The published procedure's chirp.
PROCEDURE = {"band": (0.1, 10.0), "seconds": 121.0, "fades": (5.0, 5.0)}


def bending(gain: float, *, mode: tuple[float, float, float], **plant: float) -> AxisPlant:
    """Return a craft whose frame has a mode: its frequency [Hz], damping and part of the acceleration."""
    hz, damping, share = mode
    return AxisPlant(gain=gain, flex_hz=hz, flex_damping=damping, flex_share=share, **plant)


def logged(
    folder: Path,
    axes: AxisRun | dict[str, AxisRun],
    *,
    rate: float = 100.0,
    gains: LoopGains | None = None,
    **how: Any,
) -> FlightLog:
    """Log axes by name, or one that rolled, with its terms under `gains`; `how` as for `write_rate_log`."""
    path = folder / f"{len(list(folder.iterdir()))}.BIN"
    axes = axes if isinstance(axes, dict) else {"roll": axes}
    write_rate_log(path, axes, rate=rate, gains=None if gains is None else {"roll": gains}, **how)
    return read_log(path)


def flown(
    folder: Path, excitation: Shaking = CHIRP, seed: int = 1, plant: AxisPlant = PLANT, rate: float = 100.0
) -> FlightLog:
    """Fly a craft whose loop crosses over at 3 Hz, and log its roll."""
    run = run_axis(plant, LoopGains.crossing_at(plant, 3.0), excitation, seed)
    return logged(folder, run, rate=rate, filter_hz=plant.filter_hz)


def recorded(
    run: AxisRun, rate: float, band: tuple[float, float], *, instrument: str, output: str = "measured", name: str
) -> AxisRecord:
    """Cut rows at a rate [Hz] from a run: its output to the mixer, a signal, and the chirp or stick that asked."""
    rows = slice(None, None, round(400.0 / rate))
    return AxisRecord(
        name=name,
        start=0.0,
        dt=1.0 / rate,
        inputs=run.output[rows, None],
        output=getattr(run, output)[rows],
        instruments=getattr(run, instrument)[rows, None],
        usable=np.ones(len(run.t[rows]), dtype=bool),
        band=band,
        instrument=instrument,
    )


def fly_chirp(
    plant: AxisPlant,
    gains: LoopGains,
    *,
    seed: int,
    magnitude: float = 0.05,
    band: tuple[float, float] = (0.5, 40.0),
    gust: float = 0.3,
    noise: float = 0.015,
    seconds: float | None = None,
    fades: tuple[float, float] = (1.0, 1.0),
) -> AxisRun:
    """Fly a chirp at the mixer from hover, with gusts [rad/s^2] and noise of the raw gyro [rad/s]."""
    seconds = seconds or 2.0 / band[0] + 21.0
    chirp = {"chirp": (*band, magnitude), "chirp_seconds": seconds, "chirp_fades": fades}
    return run_axis(plant, gains, Shaking(duration=seconds, **chirp, gust=gust, gyro_noise=noise), seed)


def records_of_flight(run: AxisRun, name: str = "simulated") -> tuple[LoopRecord, ...]:
    """Cut the record of a flight's chirp from rows logged at 100 Hz: the rate, and what the controller heard of it."""
    band = run.excitation.chirp[:2]
    outputs = ("measured", "feedback")
    return (
        LoopRecord(*(recorded(run, 100.0, band, instrument="chirp", output=signal, name=name) for signal in outputs)),
    )


def loop_of_flight(run: AxisRun, plant: AxisPlant, gains: LoopGains, name: str = "simulated") -> RateLoop:
    """Identify the loop from a flight's chirp."""
    return loop_of_records(name, records_of_flight(run, name), settings_of(plant, gains))


def true_margins(plant: AxisPlant, flown: LoopGains | LoopSettings) -> dict[str, float]:
    """Return the margins that a craft has with these gains, by its formula."""
    gains = flown if isinstance(flown, LoopGains) else gains_of(flown)
    return margins_of(HZ, true_loop(plant, gains, HZ)).row(0)


def kept_promise(plant: AxisPlant, tuning: AxisTuning) -> dict[str, float]:
    """Return the true margins of what was proposed for a craft, which are no worse than what was promised."""
    assert tuning.tuned is not None, tuning.refused
    truth = true_margins(plant, tuning.tuned.settings)
    assert truth["stable"]
    assert not truth["gain_db"] < tuning.worst["gain_db"]  # none has no gain margin
    assert truth["phase_deg"] >= tuning.worst["phase_deg"]
    assert truth["peak_db"] <= tuning.worst["peak_db"]
    return truth


def procedure_loop(plant: AxisPlant, gains: LoopGains, seed: int) -> RateLoop:
    """Fly the published procedure with I at 0: a larger chirp for craft that answer less than 300 rad/s^2."""
    magnitude = 0.1 if plant.gain < 300.0 else 0.05
    return flown_loop(plant, replace(gains, I=0.0), seed, magnitude=magnitude, **PROCEDURE)


@lru_cache(maxsize=16)
def flown_loop(plant: AxisPlant, gains: LoopGains, seed: int, name: str = "simulated", **shaken: Any) -> RateLoop:
    """Fly a chirp and identify the loop from it; several tests ask for the same."""
    return loop_of_flight(fly_chirp(plant, gains, seed=seed, **shaken), plant, gains, name)
