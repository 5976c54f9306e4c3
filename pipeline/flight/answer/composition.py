"""The first screen of a flight: what happened, the state of the craft, how it turns, models that hold, what next."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from pipeline.flight.answer.craft_state import happened, state_lines
from pipeline.flight.answer.identified import ahead, loops, parameters
from pipeline.results.answer import Answer, AnswerLine, Picture, Tone
from pipeline.results.failure import Failure, present
from pipeline.results.flight import FlightResult
from pipeline.results.span import Span


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
    account = present(result.account)
    crashed = account is not None and any(each.id == "crash" for each in account.story)
    # Of a flight that ended in a crash only what is good or bad is worth a line.
    for line in (loops(result), parameters(result), ahead(result)):
        if line is not None and (line.tone in (Tone.GOOD, Tone.BAD) or not crashed):
            yield line


def next_step(result: FlightResult) -> str:
    """Return what to inspect before the next flight, else how to fly or log better."""
    account = result.account
    if not isinstance(account, Failure):
        told = next((each.advice for each in (*account.story, *account.notable) if each.advice), "")
        if told:
            return told
    first = next(iter(result.advice), None)
    return "" if first is None else f"{first.do.rstrip('.')}."


#: Time shown before and after what happened, s.
_BEFORE, _AFTER = 8.0, 6.0
#: The signal that shows each kind of happening; height where none is named.
_SHOWS: Mapping[str, Picture] = {
    "motor-fault": Picture.MOTORS,
    "control-lost": Picture.ATTITUDE,
    "oscillation": Picture.RATES,
    "yaw-lost": Picture.MOTORS,
    "vibration": Picture.VIBRATION,
    "gps-lost": Picture.GPS,
    "gps-glitch": Picture.GPS,
    "crash": Picture.ATTITUDE,
}
_FAILSAFES: Mapping[str, Picture] = {"FAILSAFE_BATTERY": Picture.BATTERY, "FAILSAFE_GPS": Picture.GPS}


def picture_of(result: FlightResult) -> tuple[Picture, Span | None]:
    """Choose the plot of the first screen, and the stretch of time that it shows; None for the whole flight."""
    account, flight = present(result.account), present(result.flight)
    if account is not None and flight is not None and (cause := account.cause) is not None and cause.t is not None:
        last = account.story[-1]
        end = max(last.t or cause.t, min(last.end or cause.t, cause.t + 20.0))
        around = Span(max(cause.t - _BEFORE, flight.start - 2.0), end + _AFTER)
        picture = _SHOWS.get(cause.id, Picture.ALTITUDE)
        picture = _FAILSAFES.get(str(cause.evidence.get("subsystem")), picture)
        return (picture if _drawn(result, picture) else Picture.ALTITUDE), around
    return Picture.ALTITUDE, None


def _drawn(result: FlightResult, picture: Picture) -> bool:
    """Return whether the log has the signal."""
    if picture is Picture.MOTORS:
        return result.motors is not None and result.motors.shape[1] > 0
    if picture is Picture.ALTITUDE or isinstance(result.signals, Failure):
        return False
    return bool(getattr(result.signals, str(picture)))
