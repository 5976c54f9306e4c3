"""How far ahead the best model predicts; of models that do not hold, one line."""

from __future__ import annotations

import math

from core.quantity import counted, number
from pipeline.flight.answer.words import brief, changed_load
from pipeline.flight.purposes import uses_of
from pipeline.results.answer import HOLDS, AnswerLine, Tone
from pipeline.results.failure import Failure, present
from pipeline.results.flight import FlightResult
from pipeline.results.verdict import PredictionUse


def ahead(result: FlightResult) -> AnswerLine:
    """Answer with the model that predicts furthest, and its error there."""
    fitted = [each for each in result.models if not isinstance(each.model, Failure)]
    if not fitted:
        needed = (result.flight, result.trajectory, result.experiment, *(each.model for each in result.models))
        reason = next((each.reason for each in needed if isinstance(each, Failure)), "no model")
        return _none("no model", brief(reason))
    uses = {each.key: uses_of(present(each.validation), present(each.model)).prediction for each in fitted}
    names = {each.key: each.title.partition(" →")[0] for each in fitted}
    able = {key: use for key, use in uses.items() if use.horizon_s is not None}
    best = max(able, key=lambda key: able[key].horizon_s or 0.0, default="")
    if not best or (able[best].horizon_s or 0.0) < HOLDS:
        tried = f"{counted(len(fitted), 'model')} tried"
        if not any(use.judged for use in uses.values()):
            missing = next((each.missing for each in fitted if each.missing), "too little flight was held out")
            return _none("not judged", f"{tried}: {brief(missing)}")
        return _none("none holds", tried)
    use, changed = able[best], changed_load(result)
    text = f"by {names[best]}, {_error(use)}"
    word, tone = ("yes", Tone.GOOD)
    if changed:
        # Models were fitted to two loads, and this held after the change only.
        word, tone, text = "with care", Tone.CARE, f"{text}; {changed}"
    value = use.horizon_s if use.reach_s is None else use.reach_s
    return AnswerLine(
        purpose="Predict ahead", word=word, tone=tone, text=text, value=value, sigma=use.reach_sigma_s, unit="s"
    )


def _none(word: str, text: str) -> AnswerLine:
    return AnswerLine(purpose="Predict ahead", word=word, tone=Tone.UNKNOWN, text=text)


def _error(use: PredictionUse) -> str:
    """Write the RMS error at the longest horizon, over all axes."""
    error = math.sqrt(sum(each**2 for each in use.rmse_m.values()))
    there = "" if use.reach_s is None else f" at {use.horizon_s:g} s"
    return f"± {number(error, 2)} m{there}"
