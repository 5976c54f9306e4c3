"""Models fitted and judged, of a flight, jointly, and of tables; and what comes back when it cannot be done."""

import dataclasses
import json
from concurrent.futures import BrokenExecutor, Future, ThreadPoolExecutor
from dataclasses import replace
from datetime import timedelta

import numpy as np
import pytest
import yaml

import estimation
import sysid
from core.serialization import as_json
from estimation.trust import inconsistent
from logparse import MissingDataError, read_log
from pipeline import AnalysisConfig, ConfigError, analyze
from pipeline.execution.stages import Stages, silent
from pipeline.fleet import crafts
from pipeline.fleet.split import choose_split
from pipeline.flight.identification import identify
from pipeline.flight.kinds import KINDS
from pipeline.flight.summary import flight_entry
from pipeline.flight.table_analysis import analyze_tables
from pipeline.results.failure import Failure
from pipeline.storage.dataset import EXPERIMENTS, part, write_experiments
from pipeline.storage.store import open_store
from reports.pages.tables import tables_page
from tests.paths import SAMPLES
from tests.pipeline.builders import flight as moving
from tests.reports.builders import validator_of
from tests.reports.conftest import made_flight
from tests.sysid.six_dof import flown

MOTORS = KINDS[0]


@pytest.fixture(scope="module")
def parts():
    return made_flight(fit=False).experiment.split(0.7)


@pytest.fixture(scope="module")
def scanned(parts):
    config = AnalysisConfig(poles=2, zeros=1, scan_orders=True)
    return identify(MOTORS, parts[:1], parts[1:], config, Stages(silent, 3600.0))


def test_model_validation_and_predictions_belong_together(scanned, parts):
    assert scanned.report.missing == ""
    assert scanned.model.training == (parts[0].name,)
    assert [part.training for part in scanned.predictions] == [True, False]
    assert scanned.validation.unseen


def test_orders_are_scanned_without_the_part_that_judges(scanned, parts):
    assert all(name.startswith(parts[0].name) for name in scanned.report.orders.held_out)
    # The craft is of second order in every axis.
    assert scanned.report.orders.recommended[0] == 2


def test_what_cannot_be_fitted_says_why_and_leaves_the_others_alone(parts, monkeypatch):
    def refused(*_, **__):
        raise sysid.ExperimentError("two identical motors")

    monkeypatch.setattr(sysid, "fit_transfer_functions", refused)
    stages = Stages(silent, 3600.0)
    result = identify(MOTORS, parts[:1], parts[1:], AnalysisConfig(), stages)
    failure = Failure("motors", "two identical motors")
    assert (result.model, result.validation, result.predictions) == (failure, None, ())
    assert result.report.model is None


# Joint models of a craft: the same from other processes, and never lost with one of them.


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
        later = dataclasses.replace(flight.log, start_utc=(flight.log.started + timedelta(days=k)).isoformat())
        flight = dataclasses.replace(flight, log=later)
        entry = flight_entry(flight, folder=flight.name, source=f"{flight.name}.bin", key=str(k))
        # What was not measured does not train.
        entry = dataclasses.replace(entry, coverage=moving("any").coverage)
        with store.scratch() as scratch:
            for kind, file in write_experiments(flight, scratch).items():
                store.put(file, part(EXPERIMENTS, kind, entry.vehicle, entry.folder))
        entries.append(entry)
    return entries


def identify_jointly(craft, store, executor=None):
    return crafts.identify_craft("quad", craft, choose_split(craft, CONFIG), store.url, CONFIG, silent, executor)


@pytest.fixture(scope="module")
def here(craft, store):
    return identify_jointly(craft, store)


def test_one_flight_trains_and_the_other_judges(here):
    assert len(here.report.training) == len(here.report.held_out) == 1
    table = here.models[0].validation.table
    assert dict(zip(table["flight"], table["trained"], strict=True)) == {
        here.report.training[0]: True,
        here.report.held_out[0]: False,
    }
    assert here.report.vehicle.frame_class == "quad"


def test_fits_in_other_workers_are_the_same(craft, store, here):
    with ThreadPoolExecutor(1) as executor:
        there = identify_jointly(craft, store, executor)
    assert [model.key for model in there.models] == [model.key for model in here.models]
    assert there.models[0].validation.average == here.models[0].validation.average
    assert there.report.timings_s.keys() == here.report.timings_s.keys()
    assert there.report.missing == here.report.missing


def test_a_worker_that_dies_costs_its_model_only_and_says_so(craft, store):
    class Dying:
        def submit(self, *_):
            job = Future()
            job.set_exception(BrokenExecutor("killed"))
            return job

    group = identify_jointly(craft, store, Dying())
    assert isinstance(group.models[0].model, Failure)
    assert "the worker process failed" in group.models[0].report.missing
    assert "the worker process failed" in group.report.missing["thrust"]


