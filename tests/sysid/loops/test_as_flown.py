"""Parameters that were not the ones flown are found in the log's own signals; true ones never are."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from logparse import Tables, read_log
from pipeline.flight.rotation import find_rotation
from pipeline.results.span import Span
from simulation.axis_loop import AxisPlant, LoopGains, Shaking, run_axis
from sysid.loops import as_flown, design, prove, tune
from sysid.loops.as_flown import contradiction, contradiction_of, gyro_seen
from sysid.loops.settings import read_settings
from tests.sysid.axis_flights import logged

CRAFT = AxisPlant(gain=300.0, damping=1.0, lag=0.02, delay=0.003, filter_hz=40.0)
GAINS = LoopGains(P=0.08, I=0.08, D=0.002)
NOTCH = {
    **{"INS_HNTCH_ENABLE": 1.0, "INS_HNTCH_FREQ": 60.0, "INS_HNTCH_BW": 30.0, "INS_HNTCH_ATT": 40.0},
    **{"INS_HNTCH_HMNCS": 1.0, "INS_HNTCH_MODE": 0.0, "INS_HNTCH_REF": 0.0, "INS_HNTCH_OPTS": 0.0},
}


@pytest.fixture(scope="module")
def flight():
    shaken = Shaking(
        duration=34.0, chirp=(0.5, 40.0, 0.08), chirp_start=6.0, chirp_seconds=24.0, gust=0.3, gyro_noise=0.015
    )
    return run_axis(CRAFT, GAINS, shaken, 1)


def _log(folder, flight, gains=GAINS, rate=100.0, **parameters):
    return logged(folder, flight, rate=rate, filter_hz=40.0, gains=gains, parameters=parameters)


@pytest.mark.parametrize("rate", [50.0, 100.0, 400.0])
def test_true_parameters_agree_with_the_signals(tmp_path, flight, rate):
    """Also where the chirp passes half of the rate of the rows, where a spline through them once swung beyond all."""
    assert contradiction(_log(tmp_path, flight, rate=rate)) is None


@pytest.mark.parametrize(
    ("claimed", "sentence"),
    [
        ({"P": 0.085}, "P as logged is 0.94 times"),
        ({"I": 0.11}, "I as logged is 0.73 times"),
        ({"D": 0.0}, "D as logged is not the 0"),
        ({"FLTD": 40.0}, "D as logged is 0.7"),
        ({"FLTT": 10.0}, "Tar as logged"),
        ({"FLTE": 20.0}, "P as logged"),
        ({"angle_P": 6.0}, "wanted as logged is 0.7"),
    ],
)
def test_gains_and_filters_that_did_not_fly_are_named(tmp_path, flight, claimed, sentence):
    reason = contradiction(_log(tmp_path, flight, replace(GAINS, **claimed)))
    assert sentence in reason
    assert "not what flew" in reason


@pytest.mark.parametrize(
    ("claimed", "sentence"),
    [
        ({"INS_GYRO_FILTER": 20.0}, "answers as with INS_GYRO_FILTER 4"),
        ({"INS_GYRO_FILTER": 80.0}, "answers as with INS_GYRO_FILTER 4"),
        (NOTCH, "INS_HNTCH_"),
        ({"SCHED_LOOP_RATE": 50.0}, "faster than the loop"),
    ],
)
def test_a_gyro_filter_a_notch_and_a_loop_that_did_not_fly_are_named(tmp_path, flight, claimed, sentence):
    """Nothing of the PID tells of the gyro's filters: SIDD has the rates before them."""
    log = _log(tmp_path, flight, **claimed)
    assert sentence in contradiction(log)


def test_nothing_is_proposed_nor_proven_from_parameters_that_did_not_fly(tmp_path, flight):
    lies = _log(tmp_path, flight, INS_GYRO_FILTER=20.0)
    assert "not what flew" in tune(lies).refused
    proof = prove(_log(tmp_path, flight), lies)
    assert "not what flew" in proof.refused
    assert len(proof.table) == 0


