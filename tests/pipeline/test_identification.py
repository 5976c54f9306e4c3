"""One kind of model, fitted and judged: what comes back, and what comes back when it cannot be done."""

import dataclasses

import pytest

import sysid
from pipeline import AnalysisConfig
from pipeline.execution.stages import STAGES, Overall, Stages, silent
from pipeline.flight.identification import identify
from pipeline.flight.kinds import KINDS
from pipeline.results.failure import Failure
from reports.numbers.flight import model_report
from reports.views.models import orders
from tests.reports.conftest import made_flight

MOTORS = KINDS[0]


@pytest.fixture(scope="module")
def parts():
    return made_flight(fit=False).experiment.split(0.7)


@pytest.fixture(scope="module")
def scanned(parts):
    config = AnalysisConfig(poles=2, zeros=1, scan_orders=True)
    return identify(MOTORS, parts[:1], parts[1:], config, Stages(silent, 3600.0))


def test_model_validation_and_predictions_belong_together(scanned, parts):
    assert scanned.missing == ""
    assert scanned.model.training == (parts[0].name,)
    assert [part.training for part in scanned.predictions] == [True, False]
    assert scanned.validation.unseen


def test_orders_are_scanned_without_the_part_that_judges(scanned, parts):
    assert all(name.startswith(parts[0].name) for name in scanned.orders.held_out)
    # The craft is of second order in every axis.
    assert scanned.orders.recommended[0] == 2
    table = orders(model_report(scanned, "own").orders)
    assert [row.label for row in table.rows][:2] == ["1 / 0", "2 / 0"]
    assert sum(row.kind == "average" for row in table.rows) == 1
    assert len(table.heads) == len(table.rows[0].cells) == 9


def test_what_cannot_be_fitted_says_why_and_leaves_the_others_alone(parts):
    def refused(experiments, config, progress):
        raise sysid.ExperimentError("two identical motors")

    stages = Stages(silent, 3600.0)
    kind = dataclasses.replace(MOTORS, fit=refused)
    result = identify(kind, parts[:1], parts[1:], AnalysisConfig(), stages)
    failure = Failure("motors", "two identical motors")
    assert (result.model, result.validation, result.predictions) == (failure, None, ())
    assert model_report(result, "own").model is None


def test_every_kind_has_a_stage_and_progress_never_goes_back():
    assert all(kind.key in STAGES for kind in KINDS)
    assert sum(stage.share for stage in STAGES.values()) == pytest.approx(1.0, abs=0.05)
    heard = []
    report = Overall(lambda title, fraction: heard.append(fraction))
    for stage in ("experiment", "motors", "validation", "experiment", "mixer", "validation"):
        report(stage, 0.0)
        report(stage, 1.0)
    assert heard == sorted(heard)
