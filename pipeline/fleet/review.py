"""A craft after each flight: what its flights say together by sums over what each says alone, and what is alarming.

Nothing is fitted to records here: a flight enters by its own parameters with their standard errors, so that a craft of
hundreds of flights is looked at anew in a second. Notes of the owner part the flights where they say so.

An alert may be raised after any flight, and a craft is looked at after every one: with n flights the chance of a false
alarm that is spent is `RATE` / ((n - 3)(n - 2)), which over all n from 4 on adds up to `RATE` (the union bound,
whatever the looks have in common). A third of it goes to slopes and steps, a third to the motors' trims together, a
third to the newest flight against those before.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from itertools import pairwise

from core.quantity import uncertain
from core.summary import listed
from logparse import Severity
from pipeline.fleet.drift import STEADY, follow
from pipeline.fleet.history import FEWEST, fit_change
from pipeline.fleet.meta_analysis import corrected, difference, holm
from pipeline.flight.craft import by_craft, in_order, once, took_off
from pipeline.results.drift import Alert, CraftNote, CraftReview, Drift, History, ParameterChange
from pipeline.results.fleet import FlightEntry
from sysid.autopilot.values import over_flights

#: Chance of any false alarm over the whole life of a craft, however many flights that is.
RATE = 0.01

#: A clock that says less was never set: the first autopilots of this family are younger.
_FIRST = datetime(2009, 1, 1, tzinfo=UTC)


def review(entries: Sequence[FlightEntry], notes: Sequence[CraftNote] = (), now: datetime | None = None) -> CraftReview:
    """Review the flights of a craft together."""
    clean = [_unset(entry, now or datetime.now(UTC)) for entry in entries]
    recorded = once(clean)
    flights, remarks = _dated(recorded)
    remarks += _remarks_on(
        flights, {entry.name for entry in clean if entry.start_utc is None}, len(clean) - len(recorded)
    )
    boundary, pooled, before = _parted(flights, notes)
    built = [flight for flight in pooled if flight.build == pooled[-1].build]
    if len(built) < len(pooled):
        remarks.append(
            f"{len(pooled) - len(built)} of the flights were flown with another build or scaling of commands than the "
            f"newest, {pooled[-1].name}, and are not pooled with it"
        )
    drift = follow(built)
    return CraftReview(
        flights=tuple(flight.name for flight in flights),
        pooled=tuple(flight.name for flight in built),
        boundary=boundary,
        drift=drift,
        whole=follow(flights) if len(built) < len(flights) else None,
        since=_since(before, built) if boundary is not None else (),
        alerts=tuple(_alerts(drift)),
        autopilot=over_flights([(flight.name, flight.autopilot) for flight in built]),
        joint=_joint(built),
        remarks=tuple(remarks),
    )


def _joint(flights: Sequence[FlightEntry]) -> tuple[str, ...]:
    """List the flights that a joint fit would use, by the rules of a folder of logs; their craft is settled."""
    crafts = by_craft([replace(flight, craft="") for flight in flights])
    return tuple(flight.name for flight in crafts[0]) if crafts and len(crafts[0]) > 1 else ()


def _unset(entry: FlightEntry, now: datetime) -> FlightEntry:
    """Return a flight without its date where that cannot be: the clock was never set."""
    if entry.start_utc is None or _FIRST < entry.start_utc <= now:
        return entry
    return replace(entry, start_utc=None)


def _dated(entries: Sequence[FlightEntry]) -> tuple[list[FlightEntry], list[str]]:
    """Sort flights by date, those without one after the entry before; by name if none has a date."""
    known = [start for entry in entries if (start := took_off(entry)) is not None]
    undated = [entry.name for entry in entries if entry.start_utc is None]
    if not undated or not known:
        return in_order(entries), []
    placed = []
    last = min(known) - timedelta(days=1)
    for entry in entries:
        start = took_off(entry)
        if start is None:
            start = last + timedelta(seconds=1)
            entry = replace(entry, start_utc=start - timedelta(seconds=entry.flight.start if entry.flight else 0.0))
        last = start if entry.name in undated else max(last, start)
        placed.append(entry)
    return in_order(placed), [
        f"the clock of {listed(undated, 4)} was not set: placed in the order in which the logs came"
    ]


def _remarks_on(flights: Sequence[FlightEntry], undated: Collection[str], copies: int) -> list[str]:
    """Report further recordings of a flight, and flights at the same time: then two craft have one board's id."""
    remarks = []
    if copies:
        are = "is a further recording" if copies == 1 else "are further recordings"
        remarks.append(f"{copies} of the logs {are} of flights that are here")
    dated = [(flight, start) for flight in flights if flight.name not in undated and (start := took_off(flight))]
    for (a, start), (b, other) in pairwise(dated):
        length = 0.0 if a.flight is None else a.flight.stop - a.flight.start
        if (other - start).total_seconds() < 0.5 * length:
            remarks.append(
                f"{a.name} and {b.name} were in the air at the same time: two craft pass for one here, by a board that "
                "was moved or copied settings; move the flights of one of them to a craft of its own"
            )
            break
    return remarks


