"""From a log to the timeline of its events, and to the part of a flight that can serve models."""

from __future__ import annotations

from functools import cache, partial

import numpy as np

from core.parameter import Parameter
from core.quantity import joined
from logparse import Finding, FlightEvent, FlightLog, MissingDataError, Severity, flight_events
from pipeline.flight.health.signals import health_signals
from pipeline.results.health import FlightHealth
from pipeline.results.span import Span, around
from sysid.rotors.battery import sag_resistance
from sysid.rotors.motor_dropout import Dropout, MotorDropouts, find_motor_dropouts
from sysid.rotors.motor_loss import MotorLoss, find_motor_losses, read_moments
from sysid.rotors.motor_order import find_order_change

#: Events after which the craft is no longer the one to model.
_EXCHANGED = "motor-order-changed"
_ENDING = ("crash", "disarmed-in-air", "motor-loss", _EXCHANGED)
#: Time before such an event that is left out with it, s: a change is timed to a few tenths of a second.
_MARGIN = 0.3
#: Time for which a craft out of control still tells its motors apart, s: later it tumbles, or lies on the ground.
_TUMBLING = 2.0
#: Time between the end of a loss of control and the crash that it led to, s.
_LED_TO = 2.0
#: Time before a landing in which the ground pushes, s; a log has none whose motor outputs end within `_CUT` seconds of
#: the flight, unless the autopilot said so within `_LANDED` seconds before.
_LANDING, _CUT, _LANDED = 2.0, 0.3, 4.0


def assess_health(log: FlightLog, flight: Span | None) -> FlightHealth:
    """Compose the timeline of a flight, failing motors included.

    Parameters
    ----------
    log : FlightLog
    flight : Span or None
        The flight that is analysed. Events on the ground belong to the flight that is nearer.
    """
    part = around(flight, log.flights)
    found = flight_events(log.tables, log.messages, log.flights)
    events = [event for event in found if part.start <= event.t < part.stop]
    missing = ""
    try:
        if flight is not None:
            aloft = _ends_aloft(log, flight)
            events += _exchanged(log, flight.start, _undisturbed(flight, events, aloft=aloft))
            moments_until = cache(partial(read_moments, log.tables, log.vehicle, flight.start))
            losses = find_motor_losses(moments_until(_undisturbed(flight, events, aloft=aloft)), log.vehicle)
            events += [_motor_event(loss, losses) for loss in losses]
            dropouts = find_motor_dropouts(moments_until(_controlled(flight, events)), log.tables, log.vehicle)
            events += [_dropout_event(each, one) for each in dropouts for one in each.dropouts]
    except MissingDataError as error:
        missing = str(error)
    events.sort(key=lambda event: event.t)
    cause = None if flight is None else _ending(flight, events)
    return FlightHealth(
        events=tuple(events),
        sound=flight
        if flight is None or cause is None
        else Span(flight.start, max(flight.start, _begin(cause, events))),
        cause=cause,
        motors_missing=missing,
        sag=None if flight is None else _sag(log, flight),
        signals=None if flight is None else health_signals(log, flight),
    )


def _sag(log: FlightLog, flight: Span) -> Parameter | None:
    if log.tables.battery is None:
        return None
    flown = log.tables.battery.loc[flight.start : flight.stop]
    t, voltage, current = flown.index, flown["voltage"], flown["current"]
    return sag_resistance(*(each.to_numpy(np.float64) for each in (t, voltage, current)))


def health_findings(health: FlightHealth) -> tuple[Finding, ...]:
    """Explain which part of the flight trains and judges no models, and why."""
    if health.cause is None or health.sound is None:
        return ()
    cause = health.cause
    return (
        Finding(
            "unsound-flight-excluded",
            Severity.WARNING,
            f"From {health.sound.stop:.1f} s on nothing trains or judges models. {cause.reason}",
            cause.advice,
            {"from_s": health.sound.stop, "event": cause.id, "event_s": cause.t},
        ),
    )


def _ends_aloft(log: FlightLog, flight: Span) -> bool:
    """Return whether the log ends with the flight and nothing says that it landed: power was cut, or the file."""
    motors, said = log.tables.motors, log.tables.events
    if motors is None or len(motors) < 2 or float(motors.index[-1]) - flight.stop > _CUT:
        return False
    if said is None:
        return True
    landed = said["event"].loc[flight.stop - _LANDED :].isin(["LAND_COMPLETE", "LAND_COMPLETE_MAYBE", "DISARMED"])
    return not bool(landed.any())


