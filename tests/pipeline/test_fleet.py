"""Folders of logs: what is done once is kept, what is new is done, and whatever goes wrong costs only itself."""

import errno
import json
import multiprocessing
import os
import signal
from contextlib import contextmanager
from pathlib import Path

import fsspec
import pytest

import reports
from pipeline import AnalysisConfig, ConfigError, analyze_fleet
from pipeline.fleet import analysis as fleet_module
from pipeline.fleet import crafts, homogeneity, job, split
from pipeline.fleet.homogeneity import Unlike
from pipeline.storage import manifest
from pipeline.storage.dataset import part
from pipeline.storage.store import Store, open_store
from tests.pipeline import flown

CONFIG = AnalysisConfig(poles=1, zeros=0)


@pytest.fixture(autouse=True)
def _quick(monkeypatch):
    stand_in(monkeypatch)


def stand_in(monkeypatch):
    """Let flights of milliseconds stand for the pipeline."""
    monkeypatch.setattr(job, "analyze_flights", flown.analyze_flights)
    monkeypatch.setattr(crafts, "identify_craft", flown.identify_craft)
    of_software(monkeypatch, "0.1.0")


def of_software(monkeypatch, version):
    """Fix what the products are made with: somebody may edit the sources while the tests run."""
    fixed = manifest.Software(rotorid=version, sources="", libraries={})
    for module in (manifest, fleet_module):
        monkeypatch.setattr(module, "software", lambda: fixed)


@pytest.fixture
def logs(tmp_path):
    folder = tmp_path / "logs"
    folder.mkdir()
    for number in (1, 2, 3):
        (folder / f"octa{number}.bin").write_text(f"octa {number}")
    (folder / "quad.bin").write_text("quad 4")
    return folder


def run(folder, out, config=CONFIG, **named):
    """Analyse a folder; give the result, and the flights that were analysed for it."""
    flown.ANALYZED.clear()
    fleet = analyze_fleet([folder], config, store=out, **named)
    return fleet, list(flown.ANALYZED)


def fitted(fleet):
    return [group.name for group in fleet.groups if group.folder in fleet.fitted]


def test_a_second_run_does_nothing_and_finds_the_same(logs, tmp_path):
    out, remarks = tmp_path / "out", []

    def tell(entry):
        remarks.append(entry.name)
        assert (out / "flights" / entry.folder / "entry.json").is_file()

    first, analyzed = run(logs, out, announce=tell)
    assert sorted(analyzed) == sorted(remarks) == ["octa1", "octa2", "octa3", "quad"]
    assert fitted(first) == ["ArduCopter quad plus"]
    written = (out / "manifest.json").stat().st_mtime_ns
    assert {*first.groups[0].training, *first.groups[0].held_out} == {"octa1", "octa2", "octa3"}
    second, analyzed = run(logs, out)
    assert analyzed == []
    assert fitted(second) == []
    assert second.reused == 4
    assert second.flights == first.flights
    assert second.groups == first.groups
    assert second.manifest == first.manifest
    assert (out / "manifest.json").stat().st_mtime_ns == written
    third, analyzed = run(logs, out, redo=True)
    assert len(analyzed) == 4
    assert fitted(third)


def test_every_flight_of_a_log_is_kept_and_joined_with_the_others_of_its_craft(logs, tmp_path):
    out = tmp_path / "out"
    # A file that is called as the folder of another's second flight might be.
    (logs / "octa1_2.bin").write_text("octa 9")
    (logs / "octa1.bin").write_text("octa 11 3")
    fleet, analyzed = run(logs, out)
    several = ["octa1#1", "octa1#2", "octa1#3"]
    assert sorted(analyzed) == [*several, "octa1_2", "octa2", "octa3", "quad"]
    (craft,) = fleet.groups
    assert {*craft.training, *craft.held_out} == {*several, "octa1_2", "octa2", "octa3"}
    again, analyzed = run(logs, out)
    assert analyzed == []
    assert again.flights == fleet.flights
    # One of them is gone: the log is analysed again.
    (out / "flights" / "octa1~2" / "entry.json").unlink()
    assert run(logs, out)[1] == several
    # Fewer flights, by other software or in another file of that name: nothing is left of the others.
    (logs / "octa1.bin").write_text("octa 11 2")
    fleet, _ = run(logs, out)
    assert [flight.name for flight in fleet.flights if flight.log_name == "octa1"] == several[:2]
    assert not (out / "flights" / "octa1~3").exists()
    assert not list(out.glob("tables/*/*/flight=octa1~3"))


