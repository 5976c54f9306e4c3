"""The case that `tune` and `prove` read: its truth is that of its log, and it flies what it is told to."""

import json

import numpy as np
import pytest

import rotorid as ro
from simulation import CASES, ParameterError, write
from simulation.chirp_case import GAINS, PLANTS
from sysid.loops import rate_loop

CASE = CASES["chirps"]


def flown(folder, **settings):
    *_, log, truth = write(CASE.run({"rate": 100.0} | settings), folder)
    return ro.load(log), json.loads(truth.read_text(encoding="utf-8"))["truth"]


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    return flown(tmp_path_factory.mktemp("first"))


def test_the_margins_of_the_log_are_those_of_the_truth(first):
    log, truth = first
    for axis in PLANTS:
        margins = rate_loop(log, axis).margins
        assert margins.crossover_hz.value == pytest.approx(truth[f"{axis}: crossover"], rel=0.05)
        assert margins.phase_deg.value == pytest.approx(truth[f"{axis}: phase margin"], abs=3.0)


def test_gains_of_a_parameter_file_are_flown(first, tmp_path):
    path = tmp_path / "changed.param"
    path.write_text("# by hand\nATC_RAT_RLL_P,0.12\nATC_ANG_PIT_P 6\nINS_GYRO_FILTER,60\n", encoding="utf-8")
    log, truth = flown(tmp_path, parameters=str(path))
    parameters = log.parameters
    assert parameters["ATC_RAT_RLL_P"] == pytest.approx(0.12)
    assert parameters["ATC_ANG_PIT_P"] == 6.0
    assert parameters["INS_GYRO_FILTER"] == 60.0
    assert parameters["ATC_RAT_PIT_P"] == pytest.approx(GAINS["pitch"].P)
    assert truth["roll: crossover"] > 1.3 * first[1]["roll: crossover"]
    assert truth["gains"] == "changed.param"


@pytest.mark.parametrize(
    ("text", "reason"),
    [("ATC_RAT_RLL_Q,1\n", "ATC_RAT_RLL_Q"), ("what is this\n", "line 1"), (None, "No such file")],
)
def test_a_parameter_file_that_is_none_is_refused(tmp_path, text, reason):
    path = tmp_path / "odd.param"
    if text is not None:
        path.write_text(text, encoding="utf-8")
    with pytest.raises(ParameterError, match=reason):
        CASE.run({"parameters": str(path)})


def test_gains_that_swing_are_called_unstable(tmp_path):
    path = tmp_path / "hot.param"
    path.write_text("ATC_RAT_RLL_P,0.9\n", encoding="utf-8")
    outcome = CASE.run({"parameters": str(path)})
    assert "roll" in outcome.fault
    assert "pitch" not in outcome.fault
    assert np.isfinite(outcome.history.to_numpy()).all()
