"""What is found among the files of a user, each once, and records of it: nothing read twice without need."""

import errno
import hashlib
import os
from pathlib import Path
from unittest import mock

import fsspec
import pytest

from pipeline import AnalysisConfig
from pipeline.names import folder_names, printable
from pipeline.storage import inventory
from pipeline.storage.inventory import flight_names, index_sources
from pipeline.storage.manifest import Manifest
from pipeline.storage.sources import called_a_log, digest, fetched, find


def files(listing):
    return [(source.file, source.named) for source in listing.sources]


def reasons(passed_over):
    return {Path(file.source).name: file.reason for file in passed_over}


def test_folders_are_searched_and_named_files_marked(tmp_path):
    (tmp_path / "day1").mkdir()
    (tmp_path / ".hidden").mkdir()
    for name in ("b.bin", "day1/a.bin", ".hidden/c.bin", ".d.bin"):
        (tmp_path / name).write_bytes(b"")
    named = tmp_path / "b.bin"
    assert files(find([named, tmp_path, named])) == [("b.bin", True), ("a.bin", False)]
    called = [name for name in ("a.BIN", "a.bin.gz", "a.gz", "bin") if called_a_log(name)]
    assert called == ["a.BIN", "a.bin.gz"]


def test_links_are_followed_but_not_in_a_circle(tmp_path):
    logs, far = tmp_path / "logs", tmp_path / "far"
    logs.mkdir()
    far.mkdir()
    (logs / "a.bin").write_bytes(b"a")
    (far / "b.bin").write_bytes(b"b")
    (logs / "again").symlink_to(logs)
    (logs / "elsewhere").symlink_to(far)
    (far / "back").symlink_to(logs)
    (logs / "nowhere.bin").symlink_to(tmp_path / "missing")
    (logs / "itself.bin").symlink_to(logs / "itself.bin")
    listing = find([logs])
    assert files(listing) == [("a.bin", False), ("b.bin", False)]
    assert reasons(listing.passed_over) == {"nowhere.bin": "a link to nothing", "itself.bin": "a link to nothing"}


def test_results_that_lie_among_the_logs_are_no_logs(tmp_path):
    (tmp_path / "out" / "flights").mkdir(parents=True)
    (tmp_path / "out" / "flights" / "old.bin").write_bytes(b"x")
    (tmp_path / "a.bin").write_bytes(b"x")
    assert files(find([tmp_path], exclude=tmp_path / "out")) == [("a.bin", False)]
    assert files(find([tmp_path], exclude=tmp_path / "missing")) == [("a.bin", False), ("old.bin", False)]


def test_what_cannot_be_read_is_named(tmp_path):
    os.mkfifo(tmp_path / "pipe.bin")
    (tmp_path / "closed").mkdir()
    (tmp_path / "void").mkdir()
    scandir = os.scandir

    def guarded(path):
        if Path(path).name == "closed":
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        return scandir(path)

    with mock.patch.object(os, "scandir", guarded):
        listing = find([tmp_path, tmp_path / "void", tmp_path / "missing.bin"])
    assert reasons(listing.passed_over) == {
        "pipe.bin": "neither a file nor a folder",
        "closed": "cannot be opened: Permission denied",
        "void": "holds no further files",
    }
    assert reasons(listing.failures) == {"missing.bin": "cannot be opened: No such file or directory"}


def test_urls_are_searched_and_fetched_like_folders(tmp_path):
    memory = fsspec.filesystem("memory")
    memory.pipe({"/far/logs/a.bin": b"first", "/far/logs/day/b.bin": b"second", "/far/logs/.hidden/c.bin": b"third"})
    try:
        listing = find(["memory://far/logs"])
        assert files(listing) == [("a.bin", False), ("b.bin", False)]
        assert [source.size for source in listing.sources] == [5, 6]
        assert files(find([listing.sources[1].url])) == [("b.bin", True)]
        assert digest(listing.sources[0].url) == hashlib.sha256(b"first").hexdigest()
        with fetched(listing.sources[1].url) as file:
            assert (file.name, file.read_bytes()) == ("b.bin", b"second")
        assert not file.exists()
        assert "no-such" in find(["memory://far/no-such.bin"]).failures[0].source
    finally:
        memory.rm("/far", recursive=True)