def test_flights_of_another_payload_are_a_build_of_their_own(logs, tmp_path, monkeypatch):
    """Two flights unlike the rest are fitted with each other; they were lost to every joint fit before."""
    for number in (5, 6):
        (logs / f"octa{number}.bin").write_text(f"octa {number}")

    def heavy(flights):
        apart = {flight.name for flight in flights} & {"octa5", "octa6"}
        return {
            name: Unlike(flight=name, quantity="thrust over mass", ratio=0.6, sigmas=9.0)
            for name in apart
            if len(apart) < len(flights)
        }

    for module in (split, homogeneity):
        monkeypatch.setattr(module, "unlike_flights", heavy)
    fleet, _ = run(logs, tmp_path / "out")
    assert [(group.name, group.folder) for group in fleet.groups] == [
        ("ArduCopter quad plus", fleet.groups[0].folder),
        ("ArduCopter quad plus, build 2", f"{fleet.groups[0].folder}-build-2"),
    ]
    first, second = ({*group.training, *group.held_out} for group in fleet.groups)
    assert (first, second) == ({"octa1", "octa2", "octa3"}, {"octa5", "octa6"})
    assert not [file for file in fleet.passed_over if "octa" in file.source]
    assert sorted(fitted(fleet)) == [group.name for group in fleet.groups]
    again, analyzed = run(logs, tmp_path / "out")
    assert (analyzed, fitted(again), again.groups) == ([], [], fleet.groups)
    asked = AnalysisConfig(poles=1, zeros=0, training=("octa1", "octa5"))
    assert len(run(logs, tmp_path / "out", asked)[0].groups) == 1


def test_the_name_of_a_log_chooses_all_its_flights(logs, tmp_path):
    (logs / "octa1.bin").write_text("octa 11 2")
    fleet, _ = run(logs, tmp_path / "out", AnalysisConfig(poles=1, zeros=0, training=("octa1",)))
    assert fleet.groups[0].training == ("octa1#1", "octa1#2")
    assert fleet.groups[0].held_out == ("octa2", "octa3")


def test_names_that_are_not_utf8_are_kept_as_they_are(logs, tmp_path):
    odd = os.fsdecode(b"bad\xff\xfename.bin")
    try:
        (logs / "quad.bin").rename(logs / odd)
    except (OSError, UnicodeError):
        pytest.skip("this file system has no such names")
    first, analyzed = run(logs, tmp_path / "out")
    assert len(analyzed) == 4
    assert odd in [Path(flight.source).name for flight in first.flights]
    second, analyzed = run(logs, tmp_path / "out")
    assert analyzed == []
    assert second.flights == first.flights


def test_only_what_is_new_or_changed_is_done(logs, tmp_path):
    out = tmp_path / "out"
    run(logs, out)
    (logs / "quad2.bin").write_text("quad 5")
    fleet, analyzed = run(logs, out)
    assert analyzed == ["quad2"]
    assert fitted(fleet) == ["ArduCopter quad plus"], "a craft is fitted again only when its flights are others"
    assert len(fleet.groups) == 2
    (logs / "octa2.bin").write_text("octa 7")
    fleet, analyzed = run(logs, out)
    assert analyzed == ["octa2"]
    assert len(fitted(fleet)) == 1
    fleet, analyzed = run(logs, out, AnalysisConfig(poles=2, zeros=0))
    assert len(analyzed) == 5
    assert len(fitted(fleet)) == 2
    training = AnalysisConfig(poles=2, zeros=0, training=("octa1", "quad"))
    fleet, analyzed = run(logs, out, training)
    assert analyzed == [], "who trains is no matter of single flights"
    assert fleet.groups[0].training == ("octa1",)


