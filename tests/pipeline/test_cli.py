"""The command line as a user meets it: what it prints where, and how it ends."""

import ast
import json
import os
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path
from unittest import mock

import pytest
from typer.main import get_command

import logparse
import pipeline
import reports
from api.store.resources import Configuration
from pipeline import AnalysisConfig, ConfigError
from pipeline.config import SETTINGS
from pipeline.execution import executors
from pipeline.fleet import crafts, job
from rotorid.cli import main as cli
from rotorid.cli.main import app
from tests.paths import ROOT, SAMPLES
from tests.pipeline import flown
from tests.reports.conftest import made_flight


@pytest.mark.parametrize(
    "arguments",
    [
        ["analyze", "nowhere.bin", "--out", "out"],
        ["analyze", "", "--out", "out"],
        ["analyze", ".", "--out", "out", "--poles", "0"],
        ["analyze", ".", "--out", "out", "--rate", "ten"],
        ["analyze", ".", "--out", "out", "--zeros", "9"],
        ["analyze", ".", "--out", "out", "--training", "paper01"],
        ["inspect", "nowhere.bin"],
        ["export", ".", "--out", "out"],
        ["simulate", "no-such-case"],
        ["fly"],
    ],
)
def test_wrong_usage_ends_with_2_and_says_why(arguments, tmp_path, rotorid_here, monkeypatch):
    (tmp_path / "a.bin").write_bytes(b"")
    monkeypatch.chdir(tmp_path)
    run = rotorid_here(*arguments)
    assert run.returncode == 2
    assert run.stderr.strip()
    assert "Traceback" not in run.stderr
    assert not run.stdout
    assert not (tmp_path / "out").exists()


def test_results_go_to_a_folder_of_the_name_of_the_log_unless_another_is_named(tmp_path, rotorid_here, monkeypatch):
    (tmp_path / "lab").mkdir()
    (tmp_path / "lab" / "flight.bin").write_bytes(b"none")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(executors, "processes", lambda *_: nullcontext())
    for named, folder in (("lab/flight.bin", "flight"), ("lab/", "lab")):
        run = rotorid_here("analyze", named)
        assert (tmp_path / "out" / folder).is_dir(), run.stderr


def test_a_table_without_a_description_is_told_how_to_give_one(tmp_path, rotorid_here):
    (tmp_path / "motion.csv").write_text("t,x\n0,1\n")
    run = rotorid_here("analyze", tmp_path / "motion.csv")
    assert run.returncode == 2
    assert "which column is what with --columns" in run.stderr


def test_help_waits_for_nothing_but_what_it_needs():
    """Help within 0.3 s: what takes longer to import than help may take, however fast the machine, stays away."""
    script = "import sys\nfrom rotorid.cli import main as cli\n"
    commands = ([], *([command.callback.__name__] for command in cli.app.registered_commands), ["token", "create"])
    script += f"for command in {list(commands)}:\n    cli.app([*command, '--help'], standalone_mode=False)\n"
    script += "print(sorted({name.partition('.')[0] for name in sys.modules} - set(sys.stdlib_module_names)))"
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=ROOT, timeout=3000)
    *text, modules = run.stdout.splitlines()
    assert {name for name in ast.literal_eval(modules) if not name.startswith("_")} <= {
        *("rotorid", "pipeline", "core", "logparse", "reports"),  # names of theirs are imported when asked for
        *("shellingham", "typer", "annotated_doc"),
    }
    assert sum(line.startswith("Usage: ") for line in text) == len(commands)
    assert sum(line.strip().startswith("Example: rotorid ") for line in text) >= len(commands) - 1


def test_a_file_that_is_no_log_ends_with_1_and_its_reason(tmp_path, rotorid_here):
    path = tmp_path / "diary.bin"
    path.write_text("dear diary,\n" * 10)
    run = rotorid_here("analyze", path, "--out", tmp_path / "out")
    assert run.returncode == 1
    assert "diary.bin" in run.stderr
    assert "not a flight log" in run.stderr
    assert "Traceback" not in run.stderr
    assert not run.stdout


def test_an_unwritable_folder_ends_with_a_sentence(tmp_path, rotorid_here):
    (tmp_path / "taken").write_text("a file, not a folder")
    log = SAMPLES / "octa01_zurich_calm.bin"
    for command in (["export", log, "--messages", "RCOU"], ["analyze", log]):
        for out in (tmp_path / "taken", "/dev/null", tmp_path / "taken" / "below"):
            run = rotorid_here(*command, "--out", out)
            assert run.returncode == 2
            assert str(out) in run.stderr.replace("\n", "")
            assert "fitting" not in run.stderr, "before the work, not after it"
            assert "Traceback" not in run.stderr
    assert (tmp_path / "taken").read_text() == "a file, not a folder"


def test_a_full_disk_costs_only_the_files(tmp_path, capsys, monkeypatch):
    flight = made_flight(fit=False)
    monkeypatch.setattr(pipeline, "analyze_flights", lambda *_, **__: iter([flight]), raising=False)
    monkeypatch.setattr(logparse, "read_flights", lambda _: ("one log",), raising=False)
    full = OSError(28, "No space left on device", "report.json")
    monkeypatch.setattr(reports, "write", mock.Mock(side_effect=full), raising=False)
    (tmp_path / "a.bin").write_bytes(b"x")
    with pytest.raises(SystemExit) as ended:
        cli.analyze([str(tmp_path / "a.bin")], str(tmp_path / "out"), as_json=True)
    shown = capsys.readouterr()
    assert ended.value.code == 1
    assert json.loads(shown.out)["name"] == flight.name
    assert "No space left" in shown.err


