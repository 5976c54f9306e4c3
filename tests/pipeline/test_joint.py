"""Joint models of a craft: the same from other processes, and never lost with one of them."""

import dataclasses
from concurrent.futures import BrokenExecutor, Future, ThreadPoolExecutor
from datetime import timedelta

import numpy as np
import pytest

from pipeline import AnalysisConfig
from pipeline.execution.stages import silent
from pipeline.fleet import joint
from pipeline.fleet.split import choose_split
from pipeline.flight.summary import flight_entry
from pipeline.results.failure import Failure
from pipeline.storage.dataset import EXPERIMENTS, part, write_experiments
from pipeline.storage.store import open_store
from tests.pipeline.builders import flight as moving
from tests.reports.conftest import made_flight

CONFIG = AnalysisConfig(poles=2, zeros=1)


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    return open_store(tmp_path_factory.mktemp("store"))


@pytest.fixture(scope="module")
def craft(store):
    """Two flights on two days, whose experiments are in the store."""
    entries = []
    for k in (1, 2):
        flight = made_flight(f"flight0{k}", seed=k, fit=False)
        later = dataclasses.replace(flight.log, start_utc=flight.log.start_utc + timedelta(days=k))
        flight = dataclasses.replace(flight, log=later)
        entry = flight_entry(flight, folder=flight.name, source=f"{flight.name}.bin", key=str(k))
        # What was not measured does not train.
        entry = dataclasses.replace(entry, coverage=moving("any").coverage)
        with store.scratch() as scratch:
            for kind, file in write_experiments(flight, scratch).items():
                store.put(file, part(EXPERIMENTS, kind, entry.vehicle, entry.folder))
        entries.append(entry)
    return entries


def identify(craft, store, executor=None):
    return joint.identify_craft("quad", craft, choose_split(craft, CONFIG), store.url, CONFIG, silent, executor)


@pytest.fixture(scope="module")
def here(craft, store):
    return identify(craft, store)


def test_one_flight_trains_and_the_other_judges(here):
    assert len(here.training) == len(here.held_out) == 1
    table = here.models[0].validation.table
    assert dict(zip(table["flight"], table["trained"], strict=True)) == {
        here.training[0]: True,
        here.held_out[0]: False,
    }
    assert here.vehicle.frame_class == "quad"


def test_fits_in_other_workers_are_the_same(craft, store, here):
    with ThreadPoolExecutor(1) as executor:
        there = identify(craft, store, executor)
    assert [model.key for model in there.models] == [model.key for model in here.models]
    assert there.models[0].validation.average == here.models[0].validation.average
    assert there.timings.keys() == here.timings.keys()
    assert there.missing == here.missing


def test_a_worker_that_dies_costs_its_model_only_and_says_so(craft, store):
    class Dying:
        def submit(self, *_):
            job = Future()
            job.set_exception(BrokenExecutor("killed"))
            return job

    group = identify(craft, store, Dying())
    assert isinstance(group.models[0].model, Failure)
    assert "the worker process failed" in group.models[0].missing
    assert "the worker process failed" in group.missing["thrust"]


def test_free_runs_of_many_flights_come_back_thin(craft, store, here, monkeypatch):
    """However many flights a craft has, what comes back for plots stays small; errors are of all samples."""
    monkeypatch.setattr(joint, "MOST_ROWS", 1000)
    thin = identify(craft, store)
    assert thin.models[0].validation.average == here.models[0].validation.average
    for few, many in zip(thin.models[0].predictions, here.models[0].predictions, strict=True):
        assert len(few.experiment.t) == len(few.y_hat) <= 500 < len(many.experiment.t)
        assert np.isin(few.y_hat, many.y_hat).all()
