"""The first screen of a flight: a line for each purpose with a word, a number with its error and a few words."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from pipeline.results.span import Span

#: What predicts shorter [s] than a person needs to react is of use to a filter only.
HOLDS = 1.0


class Tone(StrEnum):
    """How good an answer is, for its colour."""

    GOOD = "good"
    CARE = "care"
    BAD = "bad"
    UNKNOWN = "unknown"


class Picture(StrEnum):
    """The signal that shows what happened, or of tables how the best model predicts."""

    MOTORS = "motors"
    ATTITUDE = "attitude"
    RATES = "rates"
    VIBRATION = "vibration"
    BATTERY = "battery"
    GPS = "gps"
    PREDICTION = "prediction"
    ALTITUDE = "altitude"


@dataclass(frozen=True, slots=True, kw_only=True)
class AnswerLine:
    """The answer for one purpose."""

    purpose: str  #: What is asked, such as ``"Loops"``.
    word: str  #: The answer in a word or two.
    tone: Tone
    text: str  #: What the number is, or why there is none.
    #: The number that the word rests on and its standard deviation, as far as they are known.
    value: float | None = None
    sigma: float | None = None
    unit: str = ""  #: Of both, as people read them (degrees, per cent).


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """The first screen of one flight."""

    lines: tuple[AnswerLine, ...]  #: What happened, state, loops, parameters, models.
    picture: Picture  #: The plot to show beside them.
    around: Span | None = None  #: The stretch of time that matters in it; None for the whole flight.
    next: str = ""  #: What to do next, in a sentence or two.
