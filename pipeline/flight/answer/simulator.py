"""Whether ArduPilot's simulator can fly this craft."""

from __future__ import annotations

from logparse import MissingDataError
from pipeline.flight.answer.words import brief
from pipeline.flight.kinds import RIGID_BODY_KEY
from pipeline.flight.purposes import uses_of
from pipeline.results.answer import AnswerLine, Tone
from pipeline.results.failure import present
from pipeline.results.flight import FlightResult, ModelResult
from pipeline.results.verdict import Trust
from sysid.rigid_body.export.frame_json import frame_json
from sysid.rigid_body.model import RigidBodyModel


def simulate(result: FlightResult) -> AnswerLine:
    """Answer whether ArduPilot's simulator can fly this craft, and how many of its numbers the flight determined."""
    body = _model(result, RIGID_BODY_KEY)
    model = None if body is None else body.model
    if body is None or not isinstance(model, RigidBodyModel):
        reason = "no rigid body model" if body is None or not body.missing else brief(body.missing)
        return AnswerLine(purpose="Simulate", word="no", tone=Tone.UNKNOWN, text=reason)
    try:
        frame = frame_json(model, result.config.mass)
    except MissingDataError as error:
        needs = "give the mass (--mass)" if result.config.mass is None and model.mass is None else brief(str(error))
        return AnswerLine(purpose="Simulate", word="not yet", tone=Tone.UNKNOWN, text=f"SITL frame: {needs}")
    count = len(frame.frame)
    known = count - len(frame.undetermined)
    confirmed = uses_of(present(body.validation), model).parameters.trust is Trust.YES
    text = f"of {count} SITL frame numbers from flight"
    if not confirmed:
        text += "; not confirmed by predictions"
    word, tone = ("yes", Tone.GOOD) if confirmed else ("with care", Tone.CARE)
    return AnswerLine(purpose="Simulate", word=word, tone=tone, text=text, value=float(known))


def _model(result: FlightResult, key: str) -> ModelResult | None:
    return next((each for each in result.models if each.key == key), None)
