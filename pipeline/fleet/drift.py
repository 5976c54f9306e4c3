"""Physical parameters followed over the flights of a craft: whether they scatter, drift or jump, or a motor weakens.

Every flight's own estimate and standard error enter a random-effects meta-regression (`pipeline.fleet.meta_analysis`).
For each parameter two questions are asked: does it change steadily from flight to flight (a slope), and did it change
once (a step between two flights, its place searched for and paid for by Bonferroni's factor)? All questions about one
craft together are corrected by Holm's procedure, so that the chance of any false alarm stays below `ALPHA`.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from logparse import Finding, Severity
from pipeline.fleet.history import ALPHA, history, sentence_of
from pipeline.fleet.meta_analysis import holm
from pipeline.fleet.motor_drift import STEADY, Together, motor_drift, together, trims
from pipeline.flight.craft import in_order, took_off
from pipeline.flight.flight_parameters import BATTERY
from pipeline.results.drift import Drift, FlightPoint, History
from sysid.rotors.motor_faults.trims import weak_from_start

if TYPE_CHECKING:
    from pipeline.results.entry import FlightEntry, FlightParameter

#: What may have changed when a parameter did.
_CAUSES: Mapping[str, str] = {
    "thrust over mass": "weigh the craft, and compare propellers and motors with those of the earlier flights",
    "thrust curve": "check whether propellers or ESC settings were changed",
    "motor lag": "check ESC settings and propellers",
    "roll inertia over mass and arm": "check what was mounted or moved on the craft",
    "pitch inertia over mass and arm": "check what was mounted or moved on the craft",
    "yaw torque over inertia": "check propellers and what was mounted on the craft",
    "linear drag over mass": "check propellers and what was mounted outside",
    "quadratic drag over mass": "check what was mounted outside",
}


def follow(entries: Iterable[FlightEntry]) -> Drift | None:
    """Follow the parameters of one craft over its flights; None with fewer than two flights that say anything."""
    flights = in_order(entries)
    number = {flight.name: k for k, flight in enumerate(flights, start=1)}
    series: dict[str, dict[str, list[FlightPoint]]] = defaultdict(lambda: defaultdict(list))
    units: dict[str, str] = {}
    for flight in flights:
        rows = [row for row in flight.parameters if row.method != BATTERY]
        for row in (*rows, *trims(flight)):
            series[row.parameter][row.method].append(_point(flight, number[flight.name], row))
            units[row.parameter] = row.unit
    histories = [
        history(parameter, units[parameter], methods)
        for parameter, methods in series.items()
        if max(map(len, methods.values())) >= 2
    ]
    if not histories:
        return None
    histories, joint = _judged(histories, together(flights, histories))
    motors = motor_drift(flights, histories, joint)
    told = [flight.trims for flight in flights if flight.trims is not None]
    # Flights whose responses are laid over each other: of more, none can be told apart.
    return Drift(
        order="name" if any(flight.start_utc is None for flight in flights) else "date",
        flights=tuple(flight.name for flight in flights),
        parameters=tuple(histories),
        motors=motors,
        findings=(
            *_findings(histories),
            *(motors.findings if motors is not None else ()),
            *(weak_from_start(told[-1], told[:-1]) if told else ()),
        ),
        responses=tuple(curve for flight in flights[-8:] for curve in flight.responses),
    )


def _point(flight: FlightEntry, number: int, row: FlightParameter) -> FlightPoint:
    start = took_off(flight)
    return FlightPoint(
        flight=flight.name,
        number=number,
        start_utc=None if start is None else start.isoformat(),
        value=row.value,
        sigma=row.sigma,
    )


def _judged(histories: Sequence[History], joint: Together | None) -> tuple[list[History], Together | None]:
    """Correct all probabilities together and say what came of it."""
    asked = [(k, name) for k, each in enumerate(histories) for name in ("trend", "step") if getattr(each, name)]
    chances = [getattr(histories[k], name).p for k, name in asked]
    *adjusted, of_motors = holm([*chances, 1.0 if joint is None else joint.p])
    found = dict(zip(asked, adjusted, strict=True))
    judged = []
    for k, each in enumerate(histories):
        tests = {
            name: replace(getattr(each, name), p_adjusted=found[k, name], significant=found[k, name] < ALPHA)
            for name in ("trend", "step")
            if (k, name) in found
        }
        corrected = replace(each, **tests)
        judged.append(replace(corrected, sentence=sentence_of(corrected, len(asked))))
    if joint is not None:
        change = replace(joint.change, p_adjusted=of_motors, significant=of_motors < ALPHA)
        joint = replace(joint, change=change)
    return judged, joint


def _findings(histories: Sequence[History]) -> list[Finding]:
    findings = []
    for each in histories:
        change = each.change
        if change is None or each.method == STEADY:  # for `motor_drift` to put in words
            continue
        findings.append(
            Finding(
                "parameter-drift",
                Severity.WARNING,
                each.sentence,
                _CAUSES.get(each.parameter, ""),
                {"parameter": each.parameter, "p": change.p_adjusted, "flights": len(each.flights)},
            )
        )
    return findings
