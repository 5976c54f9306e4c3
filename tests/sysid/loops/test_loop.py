"""Loops identified from simulated flights of known craft: truth within the errors, and other gains foretold."""

from dataclasses import replace

import numpy as np
import pytest

from simulation.axis_loop import AxisPlant, LoopGains, random_axis, true_loop
from sysid.loops import LoopError
from sysid.loops.margins import margins_of
from tests.sysid.loops.flown import flown_loop

HZ = np.geomspace(0.3, 80.0, 3000)
NAMES = ("crossover_hz", "phase_deg", "gain_db", "rejection_hz", "peak_db")


def _craft() -> tuple[AxisPlant, LoopGains]:
    axis = AxisPlant(gain=300.0, damping=1.0, lag=0.02, delay=0.003, filter_hz=30.0)
    return axis, LoopGains(P=0.09, I=0.09, D=0.0025)


@pytest.mark.slow
def test_two_ways_to_the_loop_agree_and_both_find_the_truth():
    axis, gains = _craft()
    loop = flown_loop(axis, gains, 1)
    truth = margins_of(HZ, true_loop(axis, gains, HZ)).row(0)
    for margins in (loop.margins, loop.measured_margins):
        assert margins.stable
        assert margins.crossover_hz.value == pytest.approx(truth["crossover_hz"], rel=0.05)
        assert margins.phase_deg.value == pytest.approx(truth["phase_deg"], abs=3.0)
        assert margins.gain_db.value == pytest.approx(truth["gain_db"], abs=1.0)


@pytest.mark.slow
def test_margins_of_other_gains_are_foretold_within_their_errors():
    """Over craft and gains drawn at random, with flexible modes: 95 % intervals hold the truth in 90 % and more."""
    rng = np.random.default_rng(20)
    held: list[bool] = []
    for seed in range(10):
        axis, gains = random_axis(rng)
        other = replace(gains, P=1.25 * gains.P, I=1.25 * gains.I, D=0.8 * gains.D, FLTD=30.0)
        truth = margins_of(HZ, true_loop(axis, other, HZ)).row(0)
        if not truth["stable"]:
            continue
        loop = flown_loop(axis, gains, seed)
        changed = loop.with_gains(P=other.P, I=other.I, D=other.D, FLTD=other.FLTD)
        intervals = changed.margins.intervals
        held += [intervals[name][0] <= truth[name] <= intervals[name][1] for name in NAMES if name in intervals]
    assert len(held) > 35
    assert np.mean(held) >= 0.9


def test_gains_that_do_not_hold_are_called_unstable():
    axis, gains = _craft()
    loop = flown_loop(axis, gains, 2)
    assert loop.margins.unstable == 0.0
    hot = loop.with_gains(P=4.0 * gains.P, D=4.0 * gains.D).margins
    assert not hot.stable
    assert hot.unstable == 1.0
    assert hot.phase_deg.value < 0.0


def test_a_margin_outside_the_band_has_a_reason_and_no_number():
    axis, gains = _craft()
    loop = flown_loop(axis, gains, 2)
    gentle = loop.with_gains(P=1e-4, I=0.0, D=0.0, angle_P=0.1).margins
    assert gentle.crossover_hz.value is None
    assert "band" in gentle.crossover_hz.reason


@pytest.mark.parametrize("values", [{"Q": 1.0}, {"P": -0.1}, {"D": float("nan")}])
def test_nonsense_gains_are_refused_with_a_sentence(values):
    axis, gains = _craft()
    loop = flown_loop(axis, gains, 2)
    with pytest.raises(LoopError):
        loop.with_gains(**values)
