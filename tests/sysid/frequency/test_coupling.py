"""Roll that pitches: a craft whose gyros are turned against its arms, whose coupling is a formula."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import logparse
from simulation.axis_loop import AxisPlant, AxisRun, Excitation, LoopGains, run_axis
from sysid.frequency.survey import survey
from tests.sysid.rate_logs import logged

ROLL = AxisPlant(gain=300.0, damping=2.0, lag=0.03)
PITCH = replace(ROLL, gain=180.0)
SIGNALS = ("output", "feedback", "measured", "target", "attitude", "stick")


def turned(folder: Path, degrees: float, seeds: tuple[int, int], *, chirps: bool) -> logparse.FlightLog:
    """Fly both axes with the same controller, and log them in a frame that is turned about z.

    A loop whose controller is the same about all horizontal axes is the same loop in every frame: the truth is the
    plants' matrix in the turned one, with (K_roll - K_pitch) sin cos beside its diagonal.
    """
    controller = LoopGains.crossing_at(PITCH, 3.0)
    if chirps:
        shaken = Excitation(duration=70.0, chirp=(0.4, 20.0, 0.06), chirp_seconds=30.0, gust=0.3, noise=0.003)
    else:
        shaken = Excitation(duration=90.0, stick=0.2, gust=0.3, noise=0.003)
    flown = [
        run_axis(plant, controller, replace(shaken, sid_axis=10 + k, chirp_start=35.0 * k), seed)
        for k, (plant, seed) in enumerate(zip((ROLL, PITCH), seeds, strict=True))
    ]
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    x, y = ({name: getattr(run, name) for name in SIGNALS} for run in flown)
    runs: dict[str, AxisRun] = {
        "roll": replace(flown[0], **{name: c * x[name] - s * y[name] for name in SIGNALS}),
        "pitch": replace(flown[1], **{name: s * x[name] + c * y[name] for name in SIGNALS}),
    }
    return logged(folder, runs)


def test_sticks_on_both_axes_show_what_roll_does_to_pitch(tmp_path: Path) -> None:
    found = survey(turned(tmp_path, 15.0, (1, 2), chirps=False), ("roll", "pitch"))
    c, s = np.cos(np.radians(15.0)), np.sin(np.radians(15.0))
    across = (ROLL.gain - PITCH.gain) * s * c
    truth = {
        "roll": across / (ROLL.gain * c**2 + PITCH.gain * s**2),
        "pitch": across / (ROLL.gain * s**2 + PITCH.gain * c**2),
    }
    assert {each.axis for each in found.couplings} == {"roll", "pitch"}
    for each in found.couplings:
        assert each.significant
        assert each.ratio.value == pytest.approx(truth[each.axis], abs=max(3.0 * each.ratio.sigma, 0.01))
        assert each.ratio.sigma < 0.02


@pytest.mark.parametrize("chirps", [False, True], ids=["sticks", "chirps"])
def test_axes_that_do_not_couple_are_said_not_to(tmp_path: Path, chirps: bool) -> None:
    found = survey(turned(tmp_path, 0.0, (3, 4), chirps=chirps), ("roll", "pitch"))
    assert len(found.couplings) == 2
    for each in found.couplings:
        assert not each.significant
        assert each.ratio.sigma < 0.03
