"""Loops of known craft, of firmware before and after a change, and of logs whose gains changed."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from logparse import read_log
from simulation.axis_loop import AxisPlant, LoopGains, random_axis
from sysid.loops import LoopError, prove, read_settings, tune
from sysid.loops.evidence import no_one_loop, other_settings
from sysid.loops.search import without_integral
from tests.paths import SAMPLES
from tests.sysid.axis_flights import flown_loop, true_margins

NAMES = ("crossover_hz", "phase_deg", "gain_db", "rejection_hz", "peak_db")


def _craft() -> tuple[AxisPlant, LoopGains]:
    axis = AxisPlant(gain=300.0, damping=1.0, lag=0.02, delay=0.003, filter_hz=30.0)
    return axis, LoopGains(P=0.09, I=0.09, D=0.0025)


@pytest.mark.slow
def test_two_ways_to_the_loop_agree_and_both_find_the_truth():
    axis, gains = _craft()
    loop = flown_loop(axis, gains, 1)
    truth = true_margins(axis, gains)
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
        truth = true_margins(axis, other)
        if not truth["stable"]:
            continue
        loop = flown_loop(axis, gains, seed)
        changed = loop.with_gains(P=other.P, I=other.I, D=other.D, FLTD=other.FLTD)
        intervals = changed.margins.intervals
        held += [intervals[name][0] <= truth[name] <= intervals[name][1] for name in NAMES if name in intervals]
    assert len(held) > 35
    assert np.mean(held) >= 0.9


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


@pytest.fixture(scope="module")
def hot(flown):
    """Prove the gains at which the firmware craft oscillated: 1.5 times P, I and D."""
    return prove(flown("quad15_id"), flown("quad15_hot"))


@pytest.mark.slow
def test_a_level_crossover_is_foretold_within_its_error_and_said_to_be_level(flown):
    """Straight from its chirp the later loop was 11 % off the prediction: PID rows of every fourth loop bend it."""
    proof = prove(flown("octa3_id"), flown("octa3_g2"))
    row = proof.table.loc[("pitch", "crossover_hz")]
    assert abs(row["predicted"] / row["measured"] - 1.0) < 0.06
    assert abs(row["predicted"] - row["measured"]) < 2.0 * np.hypot(row["predicted_sigma"], row["measured_sigma"])
    assert any("level" in remark for remark in proof.remarks)


@pytest.mark.slow
def test_nothing_is_measured_from_a_chirp_at_its_limits(hot):
    """Gains at which the craft oscillates keep the mixer at its limits for three quarters of the chirp."""
    assert hot.verdict == "worse: restore rollback.param"
    assert hot.table["measured"].isna().all()
    assert hot.table.loc[("roll", "phase_deg"), "predicted"] < 0.0
    assert any("76 %" in remark for remark in hot.remarks)
    # The flight before alone says that it would oscillate.
    for predicted, _ in hot.loops.values():
        assert not predicted.margins.stable
        assert predicted.margins.unstable > 0.95


@pytest.mark.slow
def test_prediction_of_a_firmware_flight_with_other_gains(flown):
    proof = prove(flown("octa3_id"), flown("octa3_g1"))
    assert proof.verdict == "as predicted"
    for axis in ("roll", "pitch"):
        row = proof.table.loc[axis]
        assert row.loc["crossover_hz", "predicted"] == pytest.approx(row.loc["crossover_hz", "measured"], rel=0.05)
        assert row.loc["phase_deg", "predicted"] == pytest.approx(row.loc["phase_deg", "measured"], abs=6.0)
        assert row.loc["gain_db", "predicted"] == pytest.approx(row.loc["gain_db", "measured"], abs=1.0)
        assert row.loc["rejection_hz", "predicted"] == pytest.approx(row.loc["rejection_hz", "measured"], rel=0.1)
        assert row.loc["step_fit", "predicted"] >= 90.0


def test_logs_of_two_craft_are_a_sentence_and_no_numbers(flown):
    proof = prove(flown("quad15_id"), flown("quadslow_g1"))
    assert "two craft" in proof.refused
    assert len(proof.table) == 0


SAMPLE = SAMPLES / "quad02_delft_systemid.bin"


def later_set(name, factor, t):
    """Return the sample with a parameter of the loops set to so many times its value at a time [s]."""
    log, rows = read_log(SAMPLE), read_log(SAMPLE).messages["PARM"]
    row = rows[rows["Name"] == name].tail(1)
    row = row.assign(Value=factor * row["Value"]).set_axis([t(log)])
    log.messages.replace("PARM", pd.concat([rows, row]).sort_index(kind="stable"))
    return log


def test_gains_set_after_landing_are_not_those_that_flew():
    """The last value of a parameter was taken for the flown one, with 8 % more P on the way to other margins."""
    value = read_log(SAMPLE).parameters["ATC_RAT_RLL_P"]
    later = later_set("ATC_RAT_RLL_P", 1.08, lambda log: log.boot.t_end + 5.0)
    assert later.parameters["ATC_RAT_RLL_P"] == pytest.approx(1.08 * value)
    assert pytest.approx(value) == read_settings(later, "roll").controller.P
    assert no_one_loop(later) is None


def test_gains_set_between_chirps_are_no_one_loop():
    changed = later_set("ATC_RAT_RLL_P", 1.08, lambda log: 0.5 * (log.flight.start + log.flight.stop))
    assert "ATC_RAT_RLL_P changed" in tune(changed).refused


def test_what_was_changed_after_landing_is_put_back_with_the_gains():
    """AutoTune saves an angle P once it landed: gains proposed for the flown one were left beside the other."""
    changed = later_set("ATC_ANG_RLL_P", 8.0, lambda log: log.boot.t_end + 1.0)
    result = tune(changed)
    assert changed.parameters["ATC_ANG_RLL_P"] == 8.0 * result.rollback["ATC_ANG_RLL_P"]
    assert result.proposed["ATC_ANG_RLL_P"] == result.rollback["ATC_ANG_RLL_P"]
    assert any("ATC_ANG_RLL_P changed after the flight" in remark for remark in result.remarks)


def test_an_i_of_nearly_nothing_is_none():
    """Firmware may refuse to arm with an I of 0, so that a little is typed: a hundredth of it was proposed."""
    settings = read_settings(read_log(SAMPLE), "roll")
    assert not without_integral(settings)
    assert without_integral(settings.changed(I=0.002))


def test_flights_with_other_gains_are_not_mixed():
    """Rollback was of one craft and the proposal of another; only an axis' own I may be 0 in its chirps."""

    def flight(name, **parameters):
        at = {"ATC_RAT_RLL_P": 0.1, "ATC_RAT_RLL_I": 0.1, "ATC_ANG_RLL_P": 4.5, "LOG_BITMASK": 1.0} | parameters
        return SimpleNamespace(path=Path(name), flight=SimpleNamespace(start=5.0, stop=9.0), parameters_at=lambda t: at)

    same = [flight("a.bin"), flight("b.bin", ATC_RAT_RLL_I=0.002, LOG_BITMASK=7.0)]
    assert other_settings(same) is None
    other = other_settings([*same, flight("c.bin", ATC_ANG_RLL_P=9.0)])
    assert other is not None
    assert other.startswith("a.bin flew with ATC_ANG_RLL_P 4.5, c.bin with 9")
