"""Tuning: margins that hold in truth, values as typed, and refusals without the evidence."""

from copy import copy
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from logparse import read_log
from simulation.axis_loop import (
    AxisPlant,
    LoopGains,
    Shaking,
    gains_of,
    random_axis,
    run_axis,
    true_loop,
)
from sysid.frequency.excitation import find_chirps
from sysid.loops import LoopError, tune, tuning
from sysid.loops.evidence import oscillation, sagged, two_ways_apart, unsupported, weak_band
from sysid.loops.margins import margins_of
from sysid.loops.parameter_file import parameter_file, read_parameter_file, typed
from sysid.loops.safety import ActuatorNoise, Aim, others_keep
from sysid.loops.same_craft import gain_apart
from sysid.loops.search import tune_axis
from sysid.loops.unseen import MODE, unseen_mode
from tests.paths import REAL
from tests.sysid.axis_flights import bending, flown_loop, fly_chirp, kept_promise, logged, loop_of_flight, true_margins
from tests.sysid.flights import PartsOfLog


@pytest.mark.slow
def test_proposed_gains_keep_in_truth_what_was_promised():
    """Random craft with delays and flexible modes: the true margins of proposals lie within the promised bounds.

    `benchmarks loops` has a hundred of them.
    """
    rng = np.random.default_rng(7)
    accepted = 0
    for seed in range(8):
        axis, gains = random_axis(rng)
        loop = flown_loop(axis, gains, seed)
        if unsupported(loop):
            continue
        tuning = tune_axis(loop, Aim())
        if tuning.tuned is None:
            continue
        accepted += 1
        c = tuning.tuned.settings.controller
        for name in ("P", "I", "D"):
            assert 0.5 <= getattr(c, name) / getattr(gains, name) <= 2.0
        truth = true_margins(axis, tuning.tuned.settings)
        assert truth["stable"]
        assert not truth["gain_db"] < min(tuning.worst["gain_db"], 6.0)
        assert truth["phase_deg"] >= 45.0
        assert truth["peak_db"] <= 6.0
    assert accepted >= 5


def test_a_chirp_drowned_in_gusts_is_refused():
    axis, gains = random_axis(np.random.default_rng(3))
    loop = flown_loop(axis, gains, 1, magnitude=0.002, gust=8.0, noise=0.3)
    assert weak_band(loop) is not None


def test_a_loop_that_is_not_as_its_parameters_say_is_refused():
    """A craft flown with half of the P that its parameters claim: the two ways to the loop disagree."""
    axis, gains = random_axis(np.random.default_rng(8))
    flight = fly_chirp(axis, replace(gains, P=0.5 * gains.P), seed=1)
    assert "apart" in (two_ways_apart(loop_of_flight(flight, axis, gains)) or "")


def test_a_flown_gain_outside_its_documented_range_is_no_crash():
    """An integral gain below ArduCopter's documented 0.01 left no candidate at all, and an index out of range."""
    axis = AxisPlant(gain=900.0, damping=1.0, lag=0.02, delay=0.003, filter_hz=40.0)
    gains = LoopGains(P=0.02, I=0.004, D=0.0005)
    tuning = tune_axis(flown_loop(axis, gains, 1), Aim())
    assert tuning.tuned is not None
    assert tuning.tuned.settings.controller.I >= 0.004


def test_a_mode_beyond_the_chirp_is_left_its_margin():
    """A frame that bends at 40 Hz, chirps up to 20 Hz: 1.4 times the gain out there took 5.8 dB of margin to 2.9 dB."""
    axis = bending(91.5, damping=1.5, lag=0.012, delay=0.0025, filter_hz=60.0, mode=(40.6, 0.033, 0.3))
    bold, timid = LoopGains(P=0.3, I=0.24, D=0.006), LoopGains(P=0.21, I=0.168, D=0.0042)
    for gains, at_least in ((bold, 7.9), (timid, 11.0)):
        before = true_margins(axis, gains)
        tuning = tune_axis(flown_loop(axis, gains, 1, magnitude=0.1, band=(0.5, 20.0)), Aim())
        assert tuning.tuned is not None
        after = true_margins(axis, tuning.tuned.settings)
        assert after["rejection_hz"] > (1.0 if gains is bold else 1.1) * before["rejection_hz"]
        assert after["gain_db"] > before["gain_db"] > at_least