def _undisturbed(flight: Span, events: list[FlightEvent], *, aloft: bool = False) -> float:
    """Last moment of a flight at which its motors can be compared, s: before it is lost, hits the ground or lands."""
    blows = [
        event.t - 0.1
        for event in events
        if event.id in ("crash", "disarmed-in-air", _EXCHANGED) and flight.start < event.t < flight.stop + 2.0
    ]
    tumbles = [
        event.t + _TUMBLING
        for event in events
        if event.id == "loss-of-control" and event.duration > _TUMBLING and flight.start < event.t < flight.stop
    ]
    return min([*blows, *tumbles[:1], flight.stop if aloft else flight.stop - _LANDING])


def _controlled(flight: Span, events: list[FlightEvent]) -> float:
    """Last moment of a flight at which a motor's dropout can be told from what else is wrong, s."""
    wrong = [
        event.t
        for event in events
        if event.id in ("loss-of-control", "motor-loss", "attitude-not-held", "oscillation") and event.t > flight.start
    ]
    return min([*wrong, _undisturbed(flight, events)])


def _exchanged(log: FlightLog, start: float, stop: float) -> list[FlightEvent]:
    """Name outputs that changed places in flight, which else looks like a motor that weakens."""
    change = find_order_change(log.tables, log.vehicle, start, stop)
    if change is None:
        return []
    what = ", ".join(f"{name} follows what the mixer asks of {other}" for name, other in change.follows.items())
    return [
        FlightEvent(
            id=_EXCHANGED,
            t=change.t,
            end=stop,
            severity=Severity.ERROR,
            reason=f"Motor outputs change places at {change.t:.0f} s: from then on {what}.",
            advice="No craft does this in flight: look for what changed the log, or SERVOn_FUNCTION.",
            evidence={"motors": ", ".join(change.follows), "follow": ", ".join(change.follows.values())},
        )
    ]


def _dropout_event(dropouts: MotorDropouts, one: Dropout) -> FlightEvent:
    count = len(dropouts.dropouts)
    again = f" (one of {count} times)" if count > 1 else ""
    return FlightEvent(
        id="motor-dropout",
        t=one.t,
        end=one.end,
        severity=Severity.ERROR if one.loss >= 0.5 else Severity.WARNING,
        reason=f"Motor {dropouts.motor} gave {100.0 * one.loss:.0f} ± {100.0 * one.sigma:.0f} % less thrust than asked "
        f"for {one.end - one.t:.1f} s, then recovered{again}.",
        advice=f"Look for a dry solder joint or a loose plug at motor {dropouts.motor} and its ESC; do not fly before.",
        evidence={
            "motor": dropouts.motor,
            "missing_thrust": one.loss,
            "missing_thrust_sigma": one.sigma,
            "times": count,
            "score": one.score,
        },
    )


def _motor_event(loss: MotorLoss, losses: tuple[MotorLoss, ...]) -> FlightEvent:
    others = f" (or {', '.join(map(str, loss.alternatives))})" if loss.alternatives else ""
    points = 100.0 * (1.0 - loss.output)
    gone = loss.loss > 0.9
    at_once = sorted(one.motor for one in losses if abs(one.t - loss.t) < 1.0)
    several, together = len(at_once) > 1, joined([str(motor) for motor in at_once])
    what = "lost all its thrust" if gone else f"lost {points:.0f} % of its output"
    missing = "" if gone else f": {100.0 * loss.loss:.0f} ± {100.0 * loss.sigma:.1f} % of its thrust is missing"
    return FlightEvent(
        id="motor-loss",
        t=loss.t,
        end=loss.end,
        severity=Severity.ERROR,
        reason=f"Motors {together} are out of balance at once from {loss.t:.1f} s on: as if motor {loss.motor} {what}"
        f"{missing.replace(':', ',')}."
        if several
        else f"Motor {loss.motor}{others} {what} from {loss.t:.1f} s on{missing}.",
        advice="Motors do not fail together: look for a blow, for what moved, such as an arm or battery, and at wires."
        if several
        else f"Inspect motor {loss.motor}, its propeller, ESC, plugs and solder joints.",
        evidence={
            "motor": loss.motor,
            "thrust_loss": loss.loss,
            "thrust_loss_sigma": loss.sigma,
            "output_loss": 1.0 - loss.output,
            "score": loss.score,
        }
        | ({"at_once": together} if several else {}),
    )


def _ending(flight: Span, events: list[FlightEvent]) -> FlightEvent | None:
    """Return the first event of a flight after which the craft is no longer the same."""
    inside = [event for event in events if event.id in _ENDING and flight.start <= event.t <= flight.stop + 2.0]
    return inside[0] if inside else None


def _begin(cause: FlightEvent, events: list[FlightEvent]) -> float:
    """Return when what led to an event began, s: a crash begins with the loss of control before it."""
    begin = cause.t
    for event in events:
        if event.id == "loss-of-control" and event.t < cause.t <= event.end + _LED_TO:
            begin = min(begin, event.t)
    return begin - _MARGIN
