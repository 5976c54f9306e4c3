"""What an analysis can still see that a stranger's log has taken over."""

import json
import multiprocessing
import os
from pathlib import Path

import pytest

from api.settings import LogFormat, Settings
from api.work.confinement import landlock_version
from api.work.watch import limits_of
from api.work.worker import Ended, Limits, Progress, Task, run


def pry(task: Task, _: Progress) -> None:
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
        target=run, args=(sender, pry, task, Limits(60.0, 10**9, 10**9, closed), LogFormat.TEXT)
    )
    process.start()
    sender.close()
    assert receiver.recv() == Ended()
    process.join()
    assert json.loads((own / "results/done.json").read_text()) == ["given log", "own file moved", "programs"]
