"""Responses from what motors got and gyros felt, where the log has no message of the rate controller."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import logparse
from simulation.axis_loop import AxisPlant, Excitation, LoopGains, run_axis
from sysid import frequency
from sysid.frequency.axes import FrequencyError
from sysid.frequency.rate_signals import on_one_clock
from sysid.frequency.records import below
from tests.sysid.rate_logs import logged

PLANT = AxisPlant(gain=150.0, damping=2.0, lag=0.03, delay=0.004, filter_hz=40.0)
STICKS = Excitation(duration=90.0, stick=0.25, gust=0.2, noise=0.003)
CHIRP = Excitation(duration=60.0, chirp=(0.4, 25.0, 0.12), chirp_seconds=59.0, gust=0.2, noise=0.003)


def flown(folder: Path, excitation: Excitation, motors: dict[str, float], **parameters: float) -> logparse.FlightLog:
    run = run_axis(PLANT, LoopGains.crossing_at(PLANT, 2.5), excitation, 3)
    return logged(folder, run, rate=400.0, filter_hz=40.0, parameters=parameters, motors=motors)


def error(frf: frequency.FrequencyResponse, plant: AxisPlant, low: float, high: float) -> np.ndarray:
    good = frf.usable & (frf.hz > low) & (frf.hz < high)
    assert np.mean(good[(frf.hz > low) & (frf.hz < high)]) > 0.9
    return np.asarray(np.log(frf.response / plant.response(frf.hz))[good])


@pytest.mark.parametrize("excitation", [STICKS, CHIRP], ids=["sticks", "chirp"])
def test_motor_outputs_and_gyros_stand_for_the_rate_controller(tmp_path: Path, excitation: Excitation) -> None:
    # Gyros four times as fast as motor outputs: unfiltered, they would fold.
    log = flown(tmp_path, excitation, {"rcou": 50.0, "imu": 200.0})
    frf = frequency.response(log, "roll")
    assert frf.source == "motor outputs to gyros"
    wrong = error(frf, PLANT, 0.7, 8.0)
    assert np.percentile(np.abs(wrong.real), 95) * 8.686 < 1.0
    assert np.degrees(np.percentile(np.abs(wrong.imag), 95)) < 5.0
    gain = frequency.fit(frf).parameters["gain"]
    assert gain.value == pytest.approx(150.0, rel=0.1)


def test_nothing_folds_and_what_is_below_passes() -> None:
    t, at = np.arange(4000) * 0.0025, np.arange(20, 80) * 0.1
    signals = np.column_stack([np.sin(2.0 * np.pi * 3.0 * t), np.sin(2.0 * np.pi * 8.7 * t)])
    found = below(t, signals, at, 0.1)
    known = np.isfinite(found).all(axis=1)
    assert known.sum() > 40
    assert found[known, 0] == pytest.approx(np.sin(2.0 * np.pi * 3.0 * at[known]), abs=0.01)
    assert np.max(np.abs(found[known, 1])) < 0.01


def test_motors_with_one_whole_reading_are_no_pair() -> None:
    """A garbled telemetry log left one row of all motors: its step was infinite, and the stage ended in a traceback."""
    one = pd.DataFrame({"out_roll": [0.1]}, index=[1.0])
    gyros = pd.DataFrame({"w_x": np.zeros(200)}, index=0.01 * np.arange(200))
    with pytest.raises(FrequencyError):
        on_one_clock(one, gyros)
