"""One word and one sentence on a model."""

from types import SimpleNamespace

import pandas as pd
import pytest

from sysid.validation.purposes import uses_of
from sysid.validation.uses import Trust, Verdict, overall


def free_runs(
    fit: dict[str, float],
    *,
    mean=1.0,
    duration: float = 40.0,
    unseen=True,
    flights="ab",
    reference=float("nan"),
):
    rows = [
        {"flight": f, "output": output, "trained": trained, "duration": duration, "rmse": 1.0, "fit_percent": percent}
        | {"rmse_mean": mean, "rmse_reference": reference}
        for output, percent in fit.items()
        for trained in ((False, True) if unseen else (True,))
        for f in flights
    ]
    return pd.DataFrame(rows)


def run_of(table, outside=frozenset()):
    return uses_of(None, table, outside=outside).free_run


def assess(table, outside=frozenset()):
    return run_of(table, outside).verdict


@pytest.mark.parametrize(
    ("fit", "how", "trust", "words"),
    [
        ({"x": 90.0, "z": 80.0}, {}, Trust.YES, "can be trusted"),
        ({"x": 90.0, "z": 20.0}, {}, Trust.LIMITED, "in x only"),
        ({"x": -90.0, "z": -40.0}, {}, Trust.NO, "Do not trust"),
        ({"x": float("nan"), "z": 90.0}, {}, Trust.LIMITED, "in z only"),
        ({"x": 90.0, "z": 80.0}, {"flights": "a"}, Trust.LIMITED, "only one record has judged it"),
        # A held-out stretch in which the craft hardly had time to move flatters any model.
        ({"x": 99.0}, {"duration": 2.2}, Trust.UNKNOWN, "too short"),
    ],
)
def test_verdict_follows_the_worst_axis_of_more_than_one_record_and_two_seconds(fit, how, trust, words):
    verdict = assess(free_runs(fit, **how))
    assert verdict.trust is trust
    assert words in verdict.sentence


def test_an_axis_that_does_not_follow_its_own_flight_is_right_elsewhere_by_luck():
    runs = free_runs({"x": 60.0, "z": 80.0})
    runs.loc[runs["trained"] & (runs["output"] == "x"), "fit_percent"] = -169.0
    verdict = assess(runs)
    assert verdict.trust is Trust.LIMITED
    assert "in z only" in verdict.sentence


def test_no_verdict_without_unseen_flight():
    assert assess(None).trust is Trust.UNKNOWN
    assert assess(free_runs({"x": 99.0}, unseen=False)).trust is Trust.UNKNOWN


def test_a_target_that_is_as_good_is_said_and_does_not_condemn_the_model():
    """Off by 0.1 m where the target is off by 0.1 m too, of flights that move by metres: `do not trust` misled."""
    runs = free_runs({"x": 95.0, "z": 96.0}, mean=20.0, reference=1.02)
    verdict = assess(runs)
    assert verdict.trust is Trust.YES
    assert "in x and z the target itself is as good" in verdict.sentence
    assert run_of(runs).as_good_as_target == ("x", "z")


@pytest.mark.parametrize("flights", ["a", "ab"])
def test_an_axis_that_did_not_move_condemns_no_model_that_does_better_than_its_target(flights):
    """Hardly a step in y: off by 5 cm where the target is off by 6, `no` for 7 times the mean's error of 7 mm."""
    runs = free_runs({"x": 98.0, "y": -600.0}, mean=20.0, reference=1.2, flights=flights)
    runs.loc[runs["output"] == "y", "rmse_mean"] = 0.14
    run = run_of(runs)
    assert (run.trust, run.far, run.better_than_target) == (Trust.LIMITED, (), ("x", "y"))
    assert assess(runs).trust is Trust.LIMITED
    assert "in x only" in assess(runs).sentence
    worse = free_runs({"x": 98.0, "y": -600.0}, mean=20.0, reference=0.5, flights=flights)
    worse.loc[worse["output"] == "y", "rmse_mean"] = 0.14
    assert run_of(worse).trust is Trust.NO