def test_a_chirp_that_ends_on_the_peak_of_its_loop_is_refused():
    """What is left of the loop there adds to a mode just beyond: 6.04 dB of peak were flown for 6.0 promised."""
    axis = bending(114.65, damping=0.34, lag=0.0095, delay=0.00325, filter_hz=30.0, mode=(15.8, 0.0493, 0.0914))
    tuning = tune_axis(flown_loop(axis, LoopGains(P=0.247, I=0.163, D=0.00373), 9301022, band=(0.5, 12.2)), Aim())
    assert tuning.tuned is None
    assert "a chirp to 30 Hz or more would leave less" in tuning.refused


def test_a_loop_that_nearly_rings_beyond_its_chirp_is_refused():
    """A frame that bends at 26 Hz with 2.8 dB left, a chirp to 15 Hz: gains for the rest of it left 3.6 dB."""
    axis = bending(390.0, damping=0.2, lag=0.011, delay=0.008, filter_hz=80.0, mode=(26.2, 0.022, 0.237))
    gains = LoopGains(P=0.0485, I=0.0317, D=0.00079)
    assert true_margins(axis, gains)["gain_db"] < 4.0
    assert "stands out" in (unsupported(flown_loop(axis, gains, 1, band=(0.5, 15.0))) or "")
    rigid = replace(axis, flex_hz=0.0, flex_share=0.0)
    assert unsupported(flown_loop(rigid, gains, 1, band=(0.5, 15.0))) is None


def test_filters_of_target_and_error_and_feed_forward_are_proposed_where_they_are_in_use():
    """A craft slowed by low filters: opening them rejects more, and no change exceeds a factor of two."""
    axis = AxisPlant(gain=300.0, damping=1.0, lag=0.015, delay=0.002, filter_hz=60.0)
    gains = LoopGains(P=0.07, I=0.07, D=0.002, FF=0.02, FLTT=6.0, FLTE=12.0)
    tuning = tune_axis(flown_loop(axis, gains, 1), Aim())
    assert tuning.tuned is not None
    c = tuning.tuned.settings.controller
    assert any(getattr(c, name) != getattr(gains, name) for name in ("FF", "FLTT", "FLTE"))
    for name in ("FF", "FLTT", "FLTE"):
        assert 0.5 <= getattr(c, name) / getattr(gains, name) <= 2.0
    assert kept_promise(axis, tuning)["rejection_hz"] > true_margins(axis, gains)["rejection_hz"]


def test_rejection_is_given_up_only_for_margins_that_the_flown_gains_lack():
    """A frame that bends at 25 Hz leaves the worst case of sound gains open: a tenth of the rejection was taken."""
    sound = bending(612.0, damping=3.8, lag=0.0115, delay=0.0079, filter_hz=60.0, mode=(25.46, 0.0373, 0.146))
    refused = tune_axis(flown_loop(sound, LoopGains(P=0.0385, I=0.0222, D=0.000712), 1), Aim())
    assert refused.tuned is None
    assert "the flown gains keep 6 dB, 45 deg and a peak of 6 dB" in refused.refused
    thin = AxisPlant(gain=117.0, damping=1.45, lag=0.0544, delay=0.0035, filter_hz=30.0)
    item = tune_axis(flown_loop(thin, LoopGains(P=0.0748, I=0.0729, D=0.0009), 1), Aim())
    assert item.tuned is not None
    assert not item.wider
    assert "instead of 0.83: the flown gains leave 40 deg of phase margin" in tuning.rejects_less(item, Aim())


def test_attitude_gain_is_raised_within_its_own_phase_margin():
    """A craft whose rate loop could follow faster targets: gusts turn it less, and the promise holds in truth."""
    axis = AxisPlant(gain=300.0, damping=0.5, lag=0.012, delay=0.001, filter_hz=60.0)
    gains = LoopGains(P=0.09, I=0.045, D=0.0015, angle_P=3.0)
    item = tune_axis(flown_loop(axis, gains, 1, magnitude=0.1), Aim())
    assert 3.0 < item.tuned.settings.angle.P <= 4.5
    kept_promise(axis, item)
    assert margins_of(item.tuned.hz, item.tuned.attitude_loop()).phase_deg[0] >= 60.0


