"""The account of one flight of a log."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from math import inf, isfinite

from core.findings import Happening
from logparse import FlightLog, Tables
from logparse.heights import heights
from pipeline.flight.account import state
from pipeline.flight.account.attitude import attitude_happenings
from pipeline.flight.account.ground import begins_in_the_air, contact, ground_happenings, unseen
from pipeline.flight.account.motors import motor_happenings
from pipeline.flight.account.power import power_happenings
from pipeline.flight.account.readings import RECOVERS, Readings
from pipeline.flight.account.reports import reported_happenings
from pipeline.flight.account.sensors import sensor_happenings
from pipeline.flight.account.story import gravest_first, headline, tell_story, uneventful
from pipeline.results.account import Account, Phase, PhaseKind
from pipeline.results.span import Span, around
from sysid.rotors.motor_faults import too_slow

#: What breaks the craft, so that nothing after it serves models.
_ENDING = frozenset(("crash", "motor-fault", "disarmed-in-air"))
#: Time before such a happening that is left out with it, and before or after the end of a flight in which a loss of
#: control or lift counts as what ended it, s.
_MARGIN, _END = 0.3, 3.0
#: What makes position and speed of the receiver doubtful while it lasts, by kind or by the autopilot's subsystem
#: (26-11-2014_181, whose receiver left the ground three seconds before it jumped).
_GPS_WRONG = frozenset(("gps-lost", "gps-glitch", "GPS"))
#: What ends the time in which motors are compared: blows, and a throttle that runs away, at whose limit no motor has
#: the output that it needs (26-11-2014_181, cut at 97 s).
_UNTRIMMED = frozenset(("crash", "hard-landing", "disarmed-in-air", "throttle-runaway"))
#: What is not known where the log lacks a table.
_LACKS = {
    "baro": "no barometer: heights are of another sensor",
    "gps": "no GPS: neither speed nor distance",
    "battery": "no battery voltage",
    "motors": "no known motors: none was looked at",
    "imu": "no accelerometer: shocks are not seen",
    "setpoints": "no attitude target: whether it followed",
}


def account_of_log(log: FlightLog) -> Account:
    """Make the account of the flight that a log shows."""
    return account_of_flight(log, None if log.flight is None else Span(log.flight.start, log.flight.stop))


def account_of_flight(log: FlightLog, flight: Span | None) -> Account:
    """Make the account of one flight; of a log without one, what the autopilot reported on the ground."""
    if flight is not None:
        return account_of(Readings.of(log, flight))
    never = Span(inf, inf)
    readings = Readings(log.tables, log.messages, log.vehicle, never, around(None, ()))
    happenings = gravest_first(list(reported_happenings(readings)))
    sentence = _on_the_ground(happenings, other=log.vehicle.other_craft, height_known=any(heights(log.tables)))
    return Account(flight=None, happenings=happenings, headline=sentence, unknown=_unknown(log.tables))


def account_of(readings: Readings) -> Account:
    """Make the account of one flight of its readings."""
    flight, tables, unknown = readings.flight, readings.tables, _unknown(readings.tables)
    ordered = gravest_first(_until_crash(_happenings(readings)))
    story = tell_story(ordered)
    lost = next((finding.t for finding in story if finding.id in _ENDING or finding.id == "control-lost"), None)
    height = state.height(readings)
    doubtful = tuple(
        Span(finding.t - 1.0, finding.end + RECOVERS)
        for finding in ordered
        if _GPS_WRONG & {finding.id, finding.evidence.get("subsystem")}
    )
    distance, speed = state.distance(readings, doubtful), state.ground_speed(readings, doubtful)
    climb, sink = state.climb_and_sink(readings, flight.stop - 1.0 if lost is None else lost)
    if height is None and readings.height is not None:
        unknown = (*unknown, "the ground is not in the log: how high it flew")
    voltage = state.battery(readings)
    if voltage is None and tables.has("battery"):
        unknown = (*unknown, "the battery's voltage is not measured: it does not sag under load")
    if readings.attitude_error is None and tables.has("attitude") and tables.has("setpoints"):
        unknown = (*unknown, "attitude or its target too slow: whether it followed")
    if tables.has("motors") and tables.has("imu") and too_slow(tables, flight.start, flight.stop):
        unknown = (*unknown, "motor outputs or the IMU too slow: no motor was looked at")
    seen = tables.has("imu") or tables.has("attitude")
    begun, cuts = begins_in_the_air(readings), tuple(unseen(readings))
    sentence = headline(story, None if begun else flight) or uneventful(flight, height, distance, speed, seen=seen)
    return Account(
        flight=flight,
        phases=_phases(readings, story),
        height=height,
        distance=distance,
        doubtful=doubtful,
        ground_speed=speed,
        climb=climb,
        sink=sink,
        battery=voltage,
        vibration=state.worst_vibration(readings),
        gps=state.gps(readings),
        hover=state.hover(readings),
        motors=state.motors(readings),
        happenings=tuple(_advised_once(ordered)),
        story=tuple(replace(finding, advice="") for finding in story),
        headline=" ".join((sentence, *cuts)),
        unseen=cuts,
        unknown=unknown,
        sound=_sound(flight, ordered, story),
    )


def _unknown(tables: Tables) -> tuple[str, ...]:
    return tuple(words for name, words in _LACKS.items() if not tables.has(name))


def _happenings(readings: Readings) -> list[Happening]:
    """Return everything that happened, each kind by its own reading."""
    findings = [*attitude_happenings(readings), *power_happenings(readings)]
    stop, touch = readings.flight.stop, contact(readings)
    down = stop if touch is None else min(stop, touch.t)
    late = {finding.id for finding in findings if finding.t < down + _END and finding.end > down - _END}
    findings += ground_happenings(
        readings, touch, out_of_control=bool(late & {"control-lost", "yaw-lost"}), sank="lift-lost" in late
    )
    findings += motor_happenings(
        readings, until=min([stop, *(finding.t for finding in findings if finding.id in _UNTRIMMED)])
    )
    return [*findings, *sensor_happenings(readings), *reported_happenings(readings)]


def _advised_once(happenings: Iterable[Happening]) -> Iterator[Happening]:
    """Yield happenings, each advice only with the gravest that has it."""
    given = {""}
    for finding in happenings:
        yield replace(finding, advice="") if finding.advice in given else finding
        given.add(finding.advice)


def _until_crash(happenings: Sequence[Happening]) -> list[Happening]:
    """Leave out what only follows from a crash, after which all sensors and loops are wrong."""
    crash = min((finding.t for finding in happenings if finding.id == "crash"), default=inf)
    return [
        finding
        for finding in happenings
        if finding.t <= crash or finding.id in ("crash", "failsafe", "autopilot-error")
    ]


def _sound(flight: Span, ordered: tuple[Happening, ...], story: tuple[Happening, ...]) -> Span:
    """Return the part of the flight before the craft broke; a crash begins with the loss that its story names."""
    broke = [finding for finding in ordered if finding.id in _ENDING and finding.notable]
    if story and story[-1].id in _ENDING:
        broke += [finding for finding in story if finding.id in ("control-lost", "lift-lost", "yaw-lost")]
    stop = min([flight.stop, *(finding.t - _MARGIN for finding in broke)])
    return Span(flight.start, max(stop, flight.start))


def _phases(readings: Readings, story: tuple[Happening, ...]) -> tuple[Phase, ...]:
    """Part the log into the ground before, the flight, the fall of a craft that crashed, and the ground after."""
    flight, belongs = readings.flight, readings.belongs
    fall = next((finding.t for finding in story if finding.id in ("control-lost", "lift-lost")), None)
    crashed = any(finding.id == "crash" for finding in story)
    down = fall if crashed and fall is not None and flight.start < fall < flight.stop else flight.stop
    phases = [
        Phase(PhaseKind.GROUND, _logged(belongs.start), flight.start),
        Phase(PhaseKind.FLIGHT, flight.start, down),
    ]
    if down < flight.stop:
        phases.append(Phase(PhaseKind.FALL, down, flight.stop))
    return (*phases, Phase(PhaseKind.GROUND, flight.stop, _logged(belongs.stop)))


def _logged(t: float) -> float | None:
    """Return a time; None for the open beginning or end of the log."""
    return t if isfinite(t) else None


def _on_the_ground(happenings: tuple[Happening, ...], *, other: bool, height_known: bool) -> str:
    """Write the headline of a log without a flight, with what the autopilot reported last."""
    shown = (
        "The craft is no multirotor: its flights are not told"
        if other
        else f"The log shows {'no flight' if height_known else 'no height: whether the craft flew is not known'}"
    )
    last = max(happenings, key=lambda finding: finding.t, default=None)
    report = "" if last is None else f" {last.reason.rstrip('.')} ({last.t:.1f} s)."
    return f"{shown}.{report}"
