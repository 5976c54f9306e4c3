"""Withdraw hints of weak motors that other flights of the craft do not bear out: a motor that is weak stays weak."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from core.serialization import plain
from logparse import Finding
from pipeline.fleet.job import show_anew
from pipeline.flight.advice.next_flights import for_flight
from pipeline.results.entry import FlightEntry
from pipeline.results.fleet import Publish
from pipeline.results.flight import FlightResult
from pipeline.storage.kept import read_result
from pipeline.storage.manifest import FLIGHTS
from pipeline.storage.store import ENTRY, Store
from sysid.rotors.motor_faults.trims import weak_from_start


def settle_hints(flights: Sequence[FlightEntry], store: Store, publish: Publish | None) -> tuple[FlightEntry, ...]:
    """Return the flights with what their craft's flights together say of weak motors; pages follow.

    Parameters
    ----------
    flights : sequence of FlightEntry
        Whose products are in the store.
    store : Store
    publish : callable or None
        As `pipeline.analyze_fleet` takes it.
    """
    settled = []
    for entry in flights:
        others = [each.trims for each in flights if each is not entry and each.craft == entry.craft and each.trims]
        told = [finding for finding in entry.findings if _is_hint(finding)]
        hints = () if entry.trims is None else weak_from_start(entry.trims, others)
        if told and list(hints) != told:
            kept = (finding for finding in entry.findings if not _is_hint(finding))
            settled.append(_rewritten(replace(entry, findings=(*kept, *hints)), hints, store, publish))
        else:
            settled.append(entry)
    return tuple(settled)


def _is_hint(finding: Finding) -> bool:
    """Return whether a finding is one of `weak_from_start`; others of its name compare outputs, not trims."""
    return finding.id == "uneven-motor" and "loss" in finding.evidence


def _rewritten(entry: FlightEntry, hints: Sequence[Finding], store: Store, publish: Publish | None) -> FlightEntry:
    result = None if publish is None else read_result(store, f"{FLIGHTS}/{entry.folder}")
    if publish is None or not isinstance(result, FlightResult):
        store.write_json(f"{FLIGHTS}/{entry.folder}/{ENTRY}", plain(entry))
        return entry
    result = replace(result, findings=(*(each for each in result.findings if not _is_hint(each)), *hints))
    show_anew(replace(result, advice=for_flight(result)), entry, store, publish)
    return entry
