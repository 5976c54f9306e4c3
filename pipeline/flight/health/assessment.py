"""From a log to the timeline of its events, and to the part of a flight that can serve models."""

from __future__ import annotations

import numpy as np

from core.parameter import Parameter
from logparse import Finding, FlightEvent, FlightLog, MissingDataError, Severity, flight_events
from pipeline.flight.health.signals import health_signals
from pipeline.results.health import FlightHealth
from pipeline.results.span import Span, around
from sysid.rotors.battery import sag_resistance
from sysid.rotors.motor_faults import MotorFault, find_motor_faults

#: Events after which the craft is no longer the one to model.
_ENDING = ("crash", "disarmed-in-air", "motor-loss")
#: Time before such an event that is left out with it, s: a change is timed to a few tenths of a second.
_MARGIN = 0.3
#: Time between the end of a loss of control and the crash that it led to, s.
_LED_TO = 2.0


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
            lost = [each.t for each in events if each.id in ("crash", "disarmed-in-air") and each.t > flight.start]
            stop = min([*lost, flight.stop])
            faults = find_motor_faults(log.tables, log.vehicle, flight.start, stop)
            events += [_motor_event(fault, faults) for fault in faults]
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


def _motor_event(fault: MotorFault, faults: tuple[MotorFault, ...]) -> FlightEvent:
    others = f" (or {', '.join(map(str, fault.alternatives))})" if fault.alternatives else ""
    thrust = f"{100.0 * fault.loss:.0f} ± {max(100.0 * fault.sigma, 1.0):.0f} % of its thrust"
    evidence = {"motor": fault.motor, "score": fault.score}
    if fault.kind == "pulse":
        count = sum(each.kind == "pulse" and each.motor == fault.motor for each in faults)
        return FlightEvent(
            id="motor-dropout",
            t=fault.t,
            end=fault.end,
            severity=Severity.ERROR if fault.loss >= 0.5 else Severity.WARNING,
            reason=f"Motor {fault.motor} lacked {thrust} for {fault.end - fault.t:.1f} s, then recovered"
            f"{f' (one of {count} times)' if count > 1 else ''}: {fault.evidence}.",
            advice=f"Look for a dry solder joint or a loose plug at motor {fault.motor} or its ESC; do not fly before.",
            evidence=evidence | {"missing_thrust": fault.loss, "missing_thrust_sigma": fault.sigma, "times": count},
        )
    if fault.loss > 0.95:
        what = "lost all its thrust"
    elif fault.kind == "step":
        what = f"lost {100.0 * (1.0 - fault.output):.0f} % of its output, {thrust},"
    else:
        what = f"lacked {thrust}"
    return FlightEvent(
        id="motor-loss",
        t=fault.t,
        end=fault.end,
        severity=Severity.ERROR,
        reason=f"Motor {fault.motor}{others} {what} from {fault.t:.1f} s on: {fault.evidence}.",
        advice=f"Inspect motor {fault.motor}, its propeller, ESC, plugs and solder joints.",
        evidence=evidence
        | {"thrust_loss": fault.loss, "thrust_loss_sigma": fault.sigma, "output_loss": 1.0 - fault.output},
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
