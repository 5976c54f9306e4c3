"""A hover with chirps on roll, pitch and yaw, in ArduCopter's own rate and angle loops."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from logparse import RotoridError
from simulation.axis_loop import (
    TERMS,
    AxisPlant,
    AxisRun,
    LoopGains,
    Shaking,
    run_axis,
    settings_of,
    true_loop,
    write_rate_log,
)
from simulation.errors import ParameterError
from simulation.outcome import CaseOutcome, CasePlot, Fact
from sysid.loops.controller import AXES
from sysid.loops.margins import margins_of
from sysid.loops.parameter_file import read_parameter_file

#: A survey quadcopter of 2 kg: how each axis answers the mixer.
PLANTS = {
    "roll": AxisPlant(gain=210.0, damping=1.2, lag=0.028, delay=0.003, filter_hz=40.0),
    "pitch": AxisPlant(gain=170.0, damping=1.0, lag=0.028, delay=0.003, filter_hz=40.0),
    "yaw": AxisPlant(gain=28.0, damping=0.6, lag=0.04, delay=0.003, filter_hz=40.0),
}
#: Gains as somebody may have left them: firmware's defaults in the air frame of another craft.
GAINS = {
    "roll": LoopGains(P=0.08, I=0.08, D=0.0016),
    "pitch": LoopGains(P=0.1, I=0.1, D=0.002),
    "yaw": LoopGains(P=0.25, I=0.025, D=0.0, FLTE=20.0, FLTD=0.0, angle_P=3.0),
}
#: Length of a chirp and of the hover before, between and after [s], and frequencies from and to [Hz].
_CHIRP, _PAUSE, _BAND = 28.0, 6.0, (0.5, 40.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Chirps:
    """What of the flight can be changed."""

    #: File of gains and filters to fly with, such as proposed.param of `rotorid tune`; none: those that the craft has.
    parameters: str = ""
    magnitude: float = 0.06  #: Of the chirps at the mixer; 1 is all that there is.
    gusts: float = 0.4  #: Standard deviation of the roll acceleration by the air, rad/s^2; other axes by their gain.
    rate: float = 200.0  #: Rows a second of RATE, PID and SIDD messages; a divisor of 400.
    seed: int = 1

    def __post_init__(self) -> None:
        if not 0.0 < self.magnitude <= 0.3:
            raise ParameterError(f"magnitude {self.magnitude:g} must lie in 0 to 0.3, where motors have room")
        if not 0.0 <= self.gusts <= 20.0:
            raise ParameterError(f"gusts {self.gusts:g} rad/s^2 must lie in 0 to 20")
        if not (10.0 <= self.rate <= 400.0 and (400.0 / self.rate).is_integer()):
            raise ParameterError(f"rate {self.rate:g} Hz must be 400 over a whole number, and at least 10")


def simulate(name: str, summary: str, settings: Chirps) -> CaseOutcome:
    """Fly the three chirps one after the other."""
    filter_hz, gains = _set(_read(settings.parameters))
    plants = {axis: replace(plant, filter_hz=filter_hz) for axis, plant in PLANTS.items()}
    runs = {axis: _fly(plants[axis], gains[axis], number, settings) for number, axis in enumerate(plants)}
    facts = (
        Fact("gains", Path(settings.parameters).name if settings.parameters else "the craft's own"),
        *(fact for axis in plants for fact in _facts(axis, plants[axis], gains[axis])),
    )

    def write_log(folder: Path) -> list[Path]:
        log, truth = folder / f"{name}.bin", folder / f"{name}.json"
        write_rate_log(log, runs, rate=settings.rate, filter_hz=filter_hz, gains=gains)
        stated = {fact.name: fact.value if isinstance(fact.value, str) else round(fact.value, 4) for fact in facts}
        truth.write_text(json.dumps({"what": "simulated by rotorid, not flown", "truth": stated}, indent=1) + "\n")
        return [log, truth]

    rows = slice(None, None, 20)
    t = next(iter(runs.values())).t[rows]
    angles = pd.DataFrame({axis: np.degrees(run.attitude[rows]) for axis, run in runs.items()}, index=t)
    outputs = pd.DataFrame({axis: run.output[rows] for axis, run in runs.items()}, index=t)
    history = pd.concat((angles.add_suffix("_deg"), outputs.add_suffix("_output")), axis=1)
    return CaseOutcome(
        name=name,
        summary=summary,
        facts=facts,
        plots=(
            CasePlot("Angles: each axis swings while its chirp is slow.", "angle (deg)", angles),
            CasePlot("What the rate controllers and the chirps give to the mixer.", "part of full output", outputs),
        ),
        history=history.rename_axis("t_s"),
        write_log=write_log,
        fault="; ".join(f"the {axis} loop is unstable" for axis, run in runs.items() if _swings(run)),
    )


def _fly(plant: AxisPlant, gains: LoopGains, number: int, settings: Chirps) -> AxisRun:
    shaken = Shaking(
        duration=len(PLANTS) * (_CHIRP + _PAUSE) + 2.0 * _PAUSE,
        chirp=(*_BAND, settings.magnitude),
        chirp_start=2.0 * _PAUSE + number * (_CHIRP + _PAUSE),
        chirp_seconds=_CHIRP,
        sid_axis=10 + number,
        # Yaw is turned by drag, not by lift: by the air as little as by the motors.
        gust=settings.gusts * plant.gain / PLANTS["roll"].gain,
        gyro_noise=0.015,
    )
    return run_axis(plant, gains, shaken, seed=10 * settings.seed + number)


def _facts(axis: str, plant: AxisPlant, gains: LoopGains) -> tuple[Fact, ...]:
    hz = np.geomspace(0.1, 150.0, 6000)
    true = margins_of(hz, true_loop(plant, gains, hz))
    values = settings_of(plant, gains, axis).parameters()
    flown = ", ".join(f"{term} {values[f'ATC_RAT_{AXES[axis]}_{term}']:.4g}" for term in "PID")
    margins = (
        ("gain margin", true.gain_db, "dB"),
        ("phase margin", true.phase_deg, "deg"),
        ("crossover", true.crossover_hz, "Hz"),
        ("disturbances rejected up to", true.rejection_hz, "Hz"),
    )
    stated = (Fact(f"{axis}: {words}", float(margin[0]), unit) for words, margin, unit in margins)
    return (Fact(f"{axis}: flown with", flown), *stated)


def _swings(run: AxisRun) -> bool:
    """Return whether the controller ends at its limits."""
    return bool(np.mean(np.abs(run.output[-800:])) > 0.5)


def _read(path: str) -> dict[str, float]:
    if not path:
        return {}
    try:
        return read_parameter_file(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise ParameterError(f"{path}: {error.strerror or error}") from error
    except (RotoridError, UnicodeDecodeError) as error:
        raise ParameterError(f"{path}: {error}") from error


def _set(changes: Mapping[str, float]) -> tuple[float, dict[str, LoopGains]]:
    """Return the corner of the gyro filter and the gains of each axis with some parameters changed."""
    filter_hz = next(iter(PLANTS.values())).filter_hz
    gains = dict(GAINS)
    fields = {f"ATC_RAT_{letters}_{term}": (axis, term) for axis, letters in AXES.items() for term in TERMS}
    fields |= {f"ATC_ANG_{letters}_P": (axis, "angle_P") for axis, letters in AXES.items()}
    for name, value in changes.items():
        if name == "INS_GYRO_FILTER":
            filter_hz = value
        elif name in fields:
            axis, field = fields[name]
            gains[axis] = replace(gains[axis], **{field: value})
        else:
            raise ParameterError(f"the craft has no parameter {name}; it has INS_GYRO_FILTER, {', '.join(fields)}")
    return filter_hz, gains
