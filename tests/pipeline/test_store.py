"""Products and entries are whole or not there, whatever happens while they are written."""

import dataclasses
import errno
import json
import os
import subprocess
import sys

import fsspec
import numpy as np
import pytest

from core.serialization import as_json, plain, restored
from pipeline.flight.summary import TRACK_ROWS, flight_entry, partition
from pipeline.results.failure import Failure
from pipeline.results.fleet import FlightEntry
from pipeline.storage.store import ENTRY, SCRATCH, ObjectStore, Store, TemporaryStore, open_store
from tests.reports.conftest import made_flight


@pytest.fixture(params=["folder", "objects"])
def store(request, tmp_path):
    if request.param == "folder":
        yield open_store(tmp_path / "out")
    else:
        url = f"memory://{tmp_path.name}/out"
        yield open_store(url)
        fsspec.filesystem("memory").rm("/", recursive=True)


def commit(store, path, **files):
    with store.scratch() as scratch:
        product = scratch / "product"
        (product / "figures").mkdir(parents=True)
        for name, text in files.items():
            (product / f"{name}.json").write_text(text)
        (product / "figures" / "a.json").write_text("[]")
        store.commit(product, path)


def test_a_folder_is_kept_whole_and_replaced_whole(store):
    store.prepare()
    commit(store, "flights/a", entry="{}", old="1")
    assert store.names("flights/a") == ["entry.json", "figures", "old.json"]
    commit(store, "flights/a", entry='{"key": 2}', new="2")
    assert store.names("flights/a") == ["entry.json", "figures", "new.json"]
    assert store.read_json("flights/a/entry.json") == {"key": 2}
    assert store.names("flights") == ["a"]
    store.remove("flights/a")
    store.remove("flights/a")
    assert store.names("flights") == []
    with pytest.raises(FileNotFoundError):
        store.read("flights/a/entry.json")


def test_a_folder_moves_with_all_that_is_in_it(store):
    store.write("tables/gps/flight=a/part.parquet", b"a")
    store.write("tables/gps/flight=b/part.parquet", b"b")
    store.move("tables/gps/flight=a", "removed/tables/gps/flight=a")
    assert store.names("tables/gps") == ["flight=b"]
    assert store.read("removed/tables/gps/flight=a/part.parquet") == b"a"


def test_files_are_replaced_and_broken_json_counts_as_none(store):
    store.write_json("manifest.json", {"name": "Ø\udcff".encode("utf-8", "replace").decode()})
    store.write_json("manifest.json", [1])
    assert open_store(store.url).read_json("manifest.json") == [1]
    store.write("manifest.json", b'{"half": ')
    assert store.read_json("manifest.json") is None
    assert store.read_json("nothing.json") is None
    assert store.read_json("manifest.json/below.json") is None


def test_an_entry_goes_first_and_comes_last_among_objects(monkeypatch):
    store = ObjectStore("memory://ordered/out")
    commit(store, "flights/a", entry="{}", report="1")
    put = ObjectStore.put

    def full(self, file, path):
        if path.endswith("report.json"):
            raise OSError(errno.ENOSPC, "No space left on device")
        put(self, file, path)

    monkeypatch.setattr(ObjectStore, "put", full)
    with pytest.raises(OSError, match="No space"):
        commit(store, "flights/a", entry="{}", report="2")
    assert ENTRY not in store.names("flights/a"), "what is mixed of old and new must not count"


def test_a_full_disk_leaves_what_was_there(tmp_path, monkeypatch):
    store = Store(tmp_path)
    commit(store, "flights/a", entry='{"key": 1}')

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(os, "fsync", full)
        with pytest.raises(OSError, match="No space"):
            commit(store, "flights/a", entry='{"key": 2}')
        with pytest.raises(OSError, match="No space"):
            store.write_json("manifest.json", {})
    assert store.read_json("flights/a/entry.json") == {"key": 1}
    assert store.names("") == [SCRATCH, "flights"]
    assert store.names(SCRATCH) == []


def test_a_temporary_store_goes_with_its_last_reference():
    store = TemporaryStore()
    store.write_json("a.json", 1)
    folder = store.folder
    assert folder.is_dir()
    del store
    assert not folder.exists()


# Entries: what is kept of a flight where its trajectory is not.


FLIGHT = made_flight("day 1/flight01", fit=False)


def test_a_flight_survives_json():
    entry = flight_entry(FLIGHT, folder="day_1_flight01", source="s3://logs/flight01.BIN", key="k")
    assert restored(json.loads(json.dumps(plain(entry), allow_nan=False)), FlightEntry) == entry
    assert entry.start_utc == FLIGHT.log.started
    assert entry.flight == FLIGHT.flight
    assert entry.experiments == ("motors",)
    assert "voltage" in entry.missing["thrust"]
    assert "not asked for" in entry.missing["motors"]
    grounded = Failure("flight", "the log shows no flight")
    bare = dataclasses.replace(FLIGHT, flight=grounded, trajectory=grounded, experiments={}, models=())
    entry = flight_entry(bare, folder="a", source="a.bin", key="k")
    assert restored(json.loads(json.dumps(plain(entry), allow_nan=False)), FlightEntry) == entry
    assert (entry.track, entry.position_known) == ((), False)


#: Eight threads that read the same entry before anybody read one.
TOGETHER = """
import json, sys, threading
from core.serialization import restored
from pipeline.results.fleet import FlightEntry
content, gate = json.load(sys.stdin), threading.Barrier(8)
sys.setswitchinterval(1e-6)
def read():
    gate.wait()
    restored(content, FlightEntry)
threads = [threading.Thread(target=read) for _ in range(8)]
for thread in threads: thread.start()
for thread in threads: thread.join()
"""


def test_urls_are_told_from_folders(tmp_path):
    assert isinstance(open_store(str(tmp_path)), Store)
    assert isinstance(open_store("memory://x"), ObjectStore)
    assert open_store((tmp_path / "a b").as_uri()).folder == tmp_path / "a b"


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
