"""The account of a flight: when it flew, what it read, what happened, causes before consequences, gravest first."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from core.findings import Happening, Severity
from core.parameter import Parameter
from pipeline.results.span import Span

#: Kinds of happenings by gravity: what broke the craft, what took control of it, what took its senses, what wears it.
GRAVITY = (
    "crash",
    "motor-fault",
    "disarmed-in-air",
    "throttle-runaway",
    "lift-lost",
    "control-lost",
    "failsafe",
    "yaw-lost",
    "gps-lost",
    "oscillation",
    "hard-landing",
    "vibration",
    "height-estimate-wrong",
    "shock-in-flight",
    "gps-glitch",
    "autopilot-error",
)


def gravity(happening: Happening) -> int:
    """Return the place of a happening among all, 0 for the gravest."""
    return GRAVITY.index(happening.id) if happening.id in GRAVITY else len(GRAVITY)


class PhaseKind(StrEnum):
    """What the craft did in a phase."""

    GROUND = "ground"
    FLIGHT = "flight"
    FALL = "fall"


@dataclass(frozen=True, slots=True)
class Phase:
    """A time span in which the craft did one thing, s on the log's boot clock; None for an end of the log."""

    kind: PhaseKind
    start: float | None
    stop: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """A number that anyone can read in a log viewer."""

    value: float  #: In `unit`.
    unit: str
    t: float | None = None  #: When it was read, s; None for what holds for the whole flight.
    source: str = ""  #: Which sensor or message it is of.
    others: Mapping[str, float] = field(default_factory=dict)  #: What other sources say of the same, by source.


@dataclass(frozen=True, slots=True, kw_only=True)
class BatteryReading:
    """Voltages before lift-off, after touch-down and the lowest in flight, V."""

    start: float
    end: float
    lowest: float
    cells: int | None = None  #: Lithium cells in series, by the voltage at rest; None where that is not logged.
    sag: Parameter | None = None  #: Resistance by which the voltage sags, ohm; None where current is not logged.


@dataclass(frozen=True, slots=True, kw_only=True)
class VibrationReading:
    """The worst vibration of a flight, as the autopilot measures it."""

    worst: float  #: m/s^2.
    p95: float  #: Exceeded for 5 % of the flight, m/s^2.
    t: float
    axis: str  #: Of the body; empty where the log has one number for all.
    clips: int | None  #: How often an accelerometer hit its range; None where not logged.
    #: Published limits, m/s^2: normally acceptable below the first, nearly always harmful above the other.
    advised: float
    harmful: float
    source: str


@dataclass(frozen=True, slots=True, kw_only=True)
class GpsReading:
    """Satellites in flight and the share of time with a three-dimensional fix."""

    satellites_least: int | None
    satellites_median: int | None
    fix_share: float
    hdop: float | None = None  #: Median dilution of the horizontal position.


@dataclass(frozen=True, slots=True, kw_only=True)
class HoverReading:
    """How much of the full throttle hovering takes, 0..1."""

    start: float  #: Over the first steady hover.
    end: float  #: Over the last.


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorsReading:
    """How hard each motor worked, 0..1 of the range between its limits."""

    mean: Mapping[str, float]  #: By motor, over the flight.
    hardest: str
    at_limit: float  #: Share of the flight with a motor at its upper limit.

    @property
    def spread(self) -> float:
        """Difference between the motor that works hardest and the one that works least."""
        return max(self.mean.values()) - min(self.mean.values())


@dataclass(frozen=True, slots=True, kw_only=True)
class Account:
    """What happened in one flight, or in a log without one."""

    flight: Span | None
    phases: tuple[Phase, ...] = ()
    #: What a pilot reads off; None where the log does not tell.
    height: Reading | None = None  #: Above the ground that the flight left, m.
    distance: Reading | None = None  #: Largest horizontal distance from the take-off, m.
    ground_speed: Reading | None = None  #: Largest horizontal speed, m/s.
    doubtful: tuple[Span, ...] = ()  #: When the receiver is not to be believed: left out of both.
    climb: Reading | None = None  #: Fastest climb and sink, m/s.
    sink: Reading | None = None
    battery: BatteryReading | None = None
    vibration: VibrationReading | None = None
    gps: GpsReading | None = None
    hover: HoverReading | None = None
    motors: MotorsReading | None = None
    happenings: tuple[Happening, ...] = ()  #: Each with its time; the gravest first, what is only to be known last.
    #: The gravest with what led to it and what followed, in the order of time; what to do stands with the happenings.
    story: tuple[Happening, ...] = ()
    headline: str = ""  #: The story in a sentence, or that nothing happened.
    unseen: tuple[str, ...] = ()  #: Which parts of the flight the log does not hold, a sentence each.
    unknown: tuple[str, ...] = ()  #: What the log does not tell, a clause each.
    #: The part of the flight before anything broke, which serves models; None without a flight.
    sound: Span | None = None

    @property
    def cause(self) -> Happening | None:
        """What the story began with; None where nothing happened."""
        return self.story[0] if self.story else None

    @property
    def in_short(self) -> str:
        """What happened in a few words, as a table of flights has room for."""
        if self.flight is None:
            return "no flight"
        happenings = self.story or self.notable[:1]
        if not happenings:
            return "partly logged" if self.unseen else "uneventful"
        names = [str(finding.evidence.get("what") or finding.id.replace("-", " ")) for finding in happenings]
        return ", ".join(dict.fromkeys((names[0], names[-1])))

    @property
    def gravest(self) -> Happening | None:
        """What mattered most; None where nothing happened."""
        first = self.happenings[0] if self.happenings else None
        return first if first is not None and first.notable else None

    @property
    def notable(self) -> tuple[Happening, ...]:
        """Happenings that a healthy flight does not have, the gravest first."""
        return tuple(happening for happening in self.happenings if happening.notable)

    @property
    def causes_first(self) -> tuple[Happening, ...]:
        """The notable happenings, those of the story before all others and in its order."""
        places = {(happening.id, happening.t): place for place, happening in enumerate(self.story)}
        return tuple(sorted(self.notable, key=lambda happening: places.get((happening.id, happening.t), len(places))))

    @property
    def severity(self) -> Severity:
        """Severity of the gravest."""
        return Severity.INFO if self.gravest is None else self.gravest.severity
