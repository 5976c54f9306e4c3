"""Whether the craft is healthy: the event to look into, else the largest vibration."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from core.quantity import joined, number
from pipeline.flight.answer.words import brief, changed_load
from pipeline.results.answer import AnswerLine, Tone
from pipeline.results.failure import Failure
from pipeline.results.flight import FlightResult
from pipeline.results.span import Span

if TYPE_CHECKING:
    from logparse import FlightEvent
    from pipeline.results.health import FlightHealth

#: Time between the end of one trouble and the next that it led to, s.
_LED = 2.0
#: Troubles of which a crash comes, and motors at their limit that point to one of them and not to full throttle.
_LEADING, _FEW_MOTORS = ("motor-dropout", "loss-of-lift", "loss-of-control", "loss-of-yaw-authority"), 2
#: Time about a flight that still belongs to it, s: a crash is logged after the last moment in the air.
_LANDING = 5.0


def healthy(result: FlightResult) -> AnswerLine:
    """Answer with the event to look into first; without one, with the largest vibration."""
    health = result.health
    if isinstance(health, Failure):
        return _line("not known", Tone.UNKNOWN, brief(health.reason))
    if isinstance(result.flight, Failure):
        return _line("not known", Tone.UNKNOWN, _on_the_ground(health))
    worst = _worst(health, result.flight)
    if worst is not None:
        return _eventful(worst, health, result.flight)
    if changed := changed_load(result):
        # No event, but something came off, was taken up or wore out.
        return _line("check", Tone.CARE, f"{changed}: load, motors or propellers")
    return _quiet(health, result.flight)


def _line(
    word: str, tone: Tone, text: str, value: float | None = None, *, sigma: float | None = None, unit: str = ""
) -> AnswerLine:
    return AnswerLine(purpose="Healthy", word=word, tone=tone, text=text, value=value, sigma=sigma, unit=unit)


def _eventful(worst: FlightEvent, health: FlightHealth, flight: Span) -> AnswerLine:
    """Answer with the event to look into, and what led to it."""
    tone = Tone.BAD if str(worst.severity) == "error" else Tone.CARE
    word = "no" if tone is Tone.BAD else "check"
    more = _others(len(health.notable) - 1)
    loss = worst.evidence.get("thrust_loss")
    if worst.evidence.get("at_once"):
        several = f"motors {worst.evidence['at_once']} out of balance at once, from {worst.t:.1f} s{more}"
        return _line(word, tone, several)
    if isinstance(loss, float) and loss > 0.95:
        return _line(word, tone, f"motor {worst.evidence['motor']} lost all its thrust at {worst.t:.1f} s{more}")
    if isinstance(loss, float):
        sigma = 100.0 * float(worst.evidence["thrust_loss_sigma"] or 0.0)
        output = worst.evidence.get("output_loss")
        part = f" ({100.0 * output:.0f} % of its output)" if isinstance(output, float) else ""
        text = f"of motor {worst.evidence['motor']}'s thrust lost from {worst.t:.1f} s{part}{more}"
        return _line(word, tone, text, 100.0 * loss, sigma=sigma, unit="%")
    where = "" if worst in during(health, flight) or worst is health.cause else " in another flight"
    before = led_to(worst, health)
    if before is None:
        return _line(word, tone, f"{_named(worst)}{where} at {worst.t:.1f} s{more}")
    since = "from" if before.id == "motor-at-limit" else "at"
    text = f"{_named(before)} {since} {before.t:.1f} s, {_named(worst)} at {worst.t:.1f} s{where}"
    return _line(word, tone, text + _others(len(health.notable) - 2))


def _others(count: int) -> str:
    return f"; {count} more event{'s' if count > 1 else ''}" if count else ""


def _quiet(health: FlightHealth, flight: Span) -> AnswerLine:
    """Answer for a flight without an event, with its largest vibration where that is logged."""
    unchecked = "; motors not checked" if health.motors_missing else ""
    tone = Tone.UNKNOWN if unchecked else Tone.GOOD
    word = "nothing seen" if unchecked else "yes"
    panels = () if health.signals is None else health.signals.vibration
    peaks = [float(abs(signal.y).max()) for panel in panels for signal in panel.signals if len(signal.y)]
    if peaks and math.isfinite(max(peaks)):
        # Above the limit without an event: for less time than a warning takes.
        advised = min(panels[0].limits.values())
        moment = ", for a moment only" if max(peaks) > advised else ""
        text = f"largest vibration{moment} (advised below {number(advised, 2)}), no event{unchecked}"
        return _line(word, tone, text, max(peaks), unit="m/s²")
    text = f"in the air without an event; vibration not logged{unchecked}"
    return _line(word, tone, text, flight.duration, unit="s")


def _on_the_ground(health: FlightHealth) -> str:
    """Return what the autopilot complained of last in a log without a flight."""
    said = [event for event in health.events if event.id in ("failsafe-triggered", "autopilot-error")]
    if not said:
        return "on the ground; the autopilot reported no failsafe and no error"
    last = said[-1]
    what = last.reason.partition(": ")[2].rstrip(".") or last.reason.rstrip(".")
    kind = "failsafe" if last.id == "failsafe-triggered" else "error"
    return f"on the ground; last {kind} reported: {what} at {last.t:.1f} s"


def _worst(health: FlightHealth, flight: Span) -> FlightEvent | None:
    """Return the event to name: what ended the flight, else the first that endangers, else the first to look into.

    Events of other flights of the log come after those of the flight that is analysed.
    """
    inside = during(health, flight)
    errors = [event for event in inside if str(event.severity) == "error"]
    return health.cause or next(iter((*errors, *inside, *health.notable)), None)


def led_to(event: FlightEvent, health: FlightHealth) -> FlightEvent | None:
    """Return what a crash came from: the first of the troubles that led from one to the next without a pause."""
    if event.id != "crash":
        return None
    first: FlightEvent | None = None
    begin = event.t
    for each in sorted(health.notable, key=lambda one: one.t, reverse=True):
        if each.t < begin <= each.end + _LED and _leads(each):
            first, begin = each, each.t
    return first


def _leads(event: FlightEvent) -> bool:
    """Return whether an event is of the kind that leads to a crash: of motors at their limit, where few are."""
    return event.id in _LEADING or (event.id == "motor-at-limit" and len(_motors_of(event)) <= _FEW_MOTORS)


def _motors_of(event: FlightEvent) -> list[str]:
    return str(event.evidence["motors"]).split(", ")


def _named(event: FlightEvent) -> str:
    if event.id == "motor-dropout":
        return f"dropout of motor {event.evidence['motor']}"
    if event.id == "motor-at-limit":
        motors = _motors_of(event)
        several = len(motors) > 1
        return f"motor{'s' if several else ''} {joined(motors)} at {'their' if several else 'its'} limit"
    return event.id.replace("-", " ")


def during(health: FlightHealth, flight: Span) -> list[FlightEvent]:
    """Return the notable events of the analysed flight, its landing included."""
    return [event for event in health.notable if flight.start - _LANDING <= event.t <= flight.stop + _LANDING]
