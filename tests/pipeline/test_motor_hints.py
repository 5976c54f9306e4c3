"""What a flight hints of a motor must hold in the other flights of its craft, on its page too."""

from dataclasses import replace

from logparse import Finding, Severity
from pipeline.fleet.motor_hints import settle_hints
from pipeline.results.entry import FlightEntry
from pipeline.storage.kept import read_result, write_result
from pipeline.storage.store import FolderStore
from sysid.rotors.motor_faults.trims import weak_from_start
from tests.pipeline.builders import flown
from tests.reports.conftest import made_flight
from tests.sysid.trimmed_flights import REAL, trimmed

OTHER = Finding("uneven-motor", Severity.WARNING, "an output is not what the mixer asks", "", {"motor": "m1"})


def test_a_hint_that_sisters_contradict_leaves_entry_result_and_page(tmp_path):
    store, trims = FolderStore(tmp_path), trimmed(*REAL)
    hint = weak_from_start(trims[2])
    flights = [replace(flown(f"f{k}"), trims=each) for k, each in enumerate(trims)]
    flights[2] = replace(flights[2], findings=(OTHER, *hint))
    place = tmp_path / "flights" / "f2"
    place.mkdir(parents=True)
    write_result(replace(made_flight("f2", seed=1), findings=(*hint, OTHER)), place)
    shown = []
    settled = settle_hints(flights, store, lambda result, folder: shown.append(result.findings))
    assert settled[:2] == tuple(flights[:2])
    assert settled[2].findings == (OTHER,)
    assert shown == [(OTHER,)]
    assert read_result(store, "flights/f2").findings == (OTHER,)
    assert store.read_as("flights/f2/entry.json", FlightEntry) == settled[2]
    # Of another craft, or alone, it stands.
    assert settle_hints([replace(flights[0], craft="another"), flights[2]], store, None)[1] == flights[2]
