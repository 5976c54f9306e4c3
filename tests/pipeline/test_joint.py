"""Joint models of a craft: the same from other processes, and never lost with one of them."""

from concurrent.futures import BrokenExecutor, Future, ThreadPoolExecutor
from unittest import mock

import numpy as np
import pytest

from pipeline import AnalysisConfig, fleet
from pipeline.stages import silent
from tests.reports.conftest import made_flight

CONFIG = AnalysisConfig(poles=2, zeros=1)


@pytest.fixture(scope="module")
def craft():
    return [made_flight(f"flight0{k}", seed=k, fit=False) for k in (1, 2)]


@pytest.fixture(scope="module")
def here(craft):
    return fleet.analyze_group(craft, CONFIG)


def test_fits_in_other_workers_are_the_same(craft, here):
    with ThreadPoolExecutor(1) as executor:
        there = fleet.analyze_group(craft, CONFIG, silent, executor)
    assert [model.key for model in there.models] == [model.key for model in here.models]
    assert there.models[0].validation.average == here.models[0].validation.average
    assert there.timings.keys() == here.timings.keys()


def test_a_worker_that_dies_costs_its_model_only_and_says_so(craft, here):
    class Dying:
        def submit(self, *_):
            job = Future()
            job.set_exception(BrokenExecutor("killed"))
            return job

    group = fleet.analyze_group(craft, CONFIG, silent, Dying())
    assert group.models[0].model is None
    assert "the worker process failed" in group.models[0].missing

    class Dead:
        submit = mock.Mock(side_effect=BrokenExecutor("dead"))

    group = fleet.analyze_group(craft, CONFIG, silent, Dead())
    assert group.models[0].validation.average == here.models[0].validation.average


def test_coherence_and_physical_parameters_come_with_the_models(here):
    """Two motors drive every output; without attitude and accelerations there is a reason, not a number."""
    coherence = here.models[0].coherence
    assert (
        np.median(coherence.multiple[(coherence.frequency > 0.5) & (coherence.frequency < 5.0)]) > coherence.threshold
    )
    assert here.parameters is None
    assert here.missing["parameters"]
