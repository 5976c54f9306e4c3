"""Stored models with new inputs: what comes out is what the model would have said before it was stored."""

import json

import numpy as np
import pandas as pd
import pytest

import reports
import sysid
from core.serialization import plain
from logparse import RotoridError
from pipeline.config import ConfigError
from pipeline.flight.replay import choose, load_models, replay
from reports import write_replay
from tests.reports.conftest import made_flight


@pytest.fixture(scope="module")
def flight():
    return made_flight()


@pytest.fixture(scope="module")
def models(flight, tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    reports.write(flight, folder)
    return folder / "models.json"


@pytest.fixture
def table(flight, tmp_path):
    """Commands with the motion that followed, as a CSV table."""
    record = made_flight("other", seed=3, fit=False).experiment
    frame = pd.DataFrame(np.column_stack([record.t, record.u, record.y]), columns=["t", "m1", "m2", "x", "y", "z"])
    path = tmp_path / "flown.csv"
    frame.to_csv(path, index=False)
    return path


def test_a_table_with_its_motion_is_predicted_and_judged(flight, models, table, tmp_path):
    result = replay(models, table)
    (motors,) = result.results
    record = motors.predictions[0].experiment
    expected = flight.models[0].model.simulate(record)
    assert motors.predictions[0].y_hat == pytest.approx(expected)
    assert result.measured
    assert motors.validation.unseen
    page, csv = write_replay(result, tmp_path / "out")
    text = page.read_text("utf-8")
    assert "by the stored models, which have not seen it" in text
    written = pd.read_csv(csv)
    assert list(written)[:3] == ["t", "x_predicted", "x_measured"]
    assert written["x_predicted"].to_numpy() == pytest.approx(expected[:, 0], rel=1e-4, abs=1e-5)


def test_without_motion_a_model_starts_at_rest(flight, models, table, tmp_path):
    """The answer to a step on top of the hover is the closed form's: nothing before it, the gain in the long run."""
    hover = flight.models[0].model.input_trim
    t = np.arange(0.0, 120.0, 0.1)
    step = np.where(t >= 1.0, 10.0, 0.0)
    pd.DataFrame({"t": t, "m1": hover["m1"] + step, "m2": hover["m2"]}).to_csv(tmp_path / "step.csv", index=False)
    result = replay(models, tmp_path / "step.csv")
    (motors,) = result.results
    y_hat = motors.predictions[0].y_hat
    assert not result.measured
    assert motors.validation is None
    assert any("start at rest" in note for note in result.notes)
    gain = flight.models[0].model.transfer_functions["x"]["m1"].gain
    assert y_hat[-1, 0] == pytest.approx(gain * 10.0, rel=1e-2)
    assert y_hat[:9, 0] == pytest.approx(0.0)
    page, _ = write_replay(result, tmp_path / "out")
    assert "RMSE" not in page.read_text("utf-8")[:20000].partition("</style>")[2].partition("<script")[0]


def test_the_trim_can_be_chosen_and_is_told(flight, models, table, tmp_path):
    """Inputs a constant away from those fitted: their own mean hides it, the training's trim answers with the gain."""
    model = flight.models[0].model
    frame = pd.read_csv(table)
    frame["m1"] += 7.0
    frame.to_csv(tmp_path / "offset.csv", index=False)
    runs = {trim: replay(models, tmp_path / "offset.csv", trim=trim) for trim in (None, "own", "training")}
    own, about = (runs[trim].results[0].predictions[0] for trim in ("own", "training"))
    assert np.array_equal(runs[None].results[0].predictions[0].y_hat, own.y_hat)
    mean = dict(zip(model.input_names, own.experiment.u.mean(axis=0), strict=True))
    assert own.experiment.input_trim == pytest.approx(list(mean.values()))
    assert about.experiment.input_trim == pytest.approx([model.input_trim[name] for name in model.input_names])
    assert "about the mean of the inputs given" in " ".join(runs["own"].notes)
    far = max(abs(mean[name] - model.input_trim[name]) for name in mean)
    assert f"on average up to {far:.3g} away" in " ".join(runs["training"].notes)


def test_files_without_a_trim_are_run_about_the_inputs_own_mean(models, table, tmp_path):
    content = json.loads(models.read_text())
    del content["flights"][0]["models"]["motors"]["input_trim"]
    (tmp_path / "models.json").write_text(json.dumps(content))
    pd.read_csv(table)[["t", "m1", "m2"]].to_csv(tmp_path / "new.csv", index=False)
    result = replay(tmp_path / "models.json", tmp_path / "new.csv")
    assert "the file does not tell the inputs" in " ".join(result.notes)
    record = result.results[0].predictions[0].experiment
    assert record.input_trim == pytest.approx(record.u.mean(axis=0))


def test_a_closed_loop_takes_targets(tmp_path):
    t = np.arange(0.0, 60.0, 0.1)
    target = np.column_stack([np.clip(t - 5.0, 0.0, 10.0), 0.1 * np.sin(t), np.zeros(len(t))])
    rng = np.random.default_rng(0)
    fitted = sysid.Experiment.from_arrays(
        t,
        target + rng.normal(0.0, 0.01, target.shape),
        target + rng.normal(0.0, 0.01, target.shape),
        name="fitted",
        input_names=["x", "y", "z"],
        output_names=["x", "y", "z"],
    )
    model = sysid.fit_closed_loop([fitted])
    entry = {"name": "craft", "models": {"reference": plain(model.record())}, "thrust": None, "missing": {}}
    (tmp_path / "models.json").write_text(json.dumps({"rotorid": "0", "joint": [entry], "flights": []}))
    pd.DataFrame(np.column_stack([t, target]), columns=["t", "x", "y", "z"]).to_csv(tmp_path / "to.csv", index=False)
    (result,) = replay(tmp_path / "models.json", tmp_path / "to.csv").results
    assert result.predictions[0].y_hat == pytest.approx(model.simulate(result.predictions[0].experiment))


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("t,m1\n0,1\n", "no column m2"),
        ("m1,m2\n0,1\n", "no column t"),
        ("", "not a CSV table"),
        ("t,m1,m2\n" + "".join(f"{k},1,high\n" for k in range(20)), "columns must hold numbers only"),
        ("t,m1,m2\n" + "".join(f"{k * k},1,{k}\n" for k in range(20)), "time is not uniform"),
    ],
)
def test_tables_that_cannot_be_used_are_told_why(models, tmp_path, content, says):
    path = tmp_path / "table.csv"
    path.write_text(content)
    with pytest.raises(RotoridError, match=says):
        replay(models, path)