def test_other_software_does_everything_anew(logs, tmp_path, monkeypatch):
    out = tmp_path / "out"
    run(logs, out)
    heard: list[str] = []
    run(logs, out, progress=lambda what, _: heard.append(what))
    assert not [remark for remark in heard if "another version" in remark]
    of_software(monkeypatch, "0.2.0")
    assert len(run(logs, out, progress=lambda what, _: heard.append(what))[1]) == 4
    assert "results here are of another version of rotorid or its libraries, and are made anew" in heard


@pytest.mark.parametrize("written", ['{"logs": 3}', "no JSON"])
def test_a_manifest_of_another_form_is_written_anew(logs, tmp_path, written):
    out = tmp_path / "out"
    run(logs, out)
    (out / "manifest.json").write_text(written)
    assert len(run(logs, out)[0].flights) == 4
    assert manifest.read_manifest(open_store(out)).software is not None


def test_another_style_sheet_draws_pages_anew_and_analyses_nothing(logs, tmp_path, monkeypatch):
    """A wording fix of the reports analysed every log and fitted every craft again."""
    out = tmp_path / "out"
    fleet, analyzed = run(logs, out, publish=reports.publish)
    reports.write_fleet(fleet)
    assert len(analyzed) == 4
    before = {path: path.read_text() for path in out.rglob("report.json")}
    written = {path: path.stat().st_mtime_ns for path in out.rglob("report.html")}
    again, analyzed = run(logs, out, publish=reports.publish)
    assert (analyzed, again.reused, again.reported) == ([], 4, True)

    monkeypatch.setattr(manifest, "presentation", lambda: ("another style sheet", None))
    monkeypatch.setattr(crafts, "identify_craft", None)  # would fail when it is called
    styled, analyzed = run(logs, out, publish=reports.publish)
    assert analyzed == []
    assert not styled.reported, "the page on all flights is of the old style"
    assert [flight.name for flight in styled.flights] == [flight.name for flight in fleet.flights]
    assert all(path.stat().st_mtime_ns > written[path] for path in out.glob("flights/*/report.html"))
    # Of the same result, except for what is said when it was drawn.
    assert {path: path.read_text() for path in out.rglob("report.json")} == before
    assert run(logs, out, publish=reports.publish)[0].reused == 4


def test_a_result_that_is_not_there_is_made_again(logs, tmp_path, monkeypatch):
    out = tmp_path / "out"
    run(logs, out, publish=reports.publish)
    (out / "flights" / "octa1" / "figures.json").unlink()
    (out / "flights" / "octa2" / "figures.json").write_bytes(b"damaged")
    monkeypatch.setattr(manifest, "presentation", lambda: ("another style sheet", None))
    assert sorted(run(logs, out, publish=reports.publish)[1]) == ["octa1", "octa2"]
    assert len(run(logs, out, publish=reports.publish, redo=True)[1]) == 4


def test_logs_that_are_gone_leave_the_report_but_not_the_store(logs, tmp_path):
    out = tmp_path / "out"
    run(logs, out)

    def in_datasets() -> set[str]:
        return {path.parent.name for path in out.glob("*/*/vehicle=*/flight=*/part.parquet")}

    everything = in_datasets()
    (logs / "octa3.bin").rename(tmp_path / "octa3.bin")
    fleet, analyzed = run(logs, out)
    assert analyzed == []
    assert in_datasets() == everything - {"flight=octa3"}, "no query counts what the report does not"
    assert [flight.name for flight in fleet.flights] == ["octa1", "octa2", "quad"]
    assert [file.file for file in fleet.removed] == ["octa3.bin"]
    assert [file.file for file in run(logs, out)[0].removed] == ["octa3.bin"], "until it comes back"
    (tmp_path / "octa3.bin").rename(logs / "octa3.bin")
    fleet, analyzed = run(logs, out)
    assert analyzed == []
    assert fitted(fleet), "from the experiments that came back"
    assert fleet.removed == ()
    assert len(fleet.flights) == 4
    assert in_datasets() == everything