def errors(*rows, mean=(14.0, 17.0, 7.0)):
    """Make the table of held-out flights with these errors in x, y, z."""
    table = free_runs({"x": 0.0, "y": 0.0, "z": 0.0}, flights="abcdefgh"[: len(rows)])
    for flight, row in zip("abcdefgh", rows, strict=False):
        for output, error, size in zip("xyz", row, mean, strict=True):
            at = (table["flight"] == flight) & (table["output"] == output)
            table.loc[at, ["rmse", "rmse_mean"]] = error, size
            table.loc[at & ~table["trained"], "fit_percent"] = 100.0 * (1.0 - error / size)
            table.loc[at & table["trained"], "fit_percent"] = 90.0
    return table


def test_one_axis_far_beyond_the_mean_is_no_for_free_runs():
    """64, 59 and 2.7 m, where the mean errs by 14, 17 and 7 m, was `with care`."""
    table = errors((64.0, 59.0, 2.7), (64.0, 59.0, 2.7))
    run = run_of(table)
    assert (run.trust, run.follows, run.far) == (Trust.NO, ("z",), ("x", "y"))
    assert "x 4.6 times and y 3.5 times the error of always predicting the mean" in run.sentence
    verdict = assess(table)
    assert verdict.trust is Trust.NO
    assert "no better than its worst axis" in verdict.sentence


def test_a_single_record_must_hold_in_all_axes():
    assert run_of(errors((1.0, 1.0, 5.0))).trust is Trust.NO
    assert "A single record must hold in every axis" in assess(errors((1.0, 1.0, 5.0))).sentence
    assert run_of(errors((1.0, 1.0, 1.0))).trust is Trust.LIMITED
    assert run_of(errors((1.0, 1.0, 5.0), (1.0, 1.0, 5.0))).trust is Trust.LIMITED
    assert run_of(errors((1.0, 1.0, 1.0), (1.0, 1.0, 1.0))).trust is Trust.YES


def test_flights_outside_the_envelope_are_counted_apart():
    good, bad, away = (1.4, 1.7, 0.7), (10.0, 1.7, 0.7), (90.0, 90.0, 90.0)
    table = errors(good, good, good, good, bad, away)
    run = run_of(table, outside={"f"})
    assert (run.flights_within, run.followed_within, run.flights_outside, run.followed_outside) == (5, 4, 1, 0)
    assert run.flights() == (
        "4 of 5 flights within the envelope are followed in every axis to 90–90 %; 0 of 1 outside it"
    )
    assert run.trust is Trust.YES, "on average over those within, every axis is followed"
    assert assess(table, outside={"f"}).trust is Trust.YES
    assert assess(table).trust is Trust.NO
    # Where all are outside, nothing else judges, and they do not make a model trusted.
    assert run_of(errors(good, good), outside={"a", "b"}).trust is Trust.LIMITED
    assert (
        "no held-out record lies within the fitted envelope" in assess(errors(good, good), outside={"a", "b"}).sentence
    )


def ahead(curves, flights="ab"):
    """Make tables with errors by horizon: horizon -> (error, constant position, constant velocity) by output."""
    runs = free_runs({"x": 90.0, "z": 90.0}, flights=flights)
    rows = [
        {"flight": flight, "output": output, "trained": False, "horizon": horizon}
        | dict(zip(("rmse", "rmse_constant_position", "rmse_constant_velocity"), values, strict=True))
        for flight in flights
        for horizon, by_output in curves.items()
        for output, values in by_output.items()
    ]
    return runs, pd.DataFrame(rows)


GOOD, FAIR = (0.1, 1.0, 0.5), (0.3, 1.0, 0.5)


