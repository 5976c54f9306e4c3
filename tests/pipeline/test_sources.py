"""What is found among the files of a user: each once, nothing dropped without a word, no hanging."""

import errno
import hashlib
import os
from pathlib import Path
from unittest import mock

import fsspec
import pytest

from pipeline.storage import sources
from pipeline.storage.sources import digest, fetched, find


def files(found):
    return [(source.file, source.named) for source in found.sources]


def reasons(passed_over):
    return {Path(each.source).name: each.reason for each in passed_over}


def test_folders_are_searched_and_named_files_marked(tmp_path):
    (tmp_path / "day1").mkdir()
    (tmp_path / ".hidden").mkdir()
    for name in ("b.bin", "day1/a.bin", ".hidden/c.bin", ".d.bin"):
        (tmp_path / name).write_bytes(b"")
    named = tmp_path / "b.bin"
    assert files(find([named, tmp_path, named])) == [("b.bin", True), ("a.bin", False)]


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
    found = find([logs])
    assert files(found) == [("a.bin", False), ("b.bin", False)]
    assert reasons(found.passed_over) == {"nowhere.bin": "a link to nothing", "itself.bin": "a link to nothing"}


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
        found = find([tmp_path, tmp_path / "void", tmp_path / "missing.bin"])
    assert reasons(found.passed_over) == {
        "pipe.bin": "neither a file nor a folder",
        "closed": "cannot be opened: Permission denied",
        "void": "holds no further files",
    }
    assert reasons(found.failures) == {"missing.bin": "cannot be opened: No such file or directory"}


def test_urls_are_searched_and_fetched_like_folders(tmp_path):
    memory = fsspec.filesystem("memory")
    memory.pipe({"/far/logs/a.bin": b"first", "/far/logs/day/b.bin": b"second", "/far/logs/.hidden/c.bin": b"third"})
    try:
        found = find(["memory://far/logs"])
        assert files(found) == [("a.bin", False), ("b.bin", False)]
        assert [source.size for source in found.sources] == [5, 6]
        assert files(find([found.sources[1].url])) == [("b.bin", True)]
        assert digest(found.sources[0].url) == hashlib.sha256(b"first").hexdigest()
        with fetched(found.sources[1].url) as file:
            assert (file.name, file.read_bytes()) == ("b.bin", b"second")
        assert not file.exists()
        assert "no-such" in find(["memory://far/no-such.bin"]).failures[0].source
    finally:
        memory.rm("/far", recursive=True)


def test_storage_that_fails_in_its_own_way_is_a_failure_of_its_own():
    found = find(["nonsense://a/b.bin"])
    assert not found.sources
    assert "nonsense" in found.failures[0].reason
    with pytest.raises(OSError, match="nonsense"), fetched("nonsense://a/b.bin"):
        pass


@pytest.mark.parametrize(
    ("file", "log"),
    [("a.BIN", True), ("a.bin.gz", True), ("a.tlog.zip", True), ("a.gz", False), ("a.json", False), ("bin", False)],
)
def test_endings_promise_logs(file, log):
    assert sources.called_a_log(file) is log