@pytest.mark.parametrize(
    "content", ["", "[]", '{"flights": [{"name": "a"}]}', '{"joint": [], "flights": []}', "\x00", "[" * 99999]
)
def test_files_that_hold_no_models_are_told_apart(tmp_path, content):
    path = tmp_path / "models.json"
    path.write_text(content)
    with pytest.raises(ConfigError, match=r"models\.json"):
        load_models(path)


@pytest.mark.parametrize("covariance", [None, [[1.0], [1.0, 2.0]], [[1.0]]])
def test_a_model_that_lacks_a_field_or_whose_numbers_do_not_fit_together_is_a_sentence(
    models, table, tmp_path, covariance
):
    content = json.loads(models.read_text())
    model = content["flights"][0]["models"]["motors"]
    if covariance is None:
        del model["hold"]
    else:
        for row in model["transfer_functions"].values():
            row["m1"]["covariance"] = covariance
    (tmp_path / "models.json").write_text(json.dumps(content))
    with pytest.raises(RotoridError, match="do not fit together" if covariance else "missing required field `hold`"):
        replay(tmp_path / "models.json", table)


def test_models_are_chosen_by_kind_or_owner(models):
    stored = load_models(models)
    assert [model.key for model in choose(stored, "flight01/motors")] == ["motors"]
    assert choose(stored, "flight01") == choose(stored) == choose(stored, "motors")
    with pytest.raises(ConfigError, match="no model 'mixer'; there are flight01/motors"):
        choose(stored, "mixer")
