"""The first screen of a flight: what happened, the state of the craft, how it turns, models that hold, what next."""

from __future__ import annotations

from collections.abc import Iterator

from pipeline.flight.answer.ahead import ahead
from pipeline.flight.answer.craft_state import happened, state_lines
from pipeline.flight.answer.loops import loops
from pipeline.flight.answer.next_step import next_step
from pipeline.flight.answer.parameters import parameters
from pipeline.flight.answer.picture import picture_of
from pipeline.results.answer import Answer, AnswerLine, Tone
from pipeline.results.failure import Failure, present
from pipeline.results.flight import FlightResult


def compose_answer(result: FlightResult) -> Answer:
    """Sum a flight up for its first screen; `result` is complete but for its answer."""
    picture, around = picture_of(result)
    account = result.account
    if isinstance(account, Failure):
        lines = [AnswerLine(purpose="Happened", word="", tone=Tone.UNKNOWN, text=f"Not known: {account.reason}")]
    else:
        lines = [happened(account), *state_lines(account)]
    return Answer(
        lines=(*lines, *_identified(result)),
        picture=picture,
        around=around,
        next=next_step(result),
    )


def _identified(result: FlightResult) -> Iterator[AnswerLine]:
    """Yield how it turns and which models hold, where anything is determined; what was tried in vain is one line."""
    if isinstance(result.flight, Failure) or result.log.vehicle.other_craft:
        return
    turning = loops(result)
    if turning is not None:
        yield turning
    known, account = parameters(result), present(result.account)
    crashed = account is not None and any(each.id == "crash" for each in account.story)
    # Of a flight that ended in a crash only what holds is worth a line.
    for line in (known, ahead(result)):
        if line is not None and (line.tone is Tone.GOOD or not crashed):
            yield line
