"""How far ahead the best model predicts."""

from __future__ import annotations

import math

from core.quantity import number
from pipeline.flight.answer.words import brief, changed_load
from pipeline.flight.purposes import uses_of
from pipeline.results.answer import AnswerLine, Tone
from pipeline.results.failure import Failure, present
from pipeline.results.flight import FlightResult
from pipeline.results.verdict import PredictionUse


def ahead(result: FlightResult) -> AnswerLine:
    """Answer with the model that predicts furthest, and its error there."""
    fitted = [each for each in result.models if not isinstance(each.model, Failure)]
    if not fitted:
        needed = (result.flight, result.trajectory, result.experiment, *(each.model for each in result.models))
        reason = next((each.reason for each in needed if isinstance(each, Failure)), "no model")
        return AnswerLine(purpose="Predict ahead", word="no model", tone=Tone.UNKNOWN, text=brief(reason))
    uses = {each.key: uses_of(present(each.validation), present(each.model)).prediction for each in fitted}
    names = {each.key: each.title.partition(" →")[0] for each in fitted}
    able = {key: use for key, use in uses.items() if use.horizon_s is not None}
    if not able:
        judged = any(use.judged for use in uses.values())
        several = f"{len(fitted)} models were tried; none predicts" if len(fitted) > 1 else "the model does not predict"
        text = (
            f"{several} this flight better than half of what constant velocity errs"
            if judged
            else brief(next((each.missing for each in fitted if each.missing), "too little flight was held out"))
        )
        word, tone = ("none holds", Tone.UNKNOWN) if judged else ("not judged", Tone.UNKNOWN)
        return AnswerLine(purpose="Predict ahead", word=word, tone=tone, text=text)
    best = max(able, key=lambda key: able[key].horizon_s or 0.0)
    reach, sigma = able[best].reach_s, able[best].reach_sigma_s
    text = f"by {names[best]}, {_error(able[best])}"
    second = sorted((key for key in able if key != best), key=lambda key: able[key].horizon_s or 0.0)[-1:]
    text += "".join(f"; {names[key]} {able[key].horizon_s:g} s" for key in second)
    longest = able[best].horizon_s
    # What predicts shorter than a person needs to react is of use to a filter only.
    word, tone = ("yes", Tone.GOOD) if longest is not None and longest >= 1.0 else ("briefly", Tone.CARE)
    if changed := changed_load(result):
        # Models were fitted to two loads, and this held after the change only.
        word, tone, text = "with care", Tone.CARE, f"{text}; {changed}"
    value = longest if reach is None else reach
    return AnswerLine(purpose="Predict ahead", word=word, tone=tone, text=text, value=value, sigma=sigma, unit="s")


def _error(use: PredictionUse) -> str:
    """Write the RMS error at the longest horizon, over all axes; from which horizon on where not from the shortest."""
    error = math.sqrt(sum(each**2 for each in use.rmse_m.values()))
    since = f", from {use.horizons_s[0]:g} s" if use.horizons_s[0] > 0.1 and len(use.horizons_s) > 1 else ""
    there = "" if use.reach_s is None else f" at {use.horizon_s:g} s"
    return f"± {number(error, 2)} m{there}{since}"
