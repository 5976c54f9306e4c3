"""Findings of one log in few lines: what the log and the trajectory both miss, and what happened again and again."""

from collections.abc import Sequence
from dataclasses import replace

from logparse import Finding

#: What trajectory and records say is missing, by what was said of the same sensor before.
_SAID_BEFORE = {
    "no-gps": frozenset(("no-gps", "gps-no-fix")),
    "no-magnetometer": frozenset(("no-mag",)),
    "no-baro": frozenset(("no-baro",)),
    "position-unknown": frozenset(("no-gps", "gps-no-fix", "position-unknown")),
}


def without_repetition(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """Return the findings with each missing sensor once, and happenings of one kind (``start`` in evidence) as one.

    The first happening of a kind keeps its words and evidence and gains how many there were and until when:
    ``count``, ``last_start`` and, where the last one has it, ``last_stop``. Order is kept.
    """
    told: dict[str, int] = {}
    kept: list[Finding] = []
    series: dict[int, list[Finding]] = {}
    for finding in findings:
        if any(earlier in told for earlier in _SAID_BEFORE.get(finding.id, ())):
            continue
        if finding in kept:
            continue
        if finding.id in told and "start" in finding.evidence and "start" in kept[told[finding.id]].evidence:
            series.setdefault(told[finding.id], []).append(finding)
            continue
        told.setdefault(finding.id, len(kept))
        kept.append(finding)
    for place, others in series.items():
        kept[place] = _together(kept[place], others)
    return tuple(kept)


def _together(first: Finding, others: Sequence[Finding]) -> Finding:
    last = max(others, key=lambda finding: float(finding.evidence["start"] or 0.0))
    evidence = {**first.evidence, "count": 1 + len(others), "last_start": last.evidence["start"]}
    if "stop" in last.evidence:
        evidence["last_stop"] = last.evidence["stop"]
    more = f"{len(others)} more such, the last from" if len(others) > 1 else "Another such from"
    when = f"{more} t = {float(last.evidence['start'] or 0.0):.1f} s"
    if "stop" in last.evidence:
        when += f" to {float(last.evidence['stop'] or 0.0):.1f} s"
    return replace(first, reason=f"{first.reason.rstrip('.')}. {when}.", evidence=evidence)