def test_free_runs_of_many_flights_come_back_thin(craft, store, here, monkeypatch):
    """However many flights a craft has, what comes back for plots stays small; errors are of all samples."""
    monkeypatch.setattr(crafts, "MOST_ROWS", 1000)
    thin = identify_jointly(craft, store)
    assert thin.models[0].validation.average == here.models[0].validation.average
    assert not thin.models[0].validation.predictions, "they came back whole beside the thinned ones"
    for few, many in zip(thin.models[0].predictions, here.models[0].predictions, strict=True):
        assert len(few.experiment.t) == len(few.y_hat) <= 500 < len(many.experiment.t)
        assert np.isin(few.y_hat, many.y_hat).all()


# A trajectory that contradicts its own sensors states neither speeds nor models; the reason is said everywhere.


@pytest.fixture
def log_path():
    return sorted(SAMPLES.glob("*.bin"), key=lambda path: path.stat().st_size)[0]


@pytest.fixture
def doubtful(monkeypatch):
    """Estimate as ever, but find that nothing agrees."""
    honest = estimation.estimate

    def estimate(*arguments, **settings):
        refused = honest(*arguments, **settings)
        return replace(refused, findings=(*refused.findings, inconsistent("half of the GPS positions were refused")))

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


# Tables from the command line's side: fitted, judged on what was not seen, and a page that says so.


COLUMNS = {
    "time": "t",
    "position": ["pn", "pe", "pd"],
    "velocity": ["vn", "ve", "vd"],
    "attitude": {"columns": ["qw", "qx", "qy", "qz"], "order": "wxyz"},
    "rates": ["p", "q", "r"],
    "motors": {"columns": ["m1", "m2", "m3", "m4"], "quantity": "rad/s", "frame": "quad/x"},
    "mass": flown.MASS,
    "indoors": True,
}


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    folder = tmp_path_factory.mktemp("table")
    flight = flown.fly(16.0, 4)
    record = flown.experiment(flight, "flight", 4)
    frame = record.context.reset_index(names="t")
    frame.columns = ["t", "vn", "ve", "vd", "p", "q", "r", "qw", "qx", "qy", "qz"]
    frame[["pn", "pe", "pd"]] = record.y * [1.0, 1.0, -1.0]
    frame[["m1", "m2", "m3", "m4"]] = record.u
    path = folder / "flight.parquet"
    frame.to_parquet(path)
    columns = folder / "columns.yaml"
    columns.write_text(yaml.safe_dump(COLUMNS), encoding="utf-8")
    return path, columns


@pytest.fixture(scope="module")
def result(table):
    path, columns = table
    return analyze_tables([path], columns, AnalysisConfig())


@pytest.mark.slow
def test_a_table_is_fitted_on_its_first_part_and_judged_on_the_rest(result):
    assert result.report.judged[0].startswith("flight.parquet [")
    half = {error.state: error for error in result.report.errors if error.horizon == 0.5}
    assert all(error.model < 0.2 * error.held for error in half.values()), half
    numbers = json.loads(as_json(result.report))
    validator_of("tables").validate(numbers)
    assert numbers["model"]["charges"] == result.model.shape.charges
    assert numbers["model"]["parameters"]["thrust"]["si_value"] == pytest.approx(flown.THRUST, rel=0.02)
    page = tables_page(result)
    assert "roll gain" in page
    assert "Position of flight.parquet" in page
    answers = {line.purpose: line for line in result.report.answer.lines}
    assert answers["Predict position"].word == "2 s ahead"
    assert answers["Thrust"].value == pytest.approx(flown.THRUST, rel=0.02)
    assert answers["Tables"].word == "consistent"


@pytest.mark.slow
def test_what_the_model_misses_is_noise_where_nothing_is_missing(result):
    """The simulated record's velocities have noise of 5 mm/s: 0.7 m/s^2 from sample to sample, and nothing else."""
    missed = {quantity.name: quantity for quantity in result.report.missed}
    assert missed["force forward"].rms == pytest.approx(np.sqrt(2.0) * 5e-3 * 100.0, rel=0.1)
    assert missed["torque in yaw"].rms < 1.1 * missed["torque in yaw"].whole
    # The prediction one second ahead that is drawn is the one that was judged.
    error = np.linalg.norm((result.prediction.predicted - result.prediction.measured)[:, :3], axis=1)
    ahead = pytest.approx(1.0)
    judged = next(error for error in result.report.errors if (error.state, error.horizon) == ("position", ahead))
    assert np.sqrt(np.mean(error**2)) == pytest.approx(judged.model, rel=0.2)


@pytest.mark.slow
def test_tables_of_which_none_is_chosen_are_refused(table):
    path, columns = table
    with pytest.raises(ConfigError, match="nothing to fit"):
        analyze_tables([path, path], columns, AnalysisConfig(training=("march*",)))
