"""The report of a folder of logs, composed from those of its flights and crafts: what its report.json holds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from core.findings import WORST_FIRST
from logparse import Finding
from pipeline.results.report import CommonFinding


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
