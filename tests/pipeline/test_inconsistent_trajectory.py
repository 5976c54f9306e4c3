"""A trajectory that contradicts its own sensors states neither speeds nor models; the reason is said everywhere."""

from dataclasses import replace
from pathlib import Path

import pytest

import estimation
import sysid
from estimation.trust import inconsistent
from logparse import MissingDataError, read_log
from pipeline import analyze

LOG = Path(__file__).parents[2] / "sample_logs"


@pytest.fixture
def log_path():
    return sorted(LOG.glob("*.bin"), key=lambda path: path.stat().st_size)[0]


@pytest.fixture
def doubtful(monkeypatch):
    """Estimate as ever, but find that nothing agrees."""
    honest = estimation.estimate

    def estimate(*arguments, **settings):
        found = honest(*arguments, **settings)
        return replace(found, findings=(*found.findings, inconsistent("half of the GPS positions were refused")))

    monkeypatch.setattr(estimation, "estimate", estimate)
    return estimate


def test_neither_speeds_nor_models_are_stated(log_path, doubtful):
    result = analyze(log_path)
    assert "contradicts the sensors" in result.trajectory.reason
    assert result.missing["experiment"] == result.missing["trajectory"]
    assert result.models == ()
    assert result.coverage == result.trajectory
    assert "trajectory-inconsistent" in [finding.id for finding in result.findings]


def test_no_experiment_is_cut_from_it(log_path, doubtful):
    """Nor by any other way to a model than the analysis of one log."""
    log = read_log(log_path)
    with pytest.raises(MissingDataError, match="contradicts the sensors"):
        sysid.Experiment.from_flight(log, doubtful(log.tables))