def test_the_horizon_is_the_longest_at_which_every_axis_halves_both_guesses():
    curves = {0.1: {"x": GOOD, "z": GOOD}, 1.0: {"x": GOOD, "z": GOOD}, 5.0: {"x": GOOD, "z": FAIR}}
    use = uses_of(None, *ahead(curves)).prediction
    assert (use.horizons_s, use.horizon_s, use.rmse_m) == ((0.1, 1.0), 1.0, {"x": 0.1, "z": 0.1})
    assert use.sentence == "prediction: up to 1 s ahead (there 0.100, 0.100 m in x and z)"
    # A good horizon behind a bad one is chance, and is not the answer.
    curves[10.0] = {"x": GOOD, "z": GOOD}
    assert uses_of(None, *ahead(curves)).prediction.horizon_s == 1.0
    late = {0.1: {"x": FAIR, "z": GOOD}, 0.5: {"x": GOOD, "z": GOOD}, 1.0: {"x": GOOD, "z": GOOD}}
    assert "prediction: 0.5 to 1 s ahead" in uses_of(None, *ahead(late)).prediction.sentence
    never = uses_of(None, *ahead({1.0: {"x": FAIR, "z": GOOD}})).prediction
    assert (never.horizon_s, never.sentence.startswith("prediction: no")) == (None, True)


def test_the_horizon_has_an_error_by_how_often_it_fits_into_what_was_held_out():
    """Errors that grow like the horizon to the 1.5th power reach half of constant velocity's at 2 s exactly."""

    def curves(*horizons):
        return {h: {"z": (0.5 * h * (h / 2.0) ** 1.5, 10.0 * h, h)} for h in horizons}

    use = uses_of(None, *ahead(curves(0.1, 0.5, 1.0, 5.0), flights="a")).prediction
    assert use.horizon_s == 1.0
    assert use.reach_s == pytest.approx(2.0)
    many = uses_of(None, *ahead(curves(0.1, 0.5, 1.0, 5.0), flights="abcd")).prediction
    assert many.reach_sigma_s == pytest.approx(0.5 * use.reach_sigma_s)
    beyond = uses_of(None, *ahead(curves(0.1, 0.5, 1.0))).prediction
    assert (beyond.horizon_s, beyond.reach_s, beyond.reach_sigma_s) == (1.0, None, None)
    # Errors that keep to the baselines': a horizon of 4.1 +- 5.4 s was stated of a real flight.
    flat = {h: {"z": (0.45 * h * (h / 1.0) ** 0.1, 10.0 * h, h)} for h in (0.1, 0.5, 1.0, 5.0)}
    vague = uses_of(None, *ahead(flat, flights="a")).prediction
    assert (vague.horizon_s, vague.reach_s, vague.reach_sigma_s) == (1.0, None, None)


def test_what_is_not_finite_predicts_nothing():
    nan = (float("nan"), 1.0, 0.5)
    assert uses_of(None, *ahead({1.0: {"x": nan, "z": GOOD}})).prediction.horizon_s is None
    assert (
        uses_of(None, *ahead({1.0: {"x": (0.1, float("nan"), float("nan")), "z": GOOD}})).prediction.horizon_s is None
    )


def test_parameters_count_and_need_a_prediction_that_confirms_them():
    model = SimpleNamespace(parameters={name: SimpleNamespace(determined=name != "c") for name in "abc"})
    good = {0.1: {"x": GOOD, "z": GOOD}}
    use = uses_of(model, *ahead(good)).parameters
    assert (use.trust, use.sentence) == (Trust.LIMITED, "parameters: 2 of 3 determined")
    del model.parameters["c"]
    assert uses_of(model, *ahead(good)).parameters.trust is Trust.YES
    alone = uses_of(model, *ahead({0.1: {"x": FAIR, "z": GOOD}})).parameters
    assert alone.trust is Trust.LIMITED
    assert "no prediction confirms them" in alone.sentence
    assert uses_of(None).parameters.trust is Trust.UNKNOWN
    assert uses_of(None).sentence == ("Prediction: not judged; free simulation: not judged; parameters: not judged.")


def test_one_good_model_does_not_speak_for_a_bad_one():
    good, bad = (uses_of(None, free_runs({"x": percent})) for percent in (90.0, -90.0))
    assert overall({"a": good}) == good.free_run.verdict
    assert overall({}).trust is Trust.UNKNOWN
    both = overall({"motors": bad, "reference": good, "mixer": bad})
    assert both == Verdict(Trust.LIMITED, "Trust reference for flights like these; do not trust motors and mixer.")
    assert overall({"motors": bad, "mixer": bad}) == Verdict(Trust.NO, "Do not trust motors and mixer.")
