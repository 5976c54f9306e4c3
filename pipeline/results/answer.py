"""The first screen of a flight: a line for each purpose with a word, a number and a few words; and advice."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from core.quantity import uncertain
from pipeline.results.span import Span


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

    @property
    def number(self) -> str:
        """The number as people read it: times to a tenth of a second, nothing beyond three digits without an error."""
        value, unit = self.value, self.unit
        if value is None:
            return ""
        if self.sigma is not None:
            return uncertain(value, self.sigma, unit).replace(" °", "°")
        text = f"{round(value, 1):.8g}" if abs(value) >= 10.0 else f"{value:.3g}"
        return f"{text}{'' if unit == '°' else ' '}{unit}".strip()

    @property
    def said(self) -> str:
        """Word, number and text."""
        return " ".join(part for part in (self.word, self.number, self.text) if part)


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """The first screen of one flight."""

    lines: tuple[AnswerLine, ...]  #: What happened, state, loops, parameters, models.
    picture: Picture  #: The plot to show beside them.
    around: Span | None = None  #: The time span that matters in it; None for the whole flight.
    next: str = ""  #: What to do next, in a sentence or two.

    def line(self, purpose: str) -> AnswerLine | None:
        """Return the answer for a purpose; None where there is none."""
        return next((line for line in self.lines if line.purpose == purpose), None)


@dataclass(frozen=True, slots=True, kw_only=True)
class Advice:
    """What to do next time."""

    id: str  #: Stable kebab-case name.
    #: Lower is more useful: below 10 nothing can be identified without it, below 20 results are wrong or at risk, below
    #: 30 a parameter or an axis stays unknown, above that it is better known.
    rank: int
    do: str  #: In the imperative.
    why: str  #: What these flights lacked, in numbers.
    gain: str  #: What it brings.
    #: Parameters of the autopilot to set; those that hold bits are whole numbers.
    settings: Mapping[str, int | float] = field(default_factory=dict)
    flights: tuple[str, ...] = ()  #: That it is about; empty when about all.


def clause(reason: str) -> str:
    """Return the first clause of a reason; the whole stands further down."""
    return re.split(r"[:;(]|\. ", reason, maxsplit=1)[0].strip().rstrip(".")
