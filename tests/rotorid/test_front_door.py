"""``import rotorid as ro``: quick to import, every name there, results that show themselves, the README's example."""

import dataclasses
import importlib
import io
import pickle
import pkgutil
import re
from contextlib import chdir, redirect_stdout
from types import SimpleNamespace

import numpy as np
import plotly.graph_objects as go
import pytest

import estimation
import pipeline
import rotorid as ro
import sysid
from core.summary import Summarised
from logparse import RotoridError
from logparse.signals import SignalError
from pipeline.config import ConfigError
from sysid.records.experiment import ExperimentError
from tests.paths import ROOT, SAMPLES

LOG = SAMPLES / "octa08_denver_square.bin"
#: What a notebook or a terminal should not be asked to scroll.
MOST_LINES = 10


@pytest.fixture(scope="module")
def readme(tmp_path_factory):
    """Run the README's example as printed; return its names."""
    [example] = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    folder, names = tmp_path_factory.mktemp("readme"), {}
    (folder / "sample_logs").symlink_to(SAMPLES)
    with chdir(folder), redirect_stdout(io.StringIO()) as printed:
        exec(compile(example, "README.md", "exec"), names)
    assert printed.getvalue().splitlines()[0].split() == ["rmse", "best_baseline", "trusted"]
    assert (folder / "out" / "report.html").is_file()
    return SimpleNamespace(**names)


@pytest.fixture(scope="module")
def log(readme):
    return readme.log


@pytest.fixture(scope="module")
def halves(readme):
    return readme.train, readme.unseen


@pytest.fixture(scope="module")
def body(readme):
    return readme.body


@pytest.fixture(scope="module")
def chirps():
    return ro.load(SAMPLES / "quad02_delft_systemid.bin")


class Still:
    """A user's own model: nothing moves."""

    training = ()

    def simulate(self, experiment):
        return np.repeat(experiment.y[:1], len(experiment), axis=0)

    def predict(self, experiment, horizon=1.0):
        lag = round(horizon / experiment.dt)
        return np.vstack([np.repeat(experiment.y[:1], lag, axis=0), experiment.y])[: len(experiment)]


def test_every_name_is_there():
    assert all(getattr(ro, name) is not None for name in ro.__all__)
    assert set(ro.__all__) <= set(dir(ro))
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = ro.nothing


def test_a_log_is_inspected(log):
    seen = ro.inspect(LOG)
    assert len(seen.happened) == len(log.flights) == 1
    assert seen.happened[0] in repr(seen)
    assert len(repr(seen).splitlines()) < MOST_LINES


def test_results_show_themselves_in_a_few_lines(log, halves, body):
    objects = (log, log.trajectory, halves[0], body, ro.validate(body, halves[1]))
    for result in objects:
        assert len(repr(result).splitlines()) < MOST_LINES
        assert len(repr(result)) < 1500
        assert result._repr_html_().startswith("<table")
    assert "octa plus" in repr(log)
    assert len(repr(log.tables)) < 1500


def test_no_result_shows_its_arrays_instead_of_its_summary():
    """A dataclass makes a `__repr__` of its own unless told not to, and hides the one it inherits."""
    for package in (estimation, pipeline, sysid):
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            importlib.import_module(module.name)
    results, classes = [Summarised], set()
    while results:
        results += (subclasses := results.pop().__subclasses__())
        classes |= {subclass.__name__ for subclass in subclasses if subclass.__repr__ is not Summarised.__repr__}
    assert not classes


def test_a_users_own_model_is_validated_beside_ours(halves, body):
    comparison = ro.validate([body, Still()], halves[1])
    still = comparison.table.loc["Still"]
    # To hold the position is one of the baselines, so that it cannot beat the best of them.
    assert (still["rmse"] >= still["best_baseline"] - 1e-9).all()
    assert not still["trusted"].any()


def test_records_have_a_length_and_can_be_cut(halves):
    record = halves[0]
    assert len(record[100:150]) == 50
    np.testing.assert_array_equal(record[100:150].y, record.y[100:150])
    with pytest.raises(ExperimentError, match="use resample"):
        _ = record[::2]


