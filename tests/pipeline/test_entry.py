"""Entries: what is kept of a flight where its trajectory is not."""

import dataclasses
import json
import subprocess
import sys

import numpy as np
import pytest

from core.serialization import as_json, plain, restored
from pipeline.flight.summary import TRACK_ROWS, flight_entry, partition
from pipeline.results.entry import FlightEntry
from pipeline.results.failure import Failure
from tests.reports.conftest import made_flight

FLIGHT = made_flight("day 1/flight01", fit=False)


def test_a_flight_survives_json():
    entry = flight_entry(FLIGHT, folder="day_1_flight01", source="s3://logs/flight01.BIN", key="k")
    assert restored(json.loads(json.dumps(plain(entry), allow_nan=False)), FlightEntry) == entry
    assert entry.start_utc == FLIGHT.log.start_utc
    assert entry.flight == FLIGHT.flight
    assert entry.experiments == ("motors",)
    assert "voltage" in entry.missing["thrust"]
    assert "not asked for" in entry.missing["motors"]


#: Eight threads that read the same entry before anybody read one.
TOGETHER = """
import json, sys, threading
from core.serialization import restored
from pipeline.results.entry import FlightEntry
content, gate = json.load(sys.stdin), threading.Barrier(8)
sys.setswitchinterval(1e-6)
def read():
    gate.wait()
    restored(content, FlightEntry)
threads = [threading.Thread(target=read) for _ in range(8)]
for thread in threads: thread.start()
for thread in threads: thread.join()
"""


def test_the_first_entries_may_be_read_by_several_threads_at_once():
    """Half of all second runs over a folder ended by a segmentation fault."""
    entry = as_json(flight_entry(FLIGHT, folder="a", source="a.bin", key="k"))
    for _ in range(6):
        run = subprocess.run([sys.executable, "-c", TOGETHER], input=entry, text=True, check=False)
        assert run.returncode == 0


def test_an_entry_of_another_version_is_refused_and_not_half_read():
    facts = plain(flight_entry(FLIGHT, folder="a", source="a.bin", key="k"))
    for old in (facts | {"coverage": {}}, facts | {"flight": [1.0, 2.0]}, {"key": "k"}, [], "x"):
        with pytest.raises(ValueError, match=r"\$|Expected|Object"):
            restored(old, FlightEntry)


def test_a_log_without_a_flight_survives_json():
    grounded = Failure("flight", "the log shows no flight")
    bare = dataclasses.replace(FLIGHT, flight=grounded, trajectory=grounded, experiments={}, models=())
    entry = flight_entry(bare, folder="a", source="a.bin", key="k")
    assert restored(json.loads(json.dumps(plain(entry), allow_nan=False)), FlightEntry) == entry
    assert entry.track == ()
    assert not entry.position_known


def test_the_track_follows_the_trajectory():
    entry = flight_entry(FLIGHT, folder="a", source="a.bin", key="k")
    track = np.array(entry.track)
    assert TRACK_ROWS / 2 <= len(track) <= TRACK_ROWS
    states = FLIGHT.trajectory.states
    for column, name in enumerate(("p_n", "p_e", "p_d"), start=1):
        flown = np.interp(track[:, 0], states.index, states[name])
        assert np.abs(track[:, column] - flown).max() < 0.051, "rounded to a decimetre"


def test_partitions_tell_crafts_apart_and_suit_folders():
    names = {partition("a|b|1", "Octa Quad/X"), partition("a|b|2", "Octa Quad/X"), partition("a", None)}
    assert len(names) == 3
    assert all(name.replace("-", "").isalnum() for name in names)
