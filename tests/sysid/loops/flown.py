"""A simulated craft flown with a chirp, as loop records; and its true loop."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulation.axis_loop import AxisPlant, AxisRun, LoopGains, Shaking, run_axis, settings_of
from sysid.frequency.records import AxisRecord
from sysid.loops.loop import LoopRecord, RateLoop, loop_of_records


def bending(gain: float, *, mode: tuple[float, float, float], **plant: float) -> AxisPlant:
    """Return a craft whose frame has a mode: its frequency [Hz], damping and part of the acceleration."""
    hz, damping, share = mode
    return AxisPlant(gain=gain, flex_hz=hz, flex_damping=damping, flex_share=share, **plant)


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
    shaken = Shaking(
        duration=seconds,
        chirp=(*band, magnitude),
        chirp_seconds=seconds,
        chirp_fades=fades,
        gust=gust,
        gyro_noise=noise,
    )
    return run_axis(plant, gains, shaken, seed)


def records_of_flight(flight: AxisRun, name: str = "simulated") -> tuple[LoopRecord, ...]:
    """Cut the record of a flight's chirp from rows logged at 100 Hz."""
    rows = slice(None, None, 4)

    def record(output: NDArray[np.float64]) -> AxisRecord:
        return AxisRecord(
            name=name,
            start=0.0,
            dt=float(flight.t[4]),
            inputs=flight.output[rows, None],
            output=output[rows],
            instruments=flight.chirp[rows, None],
            usable=np.ones(len(flight.t[rows]), dtype=bool),
            band=flight.excitation.chirp[:2],
            instrument="chirp",
        )

    return (LoopRecord(record(flight.measured), record(flight.feedback)),)


def loop_of_flight(flight: AxisRun, plant: AxisPlant, gains: LoopGains, name: str = "simulated") -> RateLoop:
    """Identify the loop from a flight's chirp."""
    return loop_of_records(name, records_of_flight(flight, name), settings_of(plant, gains))


def flown_loop(plant: AxisPlant, gains: LoopGains, seed: int, name: str = "simulated", **shaken: Any) -> RateLoop:
    """Fly a chirp and identify the loop from it."""
    return loop_of_flight(fly_chirp(plant, gains, seed=seed, **shaken), plant, gains, name)