def test_a_file_name_does_not_command_the_terminal(tmp_path, rotorid_here):
    """The line of progress of `inspect` sent it as it is."""
    log = tmp_path / "a\x1b[2J.bin"
    log.write_bytes(b"no log")
    run = rotorid_here("inspect", log)
    assert r"reading a\x1b[2J.bin" in run.stderr
    assert "\x1b" not in run.stdout + run.stderr


@pytest.mark.parametrize("window", [["--start", "nan"], ["--end", "inf"], ["--start", "1e6"], ["--end", "-5"]])
def test_export_refuses_a_window_outside_the_log(window, tmp_path, rotorid_here):
    run = rotorid_here("export", SAMPLES / "octa01_zurich_calm.bin", "--out", tmp_path / "out", *window)
    assert run.returncode == 2
    assert not (tmp_path / "out").exists()


def test_inspect_json_is_json_and_nothing_else(rotorid_here):
    run = rotorid_here("inspect", SAMPLES / "octa01_zurich_calm.bin", "--json")
    assert run.returncode == 0
    log = json.loads(run.stdout)
    assert log["vehicle"]["frame_class"] == "octa"
    assert {table["name"] for table in log["tables"]} >= {"motors", "imu", "gps", "baro", "mag"}
    assert not run.stderr


def test_export_writes_what_was_asked_for(tmp_path, rotorid_here):
    log = SAMPLES / "octa01_zurich_calm.bin"
    run = rotorid_here(
        "export", log, "--out", tmp_path, "--format", "csv", "--messages", "RCOU,motors", "--start", "30", "--end", "32"
    )
    assert run.returncode == 0
    files = [Path(line) for line in run.stdout.split()]
    assert sorted(file.name for file in files) == ["RCOU.csv", "motors.csv"]
    times = [float(line.split(",")[0]) for line in files[0].read_text().splitlines()[1:]]
    assert times
    assert 30.0 <= min(times) <= max(times) <= 32.0


def test_a_folder_is_told_with_its_failures_and_told_again_without_work(tmp_path, rotorid_here, monkeypatch):
    """Broken logs are named, what the others hold is all there; the second run waits for no numerical package."""
    monkeypatch.setattr(job, "analyze_flights", flown.analyze_flights)
    monkeypatch.setattr(crafts, "identify_craft", flown.identify_craft)
    monkeypatch.setattr(executors, "processes", lambda *_: nullcontext())
    (tmp_path / "logs").mkdir()
    files = {"a.bin": "octa 1", "b.bin": "octa 2 2", "empty.bin": "broken", "README.md": "broken too"}
    for name, content in files.items():
        (tmp_path / "logs" / name).write_text(content)
    first = rotorid_here("analyze", tmp_path / "logs", "--out", tmp_path / "out")
    assert first.returncode == 1
    assert "empty.bin" in first.stderr
    assert "README.md" not in first.stderr
    numbers = json.loads((tmp_path / "out" / "report.json").read_text("utf-8"))
    assert [flight["name"] for flight in numbers["flights"]] == ["a", "b#1", "b#2"]
    assert len(list((tmp_path / "out" / "flights").glob("*/report.html"))) == 3
    script = (
        "import atexit, sys\nfrom rotorid.cli.main import main\n"
        "heavy = {'numpy', 'pandas', 'scipy', 'numba', 'pyarrow', 'plotly', 'fsspec'}\n"
        "atexit.register(lambda: print('heavy:', *heavy & set(sys.modules), file=sys.stderr))\nmain()"
    )
    command = [sys.executable, "-c", script, "analyze", str(tmp_path / "logs"), "--out", str(tmp_path / "out")]
    environment = os.environ | {"COLUMNS": "100", "NO_COLOR": "1", "PYTHONPATH": str(ROOT)}
    again = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=300)
    assert again.returncode == first.returncode
    assert again.stdout.partition("\nReport: ")[0] in first.stdout  # flights were told as they came
    assert "unchanged" in again.stdout
    assert again.stderr.splitlines()[-1] == "heavy:"


# Settings that cannot be are refused with what they may be.


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("rate", 0.0),
        ("rate", float("nan")),
        ("poles", 0),
        ("poles", 13),
        ("zeros", 5),
        ("zeros", -1),
        ("mass", 0.0),
        ("training_fraction", 1.0),
        ("time_limit", 0.0),
    ],
)
def test_impossible_settings_name_themselves(setting, value):
    with pytest.raises(ConfigError, match=setting):
        AnalysisConfig(**{setting: value})


def test_python_command_line_and_service_say_the_same_of_a_setting():
    (analyze,) = (command for command in get_command(app).commands.items() if command[0] == "analyze")
    options = {param.name: param for param in analyze[1].params}
    offered = Configuration.model_fields
    for name, setting in SETTINGS.items():
        assert options[name].help.startswith(setting.help), name
        assert options[name].default == (getattr(AnalysisConfig(), name) or options[name].default), name
        if name in offered:
            assert offered[name].description == setting.help
    assert set(offered) < set(SETTINGS) == set(AnalysisConfig.__dataclass_fields__)
