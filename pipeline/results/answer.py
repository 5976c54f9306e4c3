"""What a flight says, by purpose: a word, a number with its error and a few words each, for the first screen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pipeline.results.flight import Span


class Tone(StrEnum):
    """How good an answer is, for its colour."""

    GOOD = "good"
    CARE = "care"
    BAD = "bad"
    UNKNOWN = "unknown"


class Picture(StrEnum):
    """The plot that matters most of a flight."""

    MOTORS = "motors"
    ATTITUDE = "attitude"
    PREDICTION = "prediction"
    ALTITUDE = "altitude"


@dataclass(frozen=True, slots=True, kw_only=True)
class AnswerLine:
    """The answer for one purpose.

    Attributes
    ----------
    purpose : str
        What is asked, such as ``"Loops"``.
    word : str
        The answer in a word or two.
    tone : Tone
    text : str
        What the number is, or why there is none.
    value, sigma : float or None
        The number that the word rests on and its standard deviation, as far as they are known.
    unit : str
        Of both, as people read them (degrees, per cent).
    """

    purpose: str
    word: str
    tone: Tone
    text: str
    value: float | None = None
    sigma: float | None = None
    unit: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Return numbers and text for JSON."""
        return {name: getattr(self, name) for name in self.__slots__} | {"tone": str(self.tone)}


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """The answers of one flight.

    Attributes
    ----------
    lines : tuple of AnswerLine
        Flown, healthy, loops, predict ahead, parameters, simulate.
    picture : Picture
        The plot to show beside them.
    around : Span or None
        The stretch of time that matters in it; None for the whole flight.
    """

    lines: tuple[AnswerLine, ...]
    picture: Picture
    around: Span | None = None

    def to_dict(self) -> Mapping[str, Any]:
        """Return numbers and text for JSON."""
        around = self.around
        return {
            "lines": [line.to_dict() for line in self.lines],
            "picture": str(self.picture),
            "around": None
            if around is None
            else {"start_s": around.start, "stop_s": around.stop, "duration_s": around.duration},
        }
