"""What the service answers programs with: the types from which OpenAPI and the tools of MCP are described."""

from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.results.answer import Advice
from pipeline.results.drift import Alert, History, ParameterChange
from reports.quantities import HealthEvent, Quantity

#: What stands in every answer where there is no number.
NOT_DETERMINED = "not determined"


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightRef:
    """A flight that can be asked about."""

    id: str
    name: str
    craft: str  #: Id of its craft.
    craft_name: str
    start_utc: str | None  #: Take-off.
    happened: str  #: In a few words.


@dataclass(frozen=True, slots=True, kw_only=True)
class CraftRef:
    """A craft that can be asked about."""

    id: str
    name: str
    kind: str
    flights: int


@dataclass(frozen=True, slots=True)
class FlightList:
    """Flights, the newest first."""

    flights: Sequence[FlightRef]
    total: int  #: How many there are, listed or not.


@dataclass(frozen=True, slots=True)
class CraftList:
    """Craft that may be asked about."""

    craft: Sequence[CraftRef]


@dataclass(frozen=True, slots=True)
class Answers:
    """The first screen of a flight."""

    answers: Sequence[Quantity]


@dataclass(frozen=True, slots=True)
class Parameters:
    """Physical parameters."""

    parameters: Sequence[Quantity]


@dataclass(frozen=True, slots=True)
class LoopMargins:
    """Margins and bandwidths of each axis."""

    margins: Sequence[Quantity]


@dataclass(frozen=True, slots=True)
class Events:
    """What happened in a flight, and what the log and the fits had to say of it."""

    events: Sequence[HealthEvent]


@dataclass(frozen=True, slots=True)
class Predictions:
    """How far ahead each model predicts, and its errors there."""

    predictions: Sequence[Quantity]


@dataclass(frozen=True, slots=True, kw_only=True)
class Changes:
    """What changes over the flights of a craft."""

    flights: Sequence[str]
    pooled: Sequence[str]  #: Of them those that are compared.
    changes: Sequence[History]  #: Parameters with a significant change.
    motors: str  #: A sentence.
    since: Sequence[ParameterChange]
    alerts: Sequence[Alert]
    remarks: Sequence[str]


@dataclass(frozen=True, slots=True)
class ComparedFlights:
    """Parameters of two flights, or "not determined"."""

    parameters: Sequence[ParameterChange] | str


@dataclass(frozen=True, slots=True)
class NextFlights:
    """What to log and fly next time, the most useful first."""

    advice: Sequence[Advice]


@dataclass(frozen=True, slots=True)
class MessageCount:
    """How often a message comes."""

    name: str
    rows: int


@dataclass(frozen=True, slots=True)
class Moment:
    """A flight mode from a time on, an event, or what the autopilot said."""

    t: float
    kind: str  #: ``"mode"``, ``"event"`` or ``"message"``.
    text: str


@dataclass(frozen=True, slots=True)
class LoggedMessages:
    """The messages of a log that come more than once, the seconds that it covers, and what happened in it."""

    start: float
    stop: float
    messages: Sequence[MessageCount]
    moments: Sequence[Moment]


@dataclass(frozen=True, slots=True)
class LoggedParameter:
    """A parameter of the autopilot."""

    name: str
    value: float
    before: float | None  #: In the flight before; None where it had none of this name, or is not known.
    changed: bool  #: Whether somebody changed it: not counting those that the autopilot learns or counts by itself.


@dataclass(frozen=True, slots=True)
class LoggedParameters:
    """Parameters by name, those that were changed first, beside those of the flight before."""

    before: str | None  #: Name of the log of the craft's flight before; None where none is known.
    parameters: Sequence[LoggedParameter]


@dataclass(frozen=True, slots=True)
class LoggedField:
    """A field as it is written in expressions."""

    text: str
    unit: str


@dataclass(frozen=True, slots=True)
class LoggedFields:
    """The numeric fields of a message."""

    fields: Sequence[LoggedField]


@dataclass(frozen=True, slots=True)
class Signal:
    """An expression over time, thinned such that no peak is lost."""

    text: str
    unit: str
    samples: int  #: How many there are.
    t: Sequence[float]
    y: Sequence[float | None]


@dataclass(frozen=True, slots=True)
class SignalSpectrum:
    """Amplitude of an expression by frequency, as that of a sine."""

    text: str
    unit: str
    samples: int
    hz: Sequence[float]
    y: Sequence[float | None]


@dataclass(frozen=True, slots=True)
class NoSignal:
    """An expression that has no values."""

    text: str
    problem: str  #: Why.


@dataclass(frozen=True, slots=True)
class Signals:
    """Expressions in the order in which they were asked for."""

    signals: Sequence[Signal | SignalSpectrum | NoSignal]
    rotors_hz: tuple[float, float] | None = None  #: Of spectra: speeds of the rotors by ESC telemetry.
