"""One word and one sentence on a model."""

from types import SimpleNamespace

import pandas as pd
import pytest

from pipeline.flight.purposes import free_run_use, summarise, uses_of
from pipeline.results.model import Trust, Verdict
from sysid import Validation


def validation(
    fit: dict[str, float],
    trusted: dict[str, bool],
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
    return Validation(
        model="m",
        table=pd.DataFrame(rows),
        horizons=pd.DataFrame(),
        residuals={},
        average=dict.fromkeys(fit, 1.0),
        verdicts=(),
        trusted=trusted,
        unseen=unseen,
        predictions={},
    )


def assess(found, outside=()):
    return free_run_use(found, outside).verdict


@pytest.mark.parametrize(
    ("fit", "trusted", "trust", "words"),
    [
        ({"x": 90.0, "z": 80.0}, {"x": True, "z": True}, Trust.YES, "can be trusted"),
        ({"x": 90.0, "z": 20.0}, {"x": True, "z": True}, Trust.LIMITED, "in x only"),
        ({"x": 90.0, "z": -40.0}, {"x": True, "z": False}, Trust.LIMITED, "in x only"),
        ({"x": -90.0, "z": -40.0}, {"x": False, "z": False}, Trust.NO, "Do not trust"),
        ({"x": float("nan"), "z": 90.0}, {"x": True, "z": True}, Trust.LIMITED, "in z only"),
        ({"x": 20.0, "z": -20.0}, {"x": True, "z": False}, Trust.NO, "Do not trust"),
    ],
)
def test_verdict_follows_the_worst_axis(fit, trusted, trust, words):
    verdict = assess(validation(fit, trusted))
    assert verdict.trust is trust
    assert words in verdict.sentence


def test_an_axis_that_does_not_follow_its_own_flight_is_right_elsewhere_by_luck():
    found = validation({"x": 60.0, "z": 80.0}, {"x": True, "z": True})
    found.table.loc[found.table["trained"] & (found.table["output"] == "x"), "fit_percent"] = -169.0
    verdict = assess(found)
    assert verdict.trust is Trust.LIMITED
    assert "in z only" in verdict.sentence


def test_no_verdict_without_unseen_flight():
    assert assess(None).trust is Trust.UNKNOWN
    assert assess(validation({"x": 99.0}, {"x": True}, unseen=False)).trust is Trust.UNKNOWN


def test_two_seconds_judge_nothing():
    """A held-out stretch in which the craft hardly had time to move flatters any model."""
    verdict = assess(validation({"x": 99.0}, {"x": True}, duration=2.2))
    assert verdict.trust is Trust.UNKNOWN
    assert "too short" in verdict.sentence


def test_one_record_is_not_enough_to_trust_a_model():
    verdict = assess(validation({"x": 90.0, "z": 80.0}, {"x": True, "z": True}, flights="a"))
    assert verdict.trust is Trust.LIMITED
    assert "only one record" in verdict.sentence


def test_a_target_that_is_as_good_is_said_and_does_not_condemn_the_model():
    """Off by 0.1 m where the target is off by 0.1 m too, of flights that move by metres: `do not trust` misled."""
    found = validation({"x": 95.0, "z": 96.0}, {"x": False, "z": False}, mean=20.0, reference=1.02)
    verdict = assess(found)
    assert verdict.trust is Trust.YES
    assert "in x and z the target itself is as good" in verdict.sentence
    assert uses_of(found, None).free_run.as_good_as_target == ("x", "z")


@pytest.mark.parametrize("flights", ["a", "ab"])
def test_an_axis_that_did_not_move_condemns_no_model_that_does_better_than_its_target(flights):
    """Hardly a step in y: off by 5 cm where the target is off by 6, `no` for 7 times the mean's error of 7 mm."""
    found = validation({"x": 98.0, "y": -600.0}, {"x": True, "y": True}, mean=20.0, reference=1.2, flights=flights)
    found.table.loc[found.table["output"] == "y", "rmse_mean"] = 0.14
    run = uses_of(found, None).free_run
    assert (run.trust, run.far, run.better_than_target) == (Trust.LIMITED, (), ("x", "y"))
    assert assess(found).trust is Trust.LIMITED
    assert "in x only" in assess(found).sentence
    worse = validation({"x": 98.0, "y": -600.0}, {"x": True, "y": True}, mean=20.0, reference=0.5, flights=flights)
    worse.table.loc[worse.table["output"] == "y", "rmse_mean"] = 0.14
    assert uses_of(worse, None).free_run.trust is Trust.NO


def errors(*rows, mean=(14.0, 17.0, 7.0)):
    """Make a validation of held-out flights with these errors in x, y, z."""
    found = validation({"x": 0.0, "y": 0.0, "z": 0.0}, dict.fromkeys("xyz", True), flights="abcdefgh"[: len(rows)])
    table = found.table
    for flight, row in zip("abcdefgh", rows, strict=False):
        for output, error, size in zip("xyz", row, mean, strict=True):
            at = (table["flight"] == flight) & (table["output"] == output)
            table.loc[at, ["rmse", "rmse_mean"]] = error, size
            table.loc[at & ~table["trained"], "fit_percent"] = 100.0 * (1.0 - error / size)
            table.loc[at & table["trained"], "fit_percent"] = 90.0
    average = {output: float(table.loc[table["output"] == output, "rmse"].mean()) for output in "xyz"}
    return Validation(**{name: getattr(found, name) for name in found.__slots__} | {"average": average})


def test_one_axis_far_beyond_the_mean_is_no_for_free_runs():
    """64, 59 and 2.7 m, where the mean errs by 14, 17 and 7 m, was `with care`."""
    found = errors((64.0, 59.0, 2.7), (64.0, 59.0, 2.7))
    run = uses_of(found, None).free_run
    assert (run.trust, run.follows, run.far) == (Trust.NO, ("z",), ("x", "y"))
    assert "x 4.6 times and y 3.5 times the error of always predicting the mean" in run.sentence
    verdict = assess(found)
    assert verdict.trust is Trust.NO
    assert "no better than its worst axis" in verdict.sentence


def test_a_single_record_must_hold_in_all_axes():
    assert uses_of(errors((1.0, 1.0, 5.0)), None).free_run.trust is Trust.NO
    assert "A single record must hold in every axis" in assess(errors((1.0, 1.0, 5.0))).sentence
    assert uses_of(errors((1.0, 1.0, 1.0)), None).free_run.trust is Trust.LIMITED
    assert uses_of(errors((1.0, 1.0, 5.0), (1.0, 1.0, 5.0)), None).free_run.trust is Trust.LIMITED
    assert uses_of(errors((1.0, 1.0, 1.0), (1.0, 1.0, 1.0)), None).free_run.trust is Trust.YES


def test_flights_outside_the_envelope_are_counted_apart():
    good, bad, away = (1.4, 1.7, 0.7), (10.0, 1.7, 0.7), (90.0, 90.0, 90.0)
    found = errors(good, good, good, good, bad, away)
    run = uses_of(found, None, outside={"f"}).free_run
    assert (run.flights_within, run.followed_within, run.flights_outside, run.followed_outside) == (5, 4, 1, 0)
    assert run.flights() == (
        "4 of 5 flights within the envelope are followed in every axis to 90–90 %; 0 of 1 outside it"
    )
    assert run.trust is Trust.YES, "on average over those within, every axis is followed"
    assert assess(found, outside={"f"}).trust is Trust.YES
    assert assess(found).trust is Trust.NO
    # Where all are outside, nothing else judges, and they do not make a model trusted.
    assert uses_of(errors(good, good), None, outside={"a", "b"}).free_run.trust is Trust.LIMITED
    assert (
        "no held-out record lies within the fitted envelope" in assess(errors(good, good), outside={"a", "b"}).sentence
    )


def ahead(curves, flights="ab"):
    """Make a validation with errors by horizon: horizon -> (error, constant position, constant velocity) by output."""
    found = validation({"x": 90.0, "z": 90.0}, {"x": True, "z": True}, flights=flights)
    rows = [
        {"flight": flight, "output": output, "trained": False, "horizon": horizon}
        | dict(zip(("rmse", "rmse_constant_position", "rmse_constant_velocity"), values, strict=True))
        for flight in flights
        for horizon, by_output in curves.items()
        for output, values in by_output.items()
    ]
    return Validation(**{name: getattr(found, name) for name in found.__slots__} | {"horizons": pd.DataFrame(rows)})


GOOD, FAIR = (0.1, 1.0, 0.5), (0.3, 1.0, 0.5)


def test_the_horizon_is_the_longest_at_which_every_axis_halves_both_guesses():
    curves = {0.1: {"x": GOOD, "z": GOOD}, 1.0: {"x": GOOD, "z": GOOD}, 5.0: {"x": GOOD, "z": FAIR}}
    use = uses_of(ahead(curves), None).prediction
    assert (use.horizons_s, use.horizon_s, use.rmse_m) == ((0.1, 1.0), 1.0, {"x": 0.1, "z": 0.1})
    assert use.sentence == "prediction: up to 1 s ahead (there 0.100, 0.100 m in x and z)"
    # A good horizon behind a bad one is chance, and is not the answer.
    curves[10.0] = {"x": GOOD, "z": GOOD}
    assert uses_of(ahead(curves), None).prediction.horizon_s == 1.0
    late = {0.1: {"x": FAIR, "z": GOOD}, 0.5: {"x": GOOD, "z": GOOD}, 1.0: {"x": GOOD, "z": GOOD}}
    assert "prediction: 0.5 to 1 s ahead" in uses_of(ahead(late), None).prediction.sentence
    never = uses_of(ahead({1.0: {"x": FAIR, "z": GOOD}}), None).prediction
    assert (never.horizon_s, never.sentence.startswith("prediction: no")) == (None, True)


def test_the_horizon_has_an_error_by_how_often_it_fits_into_what_was_held_out():
    """Errors that grow like the horizon to the 1.5th power reach half of constant velocity's at 2 s exactly."""

    def curves(*horizons):
        return {h: {"z": (0.5 * h * (h / 2.0) ** 1.5, 10.0 * h, h)} for h in horizons}

    use = uses_of(ahead(curves(0.1, 0.5, 1.0, 5.0), flights="a"), None).prediction
    assert use.horizon_s == 1.0
    assert use.reach_s == pytest.approx(2.0)
    many = uses_of(ahead(curves(0.1, 0.5, 1.0, 5.0), flights="abcd"), None).prediction
    assert many.reach_sigma_s == pytest.approx(0.5 * use.reach_sigma_s)
    beyond = uses_of(ahead(curves(0.1, 0.5, 1.0)), None).prediction
    assert (beyond.horizon_s, beyond.reach_s, beyond.reach_sigma_s) == (1.0, None, None)
    # Errors that keep to the baselines': a horizon of 4.1 +- 5.4 s was stated of a real flight.
    flat = {h: {"z": (0.45 * h * (h / 1.0) ** 0.1, 10.0 * h, h)} for h in (0.1, 0.5, 1.0, 5.0)}
    vague = uses_of(ahead(flat, flights="a"), None).prediction
    assert (vague.horizon_s, vague.reach_s, vague.reach_sigma_s) == (1.0, None, None)


def test_what_is_not_finite_predicts_nothing():
    nan = (float("nan"), 1.0, 0.5)
    assert uses_of(ahead({1.0: {"x": nan, "z": GOOD}}), None).prediction.horizon_s is None
    assert uses_of(ahead({1.0: {"x": (0.1, float("nan"), float("nan")), "z": GOOD}}), None).prediction.horizon_s is None


def test_parameters_count_and_need_a_prediction_that_confirms_them():
    model = SimpleNamespace(parameters={name: SimpleNamespace(determined=name != "c") for name in "abc"})
    good = {0.1: {"x": GOOD, "z": GOOD}}
    use = uses_of(ahead(good), model).parameters
    assert (use.trust, use.determined, use.total, use.confirmed) == (Trust.LIMITED, 2, 3, True)
    del model.parameters["c"]
    assert uses_of(ahead(good), model).parameters.trust is Trust.YES
    alone = uses_of(ahead({0.1: {"x": FAIR, "z": GOOD}}), model).parameters
    assert alone.trust is Trust.LIMITED
    assert "no prediction confirms them" in alone.sentence
    assert uses_of(None, None).parameters.trust is Trust.UNKNOWN
    assert uses_of(None, None).sentence == (
        "Prediction: not judged; free simulation: not judged; parameters: not judged."
    )


def test_one_good_model_does_not_speak_for_a_bad_one():
    good, bad = Verdict(Trust.YES, "good"), Verdict(Trust.NO, "bad")
    assert summarise({"a": good}) == good
    assert summarise({}).trust is Trust.UNKNOWN
    both = summarise({"motors": bad, "reference": good, "mixer": bad})
    assert both == Verdict(Trust.LIMITED, "Trust reference for flights like these; do not trust motors and mixer.")
    assert summarise({"motors": bad, "mixer": bad}) == Verdict(Trust.NO, "Do not trust motors and mixer.")
