"""One word and one sentence on a model."""

import pandas as pd
import pytest

from pipeline.flight.verdict import Trust, Verdict, judge, summarise
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


@pytest.mark.parametrize(
    ("fit", "trusted", "trust", "words"),
    [
        ({"x": 90.0, "z": 80.0}, {"x": True, "z": True}, Trust.YES, "can be trusted"),
        ({"x": 90.0, "z": 20.0}, {"x": True, "z": True}, Trust.LIMITED, "in x only"),
        ({"x": 90.0, "z": -40.0}, {"x": True, "z": False}, Trust.LIMITED, "in x only"),
        ({"x": -90.0, "z": -40.0}, {"x": False, "z": False}, Trust.NO, "no better than a guess"),
        ({"x": float("nan"), "z": 90.0}, {"x": True, "z": True}, Trust.LIMITED, "in z only"),
        ({"x": 20.0, "z": -20.0}, {"x": True, "z": False}, Trust.NO, "hardly better than a guess"),
    ],
)
def test_verdict_follows_the_worst_axis(fit, trusted, trust, words):
    verdict = judge(validation(fit, trusted))
    assert verdict.trust is trust
    assert words in verdict.sentence


def test_an_axis_that_does_not_follow_its_own_flight_is_right_elsewhere_by_luck():
    found = validation({"x": 60.0, "z": 80.0}, {"x": True, "z": True})
    found.table.loc[found.table["trained"] & (found.table["output"] == "x"), "fit_percent"] = -169.0
    verdict = judge(found)
    assert verdict.trust is Trust.LIMITED
    assert "in z only" in verdict.sentence
    assert "worse than the mean on the very flight time that it was fitted to" in verdict.sentence


def test_no_verdict_without_unseen_flight():
    assert judge(None).trust is Trust.UNKNOWN
    assert judge(validation({"x": 99.0}, {"x": True}, unseen=False)).trust is Trust.UNKNOWN


def test_two_seconds_judge_nothing():
    """A held-out stretch in which the craft hardly had time to move flatters any model."""
    verdict = judge(validation({"x": 99.0}, {"x": True}, duration=2.2))
    assert verdict.trust is Trust.UNKNOWN
    assert "too short" in verdict.sentence


def test_one_record_is_not_enough_to_trust_a_model():
    verdict = judge(validation({"x": 90.0, "z": 80.0}, {"x": True, "z": True}, flights="a"))
    assert verdict.trust is Trust.LIMITED
    assert "only one record" in verdict.sentence


def test_a_diverging_model_is_called_that():
    bad = validation({"x": 0.0}, {"x": False})
    bad = Validation(**{name: getattr(bad, name) for name in bad.__slots__} | {"average": {"x": float("inf")}})
    assert "diverges" in judge(bad).sentence


def test_what_is_worse_than_the_mean_is_called_that_and_the_mean_is_quoted():
    worse = judge(validation({"x": -90.0, "z": -80.0}, {"x": False, "z": False}, mean=0.125)).sentence
    assert "errs by 1.00, 1.00 m RMS in x and z, where always predicting the mean errs by 0.125, 0.125 m" in worse
    assert "guess" not in worse
    assert worse.endswith("In x and z that is worse than always predicting the mean.")


def test_axes_that_differ_are_told_apart():
    table = validation({"x": -90.0, "z": 20.0}, {"x": False, "z": True})
    table.table.loc[table.table["output"] == "x", "rmse_mean"] = 0.5
    sentence = judge(table).sentence
    assert sentence.endswith(
        "That is worse than always predicting the mean in x and hardly better than a guess without any model in z."
    )


def test_a_closed_loop_must_beat_the_target_itself():
    verdict = judge(validation({"x": 95.0, "z": 96.0}, {"x": True, "z": False}, reference=0.9))
    assert verdict.trust is Trust.LIMITED
    assert "and taking the target itself by 0.900, 0.900 m" in verdict.sentence
    assert "In z that is no better than taking the target itself." in verdict.sentence


def test_one_good_model_does_not_speak_for_a_bad_one():
    good, bad = Verdict(Trust.YES, "good"), Verdict(Trust.NO, "bad")
    assert summarise({"a": good}) == good
    assert summarise({}).trust is Trust.UNKNOWN
    both = summarise({"motors": bad, "reference": good, "mixer": bad})
    assert both == Verdict(Trust.LIMITED, "Trust reference for flights like these; do not trust motors and mixer.")
    assert summarise({"motors": bad, "mixer": bad}) == Verdict(Trust.NO, "Do not trust motors and mixer.")
