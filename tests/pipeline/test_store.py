"""Products are whole or not there, whatever happens while they are written, in folders and among objects."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import fsspec
import pytest

from pipeline.config import ConfigError
from pipeline.storage.store import ENTRY, SCRATCH, ObjectStore, Store, TemporaryStore, open_store


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


def test_urls_are_told_from_folders(tmp_path):
    assert isinstance(open_store(str(tmp_path)), Store)
    assert isinstance(open_store("memory://x"), ObjectStore)
    assert open_store((tmp_path / "a b").as_uri()).folder == tmp_path / "a b"


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


def test_only_one_run_writes_and_what_a_killed_one_left_goes(tmp_path):
    store = Store(tmp_path)
    killed = (
        "import os, signal, sys\nfrom pathlib import Path\nfrom pipeline.storage.store import Store\n"
        "store = Store(Path(sys.argv[1]))\n"
        "with store.locked(), store.scratch() as scratch:\n"
        "    (scratch / 'half').write_bytes(b'x')\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    subprocess.run(
        [sys.executable, "-c", killed, str(tmp_path)], check=False, timeout=60, cwd=Path(__file__).parents[2]
    )
    assert len(store.names(SCRATCH)) == 1
    with store.locked():
        assert store.names(SCRATCH) == []
        with pytest.raises(ConfigError, match="another run"), Store(tmp_path).locked():
            pass


def test_a_temporary_store_goes_with_its_last_reference():
    store = TemporaryStore()
    store.write_json("a.json", 1)
    folder = store.folder
    assert folder.is_dir()
    del store
    assert not folder.exists()