def test_an_analysis_states_no_margins_of_parameters_that_did_not_fly(tmp_path, flight):
    """`tune` refused such logs while the report showed their margins as good; designs leaned on them too."""
    lies = _log(tmp_path, flight, INS_GYRO_FILTER=20.0)
    rotation, _ = find_rotation(lies, Span(lies.flight.start, lies.flight.stop))
    assert rotation.axes[0].loop is None
    assert "not what flew" in rotation.axes[0].loop_reason
    assert [finding.id for finding in rotation.findings].count("parameters-not-flown") == 1
    assert "not what flew" in design(lies, "inertia").refused
    true = _log(tmp_path, flight)
    assert find_rotation(true, Span(true.flight.start, true.flight.stop))[0].axes[0].loop is not None


@pytest.mark.parametrize(("claimed", "sentence"), [(0.08, None), (0.1, "P as logged is 0.80 times")])
def test_a_flight_without_chirps_tells_the_gain_of_its_error(tmp_path, claimed, sentence):
    """P is the error times a number whatever is flown; margins from sticks rest on it too."""
    sticks = run_axis(CRAFT, GAINS, Shaking(duration=30.0, stick=0.15), 1)
    log = _log(tmp_path, sticks, replace(GAINS, P=claimed))
    log.messages["PIDR"]["Err"] = log.messages["PIDR"]["Tar"] - log.messages["PIDR"]["Act"]
    reason = contradiction_of(log, "roll")
    assert reason is None if sentence is None else sentence in reason


def test_the_scheduler_tells_the_rate_at_which_it_ran():
    """SCHED_LOOP_RATE takes effect when the autopilot starts; PM.LR is the rate that counts."""
    log = SimpleNamespace(messages={"PM": pd.DataFrame({"LR": [200, 200]})}, tables=Tables())
    assert "PM.LR" in as_flown.other_rate(log, 400.0)
    assert as_flown.other_rate(log, 200.0) is None


def test_a_notch_of_no_frequency_is_a_sentence(tmp_path, flight):
    """It ended in a division by zero."""
    log = _log(tmp_path, flight, **(NOTCH | {"INS_HNTCH_FREQ": 0.0, "INS_HNTCH_BW": 0.0}))
    assert "INS_HNTCH_FREQ = 0, INS_HNTCH_BW = 0 of a notch" in tune(log).refused


def test_a_flight_given_twice_counts_once(tmp_path, flight):
    """Its errors are not smaller for it: a copy of a log would have widened what is proposed."""
    once, again = _log(tmp_path, flight), _log(tmp_path, flight)
    assert tune([once, again]).logs == (once.name,)


def test_without_rates_before_the_filters_nobody_has_seen_them(tmp_path, flight):
    assert gyro_seen(_log(tmp_path, flight), "roll")
    unseen = replace(flight, unfiltered=np.zeros(len(flight.t)))
    assert not gyro_seen(_log(tmp_path, unseen), "roll")


def test_a_controller_at_its_limits_is_not_taken_for_wrong_parameters(tmp_path, flight):
    """Its integral only shrinks there: the reason to refuse is the limit, and not ATC_RAT_RLL_I."""
    free, limited = (_log(tmp_path, replace(flight, integral=0.8 * flight.integral)) for _ in range(2))
    limited.messages["PIDR"]["Flags"] = 1
    assert "as logged" in contradiction(free)
    assert contradiction(limited) is None


def test_a_notch_that_follows_throttle_is_where_the_throttle_flown_puts_it(unpacked):
    """REF is the hover throttle and FREQ the motors' frequency in hover."""
    settings = read_settings(read_log(unpacked("autopilot/vibration_octa8_notch")), "roll")
    assert settings.remarks == ("INS_HNTCH follows throttle, 69 Hz at the 0.43 flown",)
