"""A flight without GPS: what drifted is no motion, and the thrust is told all the same."""

from dataclasses import replace

import pytest

import sysid
from estimation import estimate
from logparse import read_log
from sysid.records.experiment import Experiment, ExperimentError


@pytest.fixture(scope="module")
def drifting():
    log = read_log("sample_logs/quad01_davos_esc.bin")
    trajectory = estimate(replace(log.tables, gps=None), date=log.start_utc)
    return Experiment.from_flight(log, trajectory, rate=25.0)


def test_a_record_says_that_its_position_is_not_known(drifting):
    (finding,) = [finding for finding in drifting.findings if finding.id == "position-unknown"]
    assert "1-sigma grows to" in finding.reason
    assert drifting.split(0.7)[0].findings == drifting.findings


def test_no_motion_is_fitted_to_what_drifted(drifting):
    """On craft flown without GPS its wind was wrong by 8 of its own standard errors."""
    with pytest.raises(ExperimentError, match="position is not known"):
        sysid.fit_rigid_body(drifting)
    assert sysid.fit_thrust(drifting).common.per_mass == pytest.approx(7.3, rel=0.1)
