"""What the autopilot itself reported: arming, modes, failsafes, errors, and the estimator's lane switches."""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from core.findings import Severity
from logparse.events.event import FlightEvent
from logparse.flights import Flight
from logparse.tables import Tables

#: Names of events of the timeline by the autopilot's name (EV.Id), with their sentence.
_EVENTS = {
    "ARMED": ("motors-armed", "The motors were armed."),
    "DISARMED": ("motors-disarmed", "The motors were disarmed."),
    "TAKEOFF": ("take-off", "The autopilot took off."),
    "NOT_LANDED": ("take-off", "The autopilot noticed the take-off."),
    "LAND_COMPLETE": ("landing-noticed", "The autopilot noticed the landing."),
}

#: Events that warn of something.
_ALARMS = {
    "LOST_GPS": "The autopilot lost GPS.",
    "PARACHUTE_RELEASED": "The parachute was released.",
    "MOTORS_EMERGENCY_STOPPED": "The motors were stopped by the emergency switch.",
    "AUTOTUNE_FAILED": "AutoTune failed.",
}

#: Two reports of the same thing within this time are one, s.
_SAME = 1.0

#: What to do about an error of a subsystem (ERR.Subsys of ArduCopter).
_ADVICE = {
    "FAILSAFE_RADIO": "Check the receiver, its antennas and the range.",
    "FAILSAFE_BATTERY": "Land earlier, or replace an aged battery.",
    "FAILSAFE_GCS": "Check the telemetry link and FS_GCS_ENABLE.",
    "CRASH_CHECK": "The autopilot took this for a crash: inspect the craft before the next flight.",
    "THRUST_LOSS_CHECK": "Full throttle and still sinking: look for a failed motor or propeller, or too much weight.",
    "EKF_CHECK": "The position estimate was not trusted: look at vibration, compass and GPS around this time.",
    "EKF_PRIMARY": "The estimator changed its lane: look at GPS, compass and vibration around this time.",
    "FAILSAFE_VIBE": "Vibration spoilt the height estimate: balance propellers, soften the mount.",
    "GPS": "Look at satellites and interference around this time.",
    "COMPASS": "Look at interference of motors and wiring with the compass.",
}

_SOURCE = "ArduPilot, ERR and EV messages"


def reported_events(tables: Tables, flights: tuple[Flight, ...]) -> Iterator[FlightEvent]:
    """Yield the autopilot's own reports; errors on the ground are only noted.

    Parameters
    ----------
    tables : Tables
    flights : tuple of Flight
        Airborne intervals.
    """
    if tables.modes is not None:
        yield from _modes(tables.modes)
    if tables.events is None:
        return
    last: dict[str, float] = {}
    for t, name, detail in zip(
        tables.events.index.to_numpy(np.float64), tables.events["event"], tables.events["detail"], strict=True
    ):
        event = _event(float(t), str(name), str(detail), airborne(float(t), flights))
        if event is None:
            continue
        key = f"{event.id} {event.evidence.get('subsystem', '')}{event.evidence.get('code', '')}"
        if float(t) - last.get(key, -np.inf) >= _SAME:
            yield event
        last[key] = float(t)


def airborne(t: float, flights: tuple[Flight, ...], margin: float = 0.5) -> bool:
    """Return whether a time lies in a flight, or within `margin` seconds of it.

    Parameters
    ----------
    t : float
        s.
    flights : tuple of Flight
        When the craft was in the air.
    margin : float
        s.
    """
    return any(flight.start - margin <= t <= flight.stop + margin for flight in flights)


def _modes(modes: pd.DataFrame) -> Iterator[FlightEvent]:
    for t, mode in zip(modes.index.to_numpy(np.float64), modes["mode"], strict=True):
        yield FlightEvent(
            id="mode-change",
            t=float(t),
            end=float(t),
            severity=Severity.INFO,
            reason=f"Flight mode {mode}.",
            evidence={"mode": str(mode)},
        )


def _event(t: float, name: str, detail: str, flying: bool) -> FlightEvent | None:
    if name == "MESSAGE":
        # Loggers that start while arming miss the event, not its text.
        if detail.startswith("Arming motors"):
            name = "ARMED"
        elif detail.startswith("Disarming motors"):
            name = "DISARMED"
        else:
            return None
    if name == "ERROR":
        return _error(t, detail, flying)
    if name in _ALARMS:
        severity = Severity.WARNING if flying else Severity.INFO
        return FlightEvent(
            id="autopilot-alarm", t=t, end=t, severity=severity, reason=_ALARMS[name], evidence={"event": name}
        )
    if name in _EVENTS:
        identity, reason = _EVENTS[name]
        return FlightEvent(id=identity, t=t, end=t, severity=Severity.INFO, reason=reason, evidence={"event": name})
    return None


def _error(t: float, detail: str, flying: bool) -> FlightEvent | None:
    subsystem, _, code = detail.rpartition(" ")
    switch = subsystem == "EKF_PRIMARY"
    if code == "0" and not switch:
        return None  # ERR with code 0 says that an earlier error is over.
    failsafe = subsystem.startswith("FAILSAFE")
    severity = Severity.INFO
    if flying:
        severity = Severity.ERROR if subsystem == "CRASH_CHECK" else Severity.WARNING
    if switch:
        identity, reason = "estimator-lane-switch", f"The estimator switched to lane {code}."
    elif failsafe:
        kind = subsystem.removeprefix("FAILSAFE_").lower()
        identity, reason = "failsafe-triggered", f"Failsafe: {kind} (code {code})."
    else:
        identity, reason = "autopilot-error", f"The autopilot reported an error: {subsystem} (code {code})."
    return FlightEvent(
        id=identity,
        t=t,
        end=t,
        severity=severity,
        reason=reason,
        advice=_ADVICE.get(subsystem, ""),
        evidence={"subsystem": subsystem, "code": code},
        source=_SOURCE,
    )
