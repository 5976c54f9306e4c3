"""Folders of logs: what is found, what it is called, what trains and what judges."""

import os
from pathlib import Path
from types import SimpleNamespace
from unittest import mock

import pytest

from pipeline import AnalysisConfig, ConfigError, analyze_fleet, fleet
from pipeline.results import Failure


def test_folders_are_searched_and_named_files_marked(tmp_path):
    (tmp_path / "day1").mkdir()
    (tmp_path / ".hidden").mkdir()
    for name in ("b.bin", "day1/a.bin", ".hidden/c.bin", ".d.bin"):
        (tmp_path / name).write_bytes(b"")
    named = tmp_path / "b.bin"
    found = fleet.find_logs([named, tmp_path, named])
    assert found == [(named, True), (tmp_path / "day1" / "a.bin", False)]


def test_links_in_a_circle_do_not_hang(tmp_path):
    (tmp_path / "a.bin").write_bytes(b"")
    (tmp_path / "again").symlink_to(tmp_path)
    (tmp_path / "nowhere.bin").symlink_to(tmp_path / "missing")
    assert [file.name for file, _ in fleet.find_logs([tmp_path])] == ["a.bin"]


def test_flights_are_named_after_files_uniquely():
    files = [Path(name) for name in ("a/x.BIN", "a/x.tlog", "a/x.json", "b/y.bin", "c/Y.bin", "z.bin")]
    names = fleet.flight_names(files)
    assert [names[file] for file in files] == ["x.BIN", "x.tlog", "x.json", "y.bin", "Y.bin (2)", "z"]


def test_names_are_printable_whatever_bytes_they_are_made_of():
    (name,) = fleet.flight_names([Path("a/bad\udcff\udcfename.bin")]).values()
    assert name == r"bad\xff\xfename"


def some(*names):
    return [SimpleNamespace(name=name) for name in names]


def test_every_second_flight_trains_unless_the_user_says():
    training, held_out, split = fleet.choose_training(some("a", "b", "c"), AnalysisConfig())
    assert [[flight.name for flight in part] for part in (training, held_out)] == [["a", "c"], ["b"]]
    assert "every second" in split
    config = AnalysisConfig(training=("PAPER0[12]",))
    training, held_out, split = fleet.choose_training(some("paper01", "paper02", "paper03"), config)
    assert [flight.name for flight in training] == ["paper01", "paper02"]
    assert "by the user" in split


def test_junk_in_a_folder_is_passed_over_but_broken_logs_are_named(tmp_path):
    (tmp_path / "notes.txt").write_text("not a log")
    (tmp_path / "empty.bin").write_bytes(b"")
    (tmp_path / "prose.log").write_text("dear diary,\n" * 100)
    result = analyze_fleet([tmp_path])
    assert [failure.path.name for failure in result.failures] == ["empty.bin", "prose.log"]
    assert "empty" in result.failures[0].reason
    assert not result.flights
    assert [unused.path.name for unused in result.passed_over] == ["notes.txt"]


def test_nothing_in_a_folder_is_passed_over_without_a_word(tmp_path):
    (tmp_path / "closed").mkdir()
    (tmp_path / "void").mkdir()
    (tmp_path / "a.bin.gz").write_bytes(b"\x1f\x8b damaged")
    (tmp_path / "b.gz").write_bytes(b"\x1f\x8b damaged")
    scandir = os.scandir

    def guarded(path):
        if Path(path).name == "closed":
            raise PermissionError(13, "Permission denied", str(path))
        return scandir(path)

    with mock.patch.object(os, "scandir", guarded):
        result = analyze_fleet([tmp_path, tmp_path / "void"])
    assert [failure.path.name for failure in result.failures] == ["a.bin.gz"]
    assert {unused.path.name: unused.reason for unused in result.passed_over} == {
        "closed": "cannot be opened: Permission denied",
        "void": "holds no further files",
        "b.gz": "no flight log",
    }


def test_a_named_file_that_is_no_log_is_a_failure_whatever_it_is_called(tmp_path):
    path = tmp_path / "notes.txt"
    path.write_text("not a log")
    assert [failure.path for failure in analyze_fleet([path]).failures] == [path]


def test_an_unreadable_file_costs_only_itself(tmp_path):
    path = tmp_path / "a.bin"
    path.write_bytes(b"x")
    with mock.patch.object(fleet, "analyze", side_effect=PermissionError(13, "Permission denied")):
        outcome = fleet.analyze_one(path, AnalysisConfig(), "a", named=True)
    assert outcome == Failure(path, "cannot be read: Permission denied")


def test_a_bug_in_one_log_costs_only_that_log(tmp_path, caplog):
    path = tmp_path / "a.bin"
    path.write_bytes(b"x")
    with mock.patch.object(fleet, "analyze", side_effect=ZeroDivisionError("division by zero")):
        outcome = fleet.analyze_one(path, AnalysisConfig(), "a", named=True)
    assert isinstance(outcome, Failure)
    assert "bug in rotorid" in outcome.reason
    assert "Traceback" in caplog.text


def test_training_flights_that_do_not_exist_are_wrong_usage(tmp_path):
    (tmp_path / "empty.bin").write_bytes(b"")
    with pytest.raises(ConfigError, match="paper01"):
        analyze_fleet([tmp_path], AnalysisConfig(training=("paper01",)))