def test_logs_may_move_together(logs, tmp_path):
    out = tmp_path / "out"
    run(logs, out)
    logs.rename(tmp_path / "moved")
    fleet, analyzed = run(tmp_path / "moved", out)
    assert analyzed == []
    assert Path(fleet.flights[0].source).parent == tmp_path / "moved"


def test_a_flight_that_was_of_another_craft_leaves_no_part_behind(logs, tmp_path):
    """Query engines read whatever part lies in the dataset."""
    out = tmp_path / "out"
    before = run(logs, out)[0].flights[0]
    old = out / part("experiments", "motors", before.vehicle, before.folder)
    assert old.is_file()
    (logs / "octa1.bin").write_text("quad 9")
    after = run(logs, out)[0].flights[0]
    assert not old.parent.exists()
    assert (out / part("experiments", "motors", after.vehicle, after.folder)).is_file()


def test_junk_is_listed_with_its_reason(logs, tmp_path):
    (logs / "copy.txt").write_text("broken")
    (logs / "notes.txt").write_text("broken too")
    (logs / "torn.bin").write_text("broken")
    (logs / "z_copy.bin").write_text("octa 1")
    (logs / "odd.bin").write_text("bug")
    out = tmp_path / "out"
    (logs / "more.txt").write_text("broken too")
    manifests = []
    for _ in range(2):  # and again from what is stored
        fleet, _ = run(logs, out)
        manifests.append(fleet.manifest)
        assert {failure.file: failure.reason.partition(" (")[0] for failure in fleet.failures} == {
            "torn.bin": "torn.bin is broken",
            "odd.bin": "unexpected ZeroDivisionError: division by zero",
        }
        assert [file.file for file in fleet.passed_over] == ["more.txt", "notes.txt"]
        assert {duplicate.file: duplicate.reason for duplicate in fleet.duplicates} == {
            "z_copy.bin": "a copy of logs/octa1.bin",
            "copy.txt": "a copy of logs/torn.bin",
        }
        assert len(fleet.flights) == 4
    assert fleet.reused == 7
    assert manifests[0] == manifests[1]
    named = analyze_fleet([logs / "notes.txt"], CONFIG)
    assert [failure.file for failure in named.failures] == ["notes.txt"], "who names a file wants to know"


def test_training_flights_that_do_not_exist_are_wrong_usage(logs, tmp_path):
    for choice in ({"training": ("paper01",)}, {"validation": ("paper01",)}):
        with pytest.raises(ConfigError, match="paper01"):
            run(logs, tmp_path / "out", AnalysisConfig(**choice))
    assert not (tmp_path / "out").exists()
    run(logs, tmp_path / "out", AnalysisConfig(poles=1, zeros=0, training=("OCTA[12].bin", "quad")))


def run_as_a_program(folder, out):
    stand_in(pytest.MonkeyPatch())
    run(folder, out)


def test_a_killed_run_is_resumed(logs, tmp_path, forks):
    """The process dies of the third log; what it had done is there, and half of nothing is."""
    out = tmp_path / "out"
    (logs / "octa3.bin").write_text("kill")
    program = multiprocessing.get_context("forkserver").Process(target=run_as_a_program, args=(logs, out))
    program.start()
    program.join()
    assert program.exitcode == -signal.SIGKILL
    assert sorted(path.name for path in (out / "flights").iterdir()) == ["octa1", "octa2"]
    (logs / "octa3.bin").write_text("octa 3")
    fleet, analyzed = run(logs, out)
    assert analyzed == ["octa3", "quad"]
    assert len(fleet.flights) == 4
    assert not list((out / ".scratch").glob("*"))