def _parted(
    flights: Sequence[FlightEntry], notes: Sequence[CraftNote]
) -> tuple[CraftNote | None, list[FlightEntry], list[FlightEntry]]:
    """Part flights at the last boundary with flights after it; those between it and the one before come second."""
    bounds = sorted((note for note in notes if note.boundary), key=lambda note: note.at)
    parts: list[tuple[CraftNote | None, list[FlightEntry]]] = [(None, [])]
    for flight in flights:
        start = took_off(flight)
        while bounds and start is not None and bounds[0].at <= start:
            parts.append((bounds.pop(0), []))
        parts[-1][1].append(flight)
    parts = [part for k, part in enumerate(parts) if part[1] or k == 0]
    boundary, pooled = parts[-1]
    return boundary, pooled, parts[-2][1] if len(parts) > 1 else []


def _since(before: Sequence[FlightEntry], after: Sequence[FlightEntry]) -> tuple[ParameterChange, ...]:
    """Compare the parameters of the flights before and after a boundary."""
    compared = follow([*before, *after])
    later = {flight.name for flight in after}
    changes = []
    for history in () if compared is None else compared.parameters:
        sides = [
            [(point.value, point.sigma) for point in history.flights if (point.flight in later) is side]
            for side in (False, True)
        ]
        # Fewest flights on either side of a boundary for a difference.
        if min(map(len, sides)) >= 2 and history.method != STEADY:
            changes.append(difference(history.parameter, history.method, history.unit, *sides))
    return corrected(changes)


def _alerts(drift: Drift | None) -> list[Alert]:
    """List what left its band, as far as the chance of a false alarm allows."""
    if drift is None or len(drift.flights) < FEWEST:
        return []
    count = len(drift.flights)
    allowed = RATE / 3.0 / ((count - 3) * (count - 2))
    return [*_lasting(drift, allowed), *_newest(drift, allowed)]


def _lasting(drift: Drift, allowed: float) -> list[Alert]:
    """List slopes and steps; of trims the motor that explains them."""
    alerts = []
    first, newest = drift.flights[0], drift.flights[-1]
    motors = drift.motors
    shifted = [
        history.change for history in drift.parameters if history.method == STEADY and history.change is not None
    ]
    if motors is not None and (
        any(change.p_adjusted < allowed for change in shifted) or (motors.p is not None and motors.p < allowed)
    ):
        for finding in motors.findings[:1]:
            about = f"{finding.id}|{motors.weakening or 'trims'}|{first}"
            alerts.append(_alert(about, finding.id, finding.reason, newest))
    for history in drift.parameters:
        change = history.change
        if change is None or change.p_adjusted >= allowed or history.method == STEADY:
            continue
        alerts.append(_alert(f"changed|{history.parameter}|{first}", "parameter-changed", history.sentence, newest))
    return list({alert.about: alert for alert in alerts}.values())


def _newest(drift: Drift, allowed: float) -> list[Alert]:
    """Judge the newest flight against the mean and scatter of those before it."""
    newest = drift.flights[-1]
    asked: list[tuple[History, float, float]] = []
    for history in drift.parameters:
        if history.method == STEADY or history.flights[-1].flight != newest or len(history.flights) < FEWEST:
            continue
        difference, _, p = fit_change(history.flights, history.flights[-1].number).test([0.0, 1.0])
        asked.append((history, difference, p))
    adjusted = holm([p for *_, p in asked])
    alerts = []
    for (history, difference, _), p in zip(asked, adjusted, strict=True):
        if p >= allowed:
            continue
        point, unit = history.flights[-1], history.unit.partition(",")[0]
        # The standard deviation of one more flight's value, its own error with it.
        expected = uncertain(point.value - difference, math.hypot(history.between, point.sigma))
        text = (
            f"{newest} leaves the band of {history.parameter}: "
            f"{f'{uncertain(point.value, point.sigma)} {unit}'.rstrip()} "
            f"where the {len(history.flights) - 1} flights before it lead one to expect {expected} {unit}".rstrip()
        )
        alerts.append(_alert(f"outside|{history.parameter}|{newest}", "parameter-outside", text, newest))
    return alerts


def _alert(about: str, identifier: str, text: str, flight: str) -> Alert:
    return Alert(about=about, id=identifier, severity=Severity.WARNING, text=text, flight=flight)
