"""Verdicts and the numbers behind them."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.signal import lfilter

from core.serialization import as_json, from_json
from sysid import Experiment, ExperimentError, fit_transfer_functions, validate
from sysid.validation.report import ValidationReport
from sysid.validation.uses import Trust


@dataclass(frozen=True)
class Known:
    """A model that is right up to a given error."""

    error: float
    training: tuple[str, ...] = ("seen",)
    name: str = "known"

    def simulate(self, experiment):
        return experiment.y + self.error

    def predict(self, experiment, horizon=1.0):
        return experiment.y + self.error * horizon


def record(name, y=None, samples=400):
    t = np.arange(samples) * 0.1
    y = np.column_stack([5.0 * np.sin(0.3 * t), 2.0 * t]) if y is None else y
    return Experiment.from_arrays(t, np.sin(t), y, name=name, output_names=["x", "z"], units={"x": "m", "z": "m"})


def test_errors_and_baselines_in_closed_form():
    validation = validate(Known(0.5), [record("unseen")])
    x, z = (validation.table.set_index("output").loc[name] for name in ("x", "z"))
    assert x["rmse"] == pytest.approx(0.5)
    late = record("unseen").y[30:, 0]
    assert x["rmse_mean"] == pytest.approx(late.std())
    assert x["fit_percent"] == pytest.approx(100.0 * (1.0 - 0.5 / late.std()))
    assert x["rmse_constant_position"] == pytest.approx(np.sqrt(np.mean((late - late[0]) ** 2)))
    # A steady climb is what constant velocity predicts exactly.
    assert z["rmse_constant_velocity"] == pytest.approx(0.0, abs=1e-9)
    ahead = validation.horizons.set_index(["output", "horizon"]).loc[("z", 2.0)]
    assert ahead["rmse"] == pytest.approx(1.0)
    assert ahead["rmse_constant_position"] == pytest.approx(4.0)
    assert ahead["rmse_constant_velocity"] == pytest.approx(0.0, abs=1e-9)


def test_a_model_that_beats_its_best_baseline_by_three_per_cent_does_not_follow():
    """A steady climb with swings: constant velocity errs far less than the mean, and is what a model must beat."""
    t = np.arange(400) * 0.1
    climb = np.column_stack([2.0 * t + np.sin(0.3 * t)] * 2)
    flights = [record("unseen", climb), record("another", climb)]
    best = float(validate(Known(0.5), flights).table["rmse_constant_velocity"].mean())
    close = [validate(Known(part * best), flights).uses.free_run for part in (0.97, 0.93)]
    assert [verdict.follows for verdict in close] == [(), ("x", "z")]


def test_black_boxes_are_told_the_mean_of_the_inputs_and_the_validation_says_so():
    rng = np.random.default_rng(0)
    records = []
    for name in "abc":
        u = np.repeat(rng.normal(0.0, 1.0, 60), 10)
        y = lfilter([0.1], [1.0, -0.9], u)[:, None]
        records.append(Experiment.from_arrays(np.arange(600) * 0.1, u, y, name=name, output_names=["z"]))
    validation = validate(fit_transfer_functions(records[:1], poles=1, zeros=0), records[1:])
    assert validation.own_trim
    assert "free simulation" in repr(validation)
    assert validation.report().own_trim
    assert validation.uses.free_run.trust is Trust.YES
    assert not validate(Known(0.5), records).own_trim


def test_seen_flights_do_not_count():
    better_on_seen = validate(Known(0.5), [record("seen"), record("unseen")])
    assert better_on_seen.table["trained"].tolist() == [True, True, False, False]
    assert better_on_seen.uses.free_run.flights_within == 1


def test_a_craft_that_stands_still_and_short_records():
    still = record("still", y=np.zeros((60, 2)), samples=60)
    validation = validate(Known(0.0), [still])
    assert np.isnan(validation.table["fit_percent"]).all()
    assert validation.horizons["horizon"].max() <= 2.0
    assert validation.uses.free_run.follows == ()
    assert from_json(as_json(validation.report()), ValidationReport).own_trim == validation.own_trim


@dataclass(frozen=True)
class Patient(Known):
    """A model that looks at the first 20 s of records that it does not know."""

    def initial_seconds(self, experiment):
        return 20.0


def test_what_a_model_has_looked_at_is_not_scored():
    y = np.zeros((400, 2))
    y[:200] = 7.0
    # Right from the 20th second on; before, the answer was looked at.
    validation = validate(Patient(0.25), [record("long", y)])
    assert validation.table["scored_from"].tolist() == pytest.approx([20.0, 20.0])
    assert validation.table["rmse_mean"].tolist() == [0.0, 0.0]
    assert validation.horizons["rmse_constant_position"].max() == 0.0
    short = record("short", np.zeros((150, 2)), samples=150)
    assert validate(Patient(0.25), [record("long", y), short]).table["flight"].unique().tolist() == ["long"]
    with pytest.raises(ExperimentError, match="looks at the first 20 s of a record, and the longest has 15 s"):
        validate(Patient(0.25), [short])


def test_a_closed_loop_is_held_against_its_reference():
    t = np.arange(400) * 0.1
    reference = np.column_stack([np.sin(0.3 * t), 0.1 * t])
    one = Experiment.from_arrays(
        t, reference, reference + 0.2, name="unseen", input_names=["x", "z"], output_names=["x", "z"]
    )
    validation = validate(Known(0.3), [one])
    assert validation.table["rmse_reference"].tolist() == pytest.approx([0.2, 0.2])
    assert validation.uses.free_run.better_than_target == ()


def test_residuals_are_tested_on_unseen_records_only():
    rng = np.random.default_rng(0)

    @dataclass(frozen=True)
    class Noisy(Known):
        def predict(self, experiment, horizon=1.0):
            return experiment.y + rng.standard_normal(experiment.y.shape)

    validation = validate(Noisy(0.1), [record("seen"), record("unseen")])
    assert validation.residuals["x"].samples == 370
    assert set(validation.report().residuals) == {"x", "z"}
