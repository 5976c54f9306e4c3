"""ArduPilot's published procedure: chirps from 0.1 to 10 Hz, one log for each axis, its I at 0 in the air."""

import numpy as np
import pytest

from logparse import read_log
from simulation.axis_loop import AxisPlant, LoopGains, random_axis
from sysid.loops import LoopError, rate_loop, read_settings, tune
from sysid.loops.evidence import unsupported
from sysid.loops.safety import Aim
from sysid.loops.search import tune_axis
from tests.sysid.axis_flights import PROCEDURE, flown_loop, kept_promise, procedure_loop

AXES = {"roll": "RLL", "pitch": "PIT", "yaw": "YAW"}


@pytest.fixture(scope="module")
def flights(unpacked):
    return {
        craft: [read_log(unpacked(f"autopilot/methodic_{craft}_{axis}")) for axis in AXES]
        for craft in ("quad15", "octa8")
    }


def test_one_log_for_each_axis_gives_one_set_of_gains(flights):
    """I flew at 0 and is proposed as the firmware's part of P; the way back is to what was before the procedure."""
    for craft, logs in flights.items():
        result = tune(logs)
        assert result.refused is None, craft
        for log, (axis, letters) in zip(logs, AXES.items(), strict=True):
            p, i, d = (f"ATC_RAT_{letters}_{term}" for term in "PID")
            assert {p, i, d} <= set(result.proposed)
            assert result.proposed[i] == pytest.approx((0.1 if axis == "yaw" else 1.0) * result.proposed[p], rel=1e-3)
            assert result.flown[i] == 0.0 == read_settings(log, axis).controller.I
            assert result.rollback[i] > 0.0
            assert any(axis in remark.split(": I was 0")[0] for remark in result.remarks if ": I was 0" in remark)
        for axis in result.axes:
            assert axis.worst["gain_db"] >= 5.9
            assert axis.worst["phase_deg"] >= 45.0
            assert axis.worst["peak_db"] <= 6.7


def test_part_of_i_as_asked(flights):
    proposed = tune(flights["octa8"][0], i_term=0.5).proposed
    assert proposed["ATC_RAT_RLL_I"] == pytest.approx(0.5 * proposed["ATC_RAT_RLL_P"], rel=1e-3)
    with pytest.raises(LoopError, match="part"):
        tune(flights["octa8"][0], i_term=-1.0)


def test_rows_within_a_chirp_tell_how_far_it_is_seen(unpacked):
    """RATE came at 100 Hz during chirps and at 50 Hz otherwise: of a chirp to 40 Hz all but 25 Hz was thrown away."""
    loop = rate_loop(read_log(unpacked("autopilot/autotune_quad15_after")), "roll")
    assert loop.plant.seen > 35.0
    assert loop.margins.gain_db.value == pytest.approx(5.5, abs=0.3)


def test_chirps_to_10_hz_foretell_what_chirps_to_40_measure(flights, unpacked):
    """The same craft with its chirp to 40 Hz: margins of the flown gains and of half of them; the edge is at 1.337."""
    low = rate_loop(flights["quad15"][0], "roll")
    high = rate_loop(read_log(unpacked("autopilot/methodic_quad15_roll40")), "roll")
    for factor in (1.0, 0.5):
        gains = {name: factor * getattr(low.flown.controller, name) for name in ("P", "D")}
        foretold, measured = (loop.with_gains(**gains).margins for loop in (low, high))
        for name, most in (("gain_db", 0.3), ("phase_deg", 2.0), ("peak_db", 1.0)):
            a, b = getattr(foretold, name), getattr(measured, name)
            assert abs(a.value - b.value) < max(most, 0.1 * a.value)
            assert a.sigma > b.sigma
    assert 10.0 ** (low.margins.gain_db.value / 20.0) == pytest.approx(1.337, rel=0.03)


def test_a_rate_loop_that_is_slow_gets_a_slower_attitude_loop():
    """ATC_ANG_RLL_P of 4.5 around a crossover at 0.8 Hz leaves 34 deg, and no rate gains within reach leave 45."""
    craft = AxisPlant(gain=89.0, lag=0.049, delay=0.0102, damping=1.0, filter_hz=25.0)
    gains = LoopGains(P=0.06, I=0.0, D=0.001)
    tuning = tune_axis(flown_loop(craft, gains, 1, magnitude=0.2, **PROCEDURE), Aim())
    kept_promise(craft, tuning)
    assert tuning.tuned.settings.angle.P < 4.5
    assert tuning.worst["phase_deg"] >= 45.0
    assert tuning.worst["gain_db"] >= 6.0


@pytest.mark.slow
def test_proposals_from_low_chirps_keep_in_truth_what_they_promise():
    """Random craft, some with modes that no such chirp sees: four of five get a proposal, each keeps its promise."""
    rng = np.random.default_rng(5)
    proposed = 0
    for seed in range(1, 8):
        axis, gains = random_axis(rng)
        loop = procedure_loop(axis, gains, seed)
        if unsupported(loop):
            continue
        tuning = tune_axis(loop, Aim())
        if tuning.tuned is None:
            continue
        proposed += 1
        kept_promise(axis, tuning)
    assert proposed >= 5