def test_storage_that_fails_in_its_own_way_is_a_failure_of_its_own():
    listing = find(["nonsense://a/b.bin"])
    assert not listing.sources
    assert "nonsense" in listing.failures[0].reason
    with pytest.raises(OSError, match="nonsense"), fetched("nonsense://a/b.bin"):
        pass


# Records of files: copies told by content, names unique and kept, nothing read twice without need.


CONFIG = AnalysisConfig()


def stock(folder, former=None, config=CONFIG):
    return index_sources(find([folder]).sources, former or Manifest(), config)


def analyzed(records):
    """Make the manifest of a run that ended well."""
    return Manifest(
        logs=tuple(inventory.replace(record, state="analysed") if record.key else record for record in records)
    )


def test_flights_are_named_after_files_uniquely():
    urls = ["a/x.BIN", "a/x.json", "a/x.tlog", "b/y.bin", "b/z.json", "c/Y.bin", "z.bin"]
    names = flight_names(urls)
    assert [names[url] for url in urls] == ["x.BIN", "x.json", "x.tlog", "y.bin", "z (2)", "Y.bin (2)", "z"]
    assert printable("a\x1b[2Jb\x9bc\r\x7f é\tå\n") == r"a\x1b[2Jb\x9bc\x0d\x7f" + " é\tå\n"


def test_a_further_file_leaves_the_names_of_the_others(tmp_path):
    (tmp_path / "x.bin").write_bytes(b"1")
    before = stock(tmp_path)
    (tmp_path / "x.ulg").write_bytes(b"2")
    after = stock(tmp_path, analyzed(before))
    assert [record.name for record in after] == ["x", "x.ulg"]
    assert after[0].key == before[0].key


def test_copies_are_told_by_content_whatever_they_are_called(tmp_path):
    for name, content in {"a.bin": b"1", "b.tlog": b"1", "c.bin": b"2", "d.bin": b"", "e.bin": b""}.items():
        (tmp_path / name).write_bytes(content)
    records = stock(tmp_path)
    assert [record.state for record in records] == ["interrupted", "duplicate", *["interrupted"] * 3]
    assert records[1].original == str(tmp_path / "a.bin")
    assert not records[1].key
    # Of equal files the one that was analysed stays the one.
    former = analyzed(records)
    (tmp_path / "0.bin").write_bytes(b"1")
    assert [record.state for record in stock(tmp_path, former)][:3] == ["duplicate", "interrupted", "duplicate"]


def test_only_files_written_since_are_read_again(tmp_path, monkeypatch):
    for name in ("a.bin", "b.bin", "c.bin"):
        (tmp_path / name).write_bytes(name.encode())
    former = analyzed(stock(tmp_path))
    (tmp_path / "b.bin").write_bytes(b"longer")
    status = (tmp_path / "c.bin").stat()
    os.utime(tmp_path / "c.bin", ns=(status.st_atime_ns, status.st_mtime_ns + 1))
    read = []
    digest = inventory.digest
    monkeypatch.setattr(inventory, "digest", lambda url: read.append(url) or digest(url))
    after = stock(tmp_path, former)
    assert sorted(read) == [str(tmp_path / "b.bin"), str(tmp_path / "c.bin")]
    assert [new.key == old.key for new, old in zip(after, former.logs, strict=True)] == [True, False, True]


@pytest.mark.parametrize(("name", "state"), [("a.bin", "failed"), ("a.txt", "no log")])
def test_a_file_that_cannot_be_read_costs_only_itself(tmp_path, monkeypatch, name, state):
    (tmp_path / name).write_bytes(b"1")
    (tmp_path / "b.bin").write_bytes(b"2")

    def refuse(url):
        if url.endswith(name):
            raise PermissionError(13, "Permission denied")
        return "0" * 64

    monkeypatch.setattr(inventory, "digest", refuse)
    records = stock(tmp_path)
    assert (records[0].state, records[0].reason) == (state, "cannot be read: Permission denied")
    assert records[1].key


def test_folders_of_long_names_suit_every_file_system():
    names = ["飞" * 150, "飞" * 151, "😀" * 200]
    folders = folder_names(names)
    assert len(set(folders.values())) == 3
    assert all(0 < len(folder.encode()) < 200 for folder in folders.values())
