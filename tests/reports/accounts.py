"""Accounts of flights for tests: what a test says of a flight, and calm for all else."""

import dataclasses

import numpy as np

from core.findings import Happening, Severity
from pipeline.flight.account.story import gravest_first, headline, tell_story, uneventful
from pipeline.flight.answer import compose_answer
from pipeline.results.account import Account, BatteryReading, GpsReading, HoverReading, MotorsReading, Reading
from pipeline.results.account import VibrationReading as Vibration
from pipeline.results.flight import FlightResult
from pipeline.results.signals import FlightSignals, Panel, SignalLine
from pipeline.results.span import Span

FLIGHT = Span(40.0, 99.9)
HEIGHT = Reading(value=14.0, unit="m", source="barometer", others={"GPS": 13.5})
SPEED = Reading(value=2.9, unit="m/s", source="GPS")
#: What a healthy craft reads.
STATE = {
    "height": HEIGHT,
    "distance": Reading(value=18.0, unit="m"),
    "ground_speed": SPEED,
    "battery": BatteryReading(start=16.8, end=16.4, lowest=15.7, cells=4),
    "vibration": Vibration(worst=6.0, p95=6.0, t=54.0, axis="X", clips=0, advised=30.0, harmful=60.0, source="VIBE"),
    "gps": GpsReading(satellites_least=14, satellites_median=16, fix_share=1.0),
    "hover": HoverReading(start=0.49, end=0.50),
    "motors": MotorsReading(mean={"1": 0.5, "2": 0.52}, hardest="2", at_limit=0.0),
}


def happening(identity: str, t: float, severity: Severity = Severity.ERROR, lasted: float = 1.0, **more) -> Happening:
    """Return a happening; `more` is its reason, advice or evidence."""
    evidence = more.pop("evidence", {})
    reason = more.pop("reason", f"The {identity} happened.")
    return Happening(identity, severity, reason, more.pop("advice", "Look at it."), evidence, t=t, end=t + lasted)


READ = ("height", "distance")


def account(*happenings: Happening, flight: Span | None = FLIGHT, **changed) -> Account:
    """Return the account of a flight in which this happened."""
    ordered = gravest_first(happenings)
    story = tell_story(ordered)
    state = {} if flight is None else STATE | changed
    sentence = (
        "The log shows no flight." if flight is None else uneventful(flight, *map(state.get, READ), SPEED, seen=True)
    )
    sentence = headline(story, flight) or sentence
    return Account(flight=flight, happenings=ordered, story=story, headline=sentence, sound=flight, **state)


LOST = happening("motor-fault", 70.0, reason="Motor 2 lost 60 ± 5 % of its thrust: all it had.", evidence={"motor": 2})
CRASH = happening("crash", 72.0, reason="The craft hit the ground at 6 m/s.")


def answered(given: FlightResult, /, *happenings: Happening, state=None, **changed) -> FlightResult:
    """Return a flight in which this happened, with other fields, and what its first screen then says."""
    flight_account = account(*happenings, **(state or {}))
    result = dataclasses.replace(given, **({"account": flight_account, "signals": signals()} | changed))
    return dataclasses.replace(result, answer=compose_answer(result))


def signals() -> FlightSignals:
    """Return lines of every kind that the first screen shows."""
    t = np.arange(40.0, 100.0, 0.1)
    asked, flown = SignalLine("asked", t, 0.1 * np.sin(t)), SignalLine("flown", t, 0.1 * np.sin(t - 0.1))

    def one(title: str, unit: str, name: str, limits=None) -> tuple[Panel, ...]:
        return (Panel(title=title, unit=unit, signals=(SignalLine(name, t, 5.0 + np.sin(t)),), limits=limits or {}),)

    return FlightSignals(
        height=one("height", "m", "barometer"),
        attitude=tuple(Panel(title=axis, unit="rad", signals=(asked, flown)) for axis in ("roll", "pitch", "yaw")),
        rates=(Panel(title="roll rate", unit="rad/s", signals=(asked, flown)),),
        vibration=one("vibration", "m/s²", "x", {"limit": 30.0}),
        battery=one("voltage", "V", "voltage"),
        gps=one("satellites", "", "satellites"),
    )