def test_plots_come_in_one_line(log, halves, body, chirps):
    frf = ro.frequency.response(chirps, "pitch")
    bode = ro.plot.bode(frf, ro.frequency.fit(frf))
    assert [trace.name for trace in bode.data if trace.showlegend] == ["measured pitch", "model"]
    figures = (
        ro.plot.prediction([body, Still()], halves[1], horizon=1.0),
        ro.plot.track(log),
        ro.plot.fields(log, "ATT.Roll", "ATT.DesRoll"),
    )
    for figure in figures:
        assert isinstance(figure, go.Figure)
        assert figure.layout.xaxis.title.text or figure.layout.xaxis2.title.text or len(figure.data) > 2
    with pytest.raises(SignalError, match="has no NONE"):
        ro.plot.fields(log, "NONE.Roll")
    with pytest.raises(SignalError, match="has no Rol"):
        ro.plot.fields(log, "ATT.Rol")


def test_what_does_not_exist_is_named(readme):
    with pytest.raises(ConfigError, match=r"masss.*mass"):
        ro.analyze(LOG, masss=3.0)
    with pytest.raises(KeyError, match=r"\['x', 'm1'\]"):
        _ = readme.tf["z"]


@pytest.mark.slow
def test_a_folder_gives_its_craft_with_their_parameters(two_analysed):
    out, fleet = two_analysed
    assert not fleet.failures
    assert len(fleet.crafts) == 2
    table = fleet.crafts[0].parameters
    assert list(table.columns) == ["value", "sigma", "unit", "method", "reason"]
    assert "thrust over mass" in table.index
    assert (out / "report.html").is_file()
    assert len(repr(fleet).splitlines()) < MOST_LINES


def test_a_simulated_flight_by_name():
    outcome = ro.simulate("motion-vertical")
    assert outcome.history.index.name == "t" or len(outcome.history)


def test_a_record_cut_from_a_log_has_the_frequency_response_of_its_stretch(chirps):
    """At the log's full rate with the chirp as instrument, not from the record's own samples."""
    data = chirps.experiment(rate=25.0)
    own, whole = ro.frequency.response(data, "roll"), ro.frequency.response(chirps, "roll")
    np.testing.assert_allclose(own.response, whole.response, rtol=1e-9)
    # The chirp on roll is the first: in the last tenth there is only what the attitude controller wanted.
    assert own.instrument == "chirp of SID_AXIS 10"
    assert ro.frequency.response(data.split(0.9)[1], "roll").instrument == "roll target"


def test_a_record_goes_to_another_process_without_its_log(chirps):
    data = chirps.experiment(rate=10.0)
    again = pickle.loads(pickle.dumps(data))
    assert again.log is None
    np.testing.assert_array_equal(again.y, data.y)


def test_what_asks_for_logs_takes_their_paths(log, chirps):
    np.testing.assert_array_equal(
        ro.frequency.response(str(chirps.path), "yaw").response, ro.frequency.response([chirps], "yaw").response
    )
    # A log without chirps is refused at once.
    assert ro.tune(str(LOG)).refused == ro.tune([log]).refused
    assert ro.prove(str(LOG), [str(LOG)]).before == (log.name,)


@pytest.mark.parametrize(
    ("function", "error", "wrong"),
    [
        (ro.tune, RotoridError, [3.0, None, [None], {"a": 1}]),
        (ro.analyze, ConfigError, [3, [], [ROOT / "nothing.bin"], str(ROOT / "nothing.bin"), [None]]),
    ],
)
def test_what_is_no_log_is_named(function, error, wrong):
    for given in wrong:
        with pytest.raises(error, match="log"):
            function(given)


def test_the_second_part_of_a_split_is_judged_with_the_wind_of_the_first(readme):
    """As the command line does: alone, the second part would have to spend its beginning on finding the wind."""
    first, second = readme.data.split(0.45)
    alone = dataclasses.replace(second, before=None)
    body = ro.fit.rigid_body(first, mass=1.6)
    informed, blind = (ro.validate(body, part).validations[0] for part in (second, alone))
    assert second.before is first
    assert informed.average["x"] != blind.average["x"]
