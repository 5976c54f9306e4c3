"""The report of a folder of logs, composed from those of its flights and crafts: what its report.json holds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from core.findings import WORST_FIRST
from core.serialization import lessened
from logparse import Finding
from pipeline.results.report import CommonFinding, FlightInShort, FlightReport

#: Lines of an answer that tables over all flights show.
_TABULATED = ("Happened", "Loops", "Parameters", "Predict ahead")


def in_short(flight: FlightReport, folder: str) -> FlightInShort:
    """Keep of a flight's report what tables over all flights show; its folder, such as ``flights/a``, has the rest."""
    vehicle = replace(flight.vehicle, motors=())
    happened = "" if flight.account is None else flight.account.in_short
    answer = flight.answer
    if answer is not None:
        answer = replace(answer, lines=tuple(each for each in answer.lines if each.purpose in _TABULATED))
    short = lessened(replace(flight, vehicle=vehicle), FlightInShort)
    return replace(short, folder=folder, motor_count=len(flight.vehicle.motors), happened=happened, answer=answer)


def common_findings(flights: Mapping[str, Sequence[Finding]]) -> tuple[CommonFinding, ...]:
    """Gather the findings of all flights, by name, by what they are about, worst and most frequent first."""
    found: dict[str, CommonFinding] = {}
    for flight, findings in flights.items():
        for finding in findings:
            key = f"{finding.severity} {finding.id}"
            entry = found.setdefault(
                key,
                CommonFinding(
                    id=finding.id,
                    severity=finding.severity,
                    reason=finding.reason,
                    advice=finding.advice,
                    example=flight,
                    flights=(),
                ),
            )
            found[key] = replace(entry, flights=tuple(dict.fromkeys((*entry.flights, flight))))
    return tuple(sorted(found.values(), key=lambda each: (WORST_FIRST.index(each.severity), -len(each.flights))))
