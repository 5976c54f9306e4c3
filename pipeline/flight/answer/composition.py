"""What a flight says, by purpose: `compose_answer` chooses words and numbers that cannot contradict each other.

Every word follows from a number by a rule that stands in the file of its line; texts are short, because all six lines,
the heading and the captions of two plots must be read in ten seconds. Full reasons stand further down in a report.
"""

from __future__ import annotations

from pipeline.flight.answer.ahead import ahead
from pipeline.flight.answer.flown import flown
from pipeline.flight.answer.healthy import healthy
from pipeline.flight.answer.loops import loops
from pipeline.flight.answer.parameters import parameters
from pipeline.flight.answer.picture import picture_of, shown_model
from pipeline.flight.answer.simulator import simulate
from pipeline.results.answer import Answer, AnswerLine, Picture, Tone
from pipeline.results.failure import Failure
from pipeline.results.flight import FlightResult

#: Purposes that no log of the ground and of no other robot serves, with their word.
_UNFIT = {"Loops": "not known", "Predict ahead": "no model", "Parameters": "not known", "Simulate": "no"}


def compose_answer(result: FlightResult) -> Answer:
    """Sum a flight up for its first screen.

    Parameters
    ----------
    result : FlightResult
        Complete but for its answer.
    """
    model = shown_model(result)
    picture, around = picture_of(result, model)
    unfit = _unfit(result)
    if unfit:
        rest = tuple(
            AnswerLine(purpose=purpose, word=word, tone=Tone.UNKNOWN, text=unfit) for purpose, word in _UNFIT.items()
        )
    else:
        rest = (loops(result), ahead(result), parameters(result), simulate(result))
    lines = (flown(result), healthy(result), *rest)
    return Answer(lines=lines, picture=picture, around=around, model=model if picture is Picture.PREDICTION else "")


def _unfit(result: FlightResult) -> str:
    """Explain in a clause why nothing can be fitted to a log at all; empty where it can be tried."""
    if result.log.vehicle.other_craft:
        return f"only for multirotors, this is {result.log.vehicle.firmware}"
    return "needs a flight" if isinstance(result.flight, Failure) else ""