def test_values_come_back_as_typed():
    values = {"ATC_RAT_RLL_P": typed(0.1234567), "INS_GYRO_FILTER": 30.0, "ATC_RAT_RLL_D": typed(0.00123456)}
    text = parameter_file(values, ("made by a test", "two\nlines"), {"INS_GYRO_FILTER": "was\n20"})
    assert read_parameter_file(text) == values
    assert next(line for line in text.splitlines() if not line.startswith("#")) == "ATC_RAT_RLL_D,0.001235"
    assert "INS_GYRO_FILTER,30  # was 20" in text
    with pytest.raises(LoopError, match="line 1"):
        read_parameter_file("ATC_RAT_RLL_P")


@pytest.mark.slow
def test_firmware_flight_gets_a_proposal_that_keeps_the_aim(flown):
    result = tune(flown("octa8_id"))
    assert result.refused is None
    assert read_parameter_file(result.proposed_file()) == pytest.approx(result.proposed, rel=1e-7)
    rollback = read_parameter_file(result.rollback_file())
    assert set(rollback) == set(result.proposed)
    for name, value in rollback.items():
        assert np.float32(value) == np.float32(flown("octa8_id").parameters[name])
        assert 0.5 * value <= result.proposed[name] <= 2.0 * value
    for axis in result.axes:
        if axis.tuned is not None:
            assert axis.worst["gain_db"] >= 6.0
            assert axis.worst["phase_deg"] >= 45.0
            assert axis.worst["peak_db"] <= 6.0
            assert axis.tuned.margins.rejection_hz.value > axis.loop.margins.rejection_hz.value


@pytest.mark.slow
def test_a_craft_that_oscillates_is_refused(flown):
    result = tune(flown("quad15_hot"))
    assert "oscillates" in result.refused
    assert result.proposed == {}
    with pytest.raises(LoopError):
        result.proposed_file()


def test_no_log_and_an_unknown_aim():
    assert tune([]).refused == "no log was given"
    with pytest.raises(LoopError, match="aim"):
        tune([], aim="fastest")


def test_the_gyro_filter_is_not_opened_over_an_axis_that_nobody_saw_beyond_a_low_chirp():
    axis, gains = AxisPlant(gain=300.0, lag=0.01, filter_hz=30.0), LoopGains(P=0.12, I=0.1, D=0.003)
    assert not others_keep([flown_loop(axis, gains, 1, band=(0.5, 20.0))], 1.5)
    assert others_keep([], 1.5)


def test_a_craft_that_rings_above_the_logged_band_is_refused(tmp_path):
    """A frame that lets the loop ring at 45 Hz: rows at 50 Hz show it folded to 5 Hz, and the sentence says so."""
    axis = AxisPlant(gain=300.0, lag=0.02, delay=0.003, filter_hz=80.0, flex_hz=45.0, flex_damping=0.02, flex_share=1.1)
    gains = LoopGains(P=0.08, I=0.08, D=0.002)
    run = run_axis(axis, gains, Shaking(duration=40.0, gust=0.3, gyro_noise=0.015), 1)
    log = logged(tmp_path, run, rate=50.0, filter_hz=80.0, gains=gains)
    assert "at 5.0 Hz (or at 45 Hz and more" in (oscillation(log, "roll") or "")


def test_flights_that_answer_differently_are_not_summed(flown, monkeypatch):
    """Logs of two craft with the same settings, whose sum has the margins of neither."""
    axis, gains = AxisPlant(gain=300.0, lag=0.02, filter_hz=30.0), LoopGains(P=0.07, I=0.07, D=0.002)
    loops = [flown_loop(plant, gains, 1) for plant in (axis, replace(axis, gain=400.0))]
    assert gain_apart(*loops) == pytest.approx(4.0 / 3.0, rel=0.02)
    logs = [flown("octa3_id"), copy(flown("octa3_id"))]
    alone = dict(zip(map(id, logs), loops, strict=True))
    monkeypatch.setattr(
        tuning, "rate_loop", lambda flights, axis: loops[0] if len(flights) > 1 else alone[id(flights[0].log)]
    )
    monkeypatch.setattr(tuning, "without_copies", list)  # one flight stands for both
    assert "1.33 times as strongly" in tune(logs).refused