def test_killed_between_parts_of_the_dataset_a_flight_counts_as_undone(logs, tmp_path, monkeypatch):
    out = tmp_path / "out"
    run(logs, out)
    put = Store.put

    def interrupted(self, file, path):
        if path.startswith("experiments/"):
            raise KeyboardInterrupt
        put(self, file, path)

    with monkeypatch.context() as patched:
        patched.setattr(Store, "put", interrupted)
        with pytest.raises(KeyboardInterrupt):
            run(logs, out, AnalysisConfig(poles=2, zeros=0))
    fleet, analyzed = run(logs, out)
    assert analyzed == ["octa1"], "its parts may be of either run"
    assert len(fleet.flights) == 4


@contextmanager
def disk_full(monkeypatch, when):
    """Fill the disk for products at some paths."""
    commit = Store.commit

    def full(self, folder, path):
        if when(path):
            raise OSError(errno.ENOSPC, "No space left on device")
        commit(self, folder, path)

    with monkeypatch.context() as patched:
        patched.setattr(Store, "commit", full)
        yield


def test_a_full_disk_keeps_what_is_done_and_names_the_rest(logs, tmp_path, monkeypatch):
    out = tmp_path / "out"
    with disk_full(monkeypatch, lambda path: path.endswith("octa2")):
        fleet, _ = run(logs, out)
    assert [flight.name for flight in fleet.flights] == ["octa1"]
    reasons = {failure.file: failure.reason for failure in fleet.failures}
    assert reasons["octa2.bin"] == "its results could not be stored: No space left on device"
    assert "was not begun" in reasons["octa3.bin"]
    assert "No space left" in reasons["quad.bin"]
    fleet, analyzed = run(logs, out)
    assert analyzed == ["octa2", "octa3", "quad"]
    assert not fleet.failures
    # So it is with what is common to a craft.
    (logs / "octa3.bin").write_text("octa 7")
    with disk_full(monkeypatch, lambda path: path.startswith("crafts/")):
        fleet, _ = run(logs, out)
    assert fleet.groups == ()
    assert [failure.reason for failure in fleet.failures] == [
        "its joint models could not be stored: No space left on device"
    ]
    fleet, analyzed = run(logs, out)
    assert analyzed == []
    assert fitted(fleet)
    assert not fleet.failures


def test_another_run_on_the_same_results_is_refused(logs, tmp_path):
    store = open_store(tmp_path / "out")
    store.prepare()
    with store.locked(), pytest.raises(ConfigError, match="another run"):
        run(logs, tmp_path / "out")


def test_the_report_is_written_again_only_when_something_is_other(logs, tmp_path):
    out = tmp_path / "out"
    fleet, _ = run(logs, out, publish=reports.publish)
    assert not fleet.reported
    reports.write_fleet(fleet)
    assert run(logs, out, publish=reports.publish)[0].reported
    os.utime(logs / "octa1.bin", ns=(0, 0))
    assert run(logs, out, publish=reports.publish)[0].reported, "a new date of the same content changes nothing"
    (logs / "more.bin").write_text("broken")
    assert not run(logs, out, publish=reports.publish)[0].reported
    numbers = json.loads((out / "report.json").read_text("utf-8"))
    assert {flight["name"] for flight in numbers["flights"]} == {"octa1", "octa2", "octa3", "quad"}
    (out / "report.html").unlink()
    (logs / "more.bin").unlink()
    assert not run(logs, out, publish=reports.publish)[0].reported


def test_logs_and_results_may_be_far_away():
    memory = fsspec.filesystem("memory")
    memory.pipe({f"/far/logs/octa{k}.bin": f"octa {k}".encode() for k in (1, 2)})
    try:
        first, analyzed = run("memory://far/logs", "memory://far/out")
        assert sorted(analyzed) == ["octa1", "octa2"]
        assert fitted(first)
        second, analyzed = run("memory://far/logs", "memory://far/out")
        assert analyzed == []
        assert not fitted(second)
        assert second.flights == first.flights
        memory.pipe("/far/logs/octa1.bin", b"octa 9")
        assert run("memory://far/logs", "memory://far/out")[1] == ["octa1"]
    finally:
        memory.rm("/far", recursive=True)
