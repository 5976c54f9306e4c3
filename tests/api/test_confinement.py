"""What an analysis sees that a stranger's log has taken over; what unit and image leave a service of the machine."""

import json
import multiprocessing
import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from api.settings import LogFormat, Settings
from api.work.confinement import landlock_version
from api.work.watch import limits_of
from api.work.worker import Ended, Task, TaskLimits, TaskProgress, run
from tests.paths import ROOT


def pry(task: Task, _: TaskProgress) -> None:
    """Try to read what is the service's, and to work as an analysis does; write down what succeeded."""
    data, own = task.folder.parents[2], task.folder
    tried = {
        "database": lambda: (data / "rotorid.db").read_bytes(),
        "another's log": lambda: (data / "objects/logs/1").read_bytes(),
        "another's scratch": lambda: (data / "scratch/other/log").read_bytes(),
        "list": lambda: list((data / "objects").iterdir()),
        "write": lambda: (data / "objects/mine").write_bytes(b""),
        "way round": lambda: (data.parent / "link/rotorid.db").read_bytes(),
        "given log": lambda: task.logs[0][0].read_bytes(),
        "given log overwritten": lambda: task.logs[0][0].write_bytes(b""),
        "own file moved": lambda: (own.parent / "part").rename(own / "part"),
        "programs": lambda: Path(json.__file__).read_bytes(),
        "environment of the service": lambda: Path(f"/proc/{os.getppid()}/environ").read_bytes(),
    }
    done = []
    for name, trial in tried.items():
        try:
            trial()
        except PermissionError:
            continue
        done.append(name)
    if "AWS_SECRET_ACCESS_KEY" in os.environ or b"hunter2" in Path("/proc/self/environ").read_bytes():
        done.append("key of the storage")
    (own / "done.json").write_text(json.dumps(done))


@pytest.mark.skipif(landlock_version() < 2, reason="this kernel has no Landlock")
def test_an_analysis_reaches_nothing_of_the_service(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It could read the database, the logs of others, and the database's password and storage's keys."""
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "hunter2")
    data, own = tmp_path / "data", tmp_path / "data/scratch/own"
    for file in ("rotorid.db", "objects/logs/1", "scratch/other/log", "objects/logs/2", "scratch/own/part"):
        (data / file).parent.mkdir(parents=True, exist_ok=True)
        (data / file).write_bytes(b"x")
    (own / "results").mkdir()
    (own / "log").symlink_to(data / "objects/logs/2")
    (tmp_path / "link").symlink_to(data)
    closed = limits_of(Settings(data=data)).closed
    receiver, sender = multiprocessing.Pipe(duplex=False)
    task = Task([(own / "log", "log")], {}, own / "results")
    process = multiprocessing.get_context("spawn").Process(
        target=run, args=(sender, pry, task, TaskLimits(60.0, 10**9, 10**9, closed), LogFormat.TEXT)
    )
    process.start()
    sender.close()
    assert receiver.recv() == Ended()
    process.join()
    assert json.loads((own / "results/done.json").read_text()) == ["given log", "own file moved", "programs"]


UNIT = ROOT / "deploy" / "rotorid.service"


def test_the_unit_is_hardened() -> None:
    """2.5 of 10 is the goal; what is left is network, an address family or two, and numba's own machine code."""
    program = shutil.which("systemd-analyze")
    if program is None:
        pytest.skip("systemd-analyze is not installed")
    said = subprocess.run(
        [program, "security", "--offline=true", "--no-pager", str(UNIT)], capture_output=True, text=True, check=False
    )
    match = re.search(r"exposure level for rotorid.service: ([0-9.]+)", said.stdout)
    if match is None:
        pytest.skip(f"this systemd-analyze judges no files: {said.stderr.strip()}")
    assert float(match[1]) < 2.5


def test_the_image_has_every_package_of_ours() -> None:
    """It once lacked the command line."""
    root = UNIT.parents[1]
    ours = {path.parent.name for path in root.glob("*/__init__.py")} - {"tests", "benchmarks"}
    copied = set(re.findall(r"^COPY (\w+) \1$", (root / "deploy" / "Dockerfile").read_text(), re.MULTILINE))
    assert "rotorid" in ours
    assert ours <= copied


def test_what_is_installed_for_the_service_is_pinned_as_elsewhere_and_hashed() -> None:
    """With hashes in constraints.txt itself pip would ask for one of this very folder, which it cannot have."""
    root = UNIT.parents[1]
    pinned = set(re.findall(r"^(\S+==\S+)", (root / "constraints.txt").read_text(), re.MULTILINE))
    entries = re.split(r"^(?=\S)", (UNIT.parent / "requirements.txt").read_text(), flags=re.MULTILINE)[1:]
    assert len(entries) > 50
    assert [entry for entry in entries if "--hash=sha256:" not in entry] == []
    assert {entry.split()[0] for entry in entries} <= pinned
    dockerfile = (root / "deploy" / "Dockerfile").read_text()
    assert "--require-hashes -r requirements.txt" in dockerfile
    assert "--no-deps ." in dockerfile