@pytest.mark.parametrize(("share", "stop"), [(0.3, 12.0), (-0.35, 12.0), (0.3, 20.0)])
def test_a_chirp_that_ends_on_a_mode_is_refused(share, stop):
    """The band ends just below the mode, in a dip or a rise: a craft of 2.4 dB got a proposal of 0.9 dB."""
    axis = AxisPlant(
        gain=300.0,
        damping=1.0,
        lag=0.02,
        delay=0.003,
        filter_hz=40.0,
        flex_hz=stop,
        flex_damping=0.03,
        flex_share=share,
    )
    loop = flown_loop(axis, LoopGains(P=0.08, I=0.08, D=0.002), 1, magnitude=0.08, band=(0.5, stop))
    assert "bends at its end" in (unseen_mode(loop) or "")


def test_a_battery_that_sinks_during_a_chirp_is_refused_unless_the_autopilot_makes_up_for_it(flown):
    """Thrust goes with the square of the voltage: low and high frequencies would be of two craft."""
    log = flown("quad15_id")
    chirp = next(c for c in find_chirps(log) if c.axis == "roll")
    t = np.linspace(chirp.start, chirp.stop, 200)
    battery = pd.DataFrame({"voltage": np.linspace(16.0, 15.0, 200)}, index=t)
    tables = SimpleNamespace(battery=battery, systemid=log.tables.systemid)
    for highest, sentence in ((0.0, "fell by 4 %"), (16.8, "")):
        vehicle = SimpleNamespace(battery_voltage_max=highest)
        sinking = PartsOfLog(
            tables=tables, vehicle=vehicle, path=log.path, messages=log.messages, of_one_flight=False, parameters={}
        )
        assert sentence in (sagged(sinking, "roll") or "")
        assert (sagged(sinking, "roll") is None) == (sentence == "")


def test_nothing_is_raised_beyond_a_low_chirp_where_a_mode_would_count():
    """From a chirp to 8 Hz the filter of the gyro was once opened from 40 to 50 Hz."""
    axis, gains = AxisPlant(gain=300.0, lag=0.02, delay=0.003, filter_hz=40.0), LoopGains(P=0.04, I=0.04, D=0.001)
    loop = flown_loop(axis, gains, 1, magnitude=0.08, band=(0.5, 8.0))
    tuning = tune_axis(loop, Aim())
    settings = tuning.tuned.settings
    assert settings.gyro.low_pass == 40.0
    beyond = np.geomspace(8.0, 150.0, 50)
    counts = MODE * np.abs(true_loop(axis, gains_of(settings), beyond)) > 0.63
    assert (np.abs(settings.feedback(beyond)) <= 1.001 * np.abs(loop.flown.feedback(beyond)))[counts].all()


def test_noise_of_motors_beyond_the_band_is_not_raised_by_more_than_the_aim():
    """White noise may fall where a line at 90 Hz doubles: the bound holds at every frequency beyond the band."""
    axis, gains = AxisPlant(gain=300.0, lag=0.02, delay=0.003, filter_hz=40.0), LoopGains(P=0.08, I=0.08, D=0.002)
    loop = flown_loop(axis, gains, 1, magnitude=0.08)
    louder = loop.with_gains(D=1.7 * gains.D)
    hz = np.linspace(loop.hz[-1], 199.0, 200)
    ratio = np.abs(louder.settings.controller.error_response(hz) / loop.flown.controller.error_response(hz)).max()
    assert ActuatorNoise(loop).factor(louder) >= 0.999 * ratio


@pytest.mark.slow
@pytest.mark.skipif(not REAL.exists(), reason="needs the logs beside the repository")
def test_real_logs_are_refused_with_a_sentence():
    """None of the public logs has the evidence; none may raise anything but an error of reading it: one in four."""
    logs = (path for path in REAL.iterdir() if path.suffix not in (".tsv", ".md"))
    for path in sorted(logs, key=lambda path: path.stat().st_size)[3::4]:
        result = tune(read_log(path))
        assert result.refused, path.name
        assert result.proposed == {}
