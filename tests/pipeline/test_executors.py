"""Processes side by side: what one dies of costs that call only, and nothing outlives whoever started them."""

import os
import select
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

import pytest

from pipeline import AnalysisConfig, analyze_fleet
from pipeline.execution.executors import Processes, WorkerDiedError, as_done, count_workers
from pipeline.fleet import crafts, job
from tests.paths import ROOT
from tests.pipeline import calls, flown

pytestmark = pytest.mark.usefixtures("forks")


@pytest.fixture
def pair():
    with Processes(2) as pool:
        yield pool


@pytest.fixture
def pipe(tmp_path):
    path = tmp_path / "pipe"
    os.mkfifo(path)
    return path


@contextmanager
def heard(pipe: Path, program: "subprocess.Popen[bytes] | None" = None) -> Iterator[TextIO]:
    """Open a pipe to read once somebody writes into it; a program that should and has died must not be waited for."""
    reports = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    ready = select.poll()
    ready.register(reports, select.POLLIN)
    while not ready.poll(1000.0):
        assert program is None or program.poll() is None, program.communicate()
    os.set_blocking(reports, True)
    with os.fdopen(reports) as file:
        yield file


@pytest.fixture
def short_folder():
    """Yield a folder with a short path: those of sockets, which lie in temporary folders, have 107 characters."""
    with tempfile.TemporaryDirectory(prefix="r", dir="/tmp") as folder:
        yield Path(folder)


def test_calls_and_what_they_raise_come_back(pair):
    assert list(pair.map(calls.square, range(5))) == [0, 1, 4, 9, 16]
    with pytest.raises(ValueError, match="too short") as raised:
        pair.submit(calls.refuse, "too short").result()
    assert "calls.py" in raised.value.__notes__[0]  # the other process's traceback
    with pytest.raises(TypeError, match="cannot be sent between processes"):
        pair.submit(calls.unsendable).result()
    with pytest.raises((TypeError, AttributeError)):
        pair.submit(lambda: None).result()
    assert pair.submit(calls.environment, "OPENBLAS_NUM_THREADS").result() == "1"


def test_a_killed_worker_is_replaced_and_its_call_tried_again(pair, tmp_path, pipe):
    def kill() -> None:
        with heard(pipe) as reports:
            os.kill(int(reports.readline()), signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    outcomes = {
        number: future.result()
        for (_, number), future in as_done(pair, calls.stay_at_first, [(tmp_path, k) for k in range(5)])
    }
    killer.join()
    assert outcomes == dict.fromkeys(range(5), "done")


def test_what_kills_every_worker_fails_alone_and_is_tried_alone(pair, tmp_path):
    diary = tmp_path / "diary"
    names = ["a", "b", "poison", "c", "d", "e", "f"]
    tasks = [(diary, name) for name in names]
    outcomes = {name: future.exception() for (_, name), future in as_done(pair, calls.die_or_note, tasks)}
    death = outcomes.pop("poison")
    assert isinstance(death, WorkerDiedError)
    assert "SIGKILL" in str(death)
    assert outcomes == dict.fromkeys("abcdef")
    lines = diary.read_text().splitlines()
    assert lines.count("poison begins") == 2
    assert lines[-2:] == ["poison begins", "poison ends"], "the second time when all others are done"


def test_a_log_that_kills_its_worker_costs_the_folder_only_itself(pair, tmp_path, monkeypatch):
    monkeypatch.setattr(job, "run", flown.run)
    monkeypatch.setattr(crafts, "identify_craft", flown.identify_craft)
    (tmp_path / "logs").mkdir()
    for name in ("octa 1", "kill", "octa 2", "quad 3"):
        (tmp_path / "logs" / f"{name.replace(' ', '')}.bin").write_text(name)
    for reused in (0, 3):  # it is tried again by the next run: there may be more memory then
        fleet = analyze_fleet([tmp_path / "logs"], AnalysisConfig(), pair, store=tmp_path / "out")
        assert [flight.name for flight in fleet.flights] == ["octa1", "octa2", "quad3"]
        assert fleet.reused == reused
        (failure,) = fleet.failures
        assert failure.file == "kill.bin"
        assert failure.reason.startswith("the process that worked on it was killed (SIGKILL), as the system does when")


PROGRAM = """
import sys
from pathlib import Path
from pipeline.execution.executors import Processes, as_done
from tests.pipeline import calls
if __name__ == "__main__":
    with Processes(2) as pool:
        for _, future in as_done(pool, calls.stay, [Path(sys.argv[1])] * 5):
            future.result()
"""


@pytest.mark.parametrize("ended_by", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_workers_end_at_once_with_whoever_started_them(ended_by, tmp_path, pipe, short_folder):
    scratch = short_folder
    program_file = tmp_path / "program.py"
    program_file.write_text(PROGRAM)
    program = subprocess.Popen(
        [sys.executable, program_file, pipe],
        env=os.environ | {"PYTHONPATH": str(ROOT), "TMPDIR": str(scratch)},
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    with heard(pipe, program) as reports:
        reports.readline()
        reports.readline()
        if ended_by == signal.SIGINT:  # a terminal sends it to all of them
            os.killpg(program.pid, ended_by)
        else:
            program.send_signal(ended_by)
        assert reports.read() == ""  # comes when the last worker is gone; three calls never began
    _, errors = program.communicate()
    assert program.returncode == -ended_by
    assert not [path for path in scratch.iterdir() if path.name.startswith("rotorid-")]
    if ended_by == signal.SIGINT:
        assert errors.count(b"Traceback") == 1
        assert errors.rstrip().endswith(b"KeyboardInterrupt")


def test_temporary_files_of_a_killed_worker_go_too(pair, tmp_path, pipe):
    assert Path(pair.submit(tempfile.gettempdir).result()).is_relative_to(tempfile.gettempdir())
    lost = pair.submit(calls.stay, pipe)
    with heard(pipe) as reports:
        worker = int(reports.readline())
        folder = pair.submit(tempfile.mkdtemp).result()
        assert Path(folder).is_dir()
        os.kill(worker, signal.SIGKILL)
    assert isinstance(lost.exception(), WorkerDiedError)
    pair.shutdown()
    assert not Path(folder).exists()


def test_no_more_tasks_are_in_flight_than_keep_the_workers_busy():
    class Counting(ThreadPoolExecutor):
        in_flight = 3
        submitted = 0

        def submit(self, *args, **named):
            self.submitted += 1
            return super().submit(*args, **named)

    taken = 0

    def tasks():
        nonlocal taken
        for number in range(20):
            taken += 1
            yield number

    with Counting(2) as pool:
        done = {}
        for task, future in as_done(pool, calls.square, tasks()):
            done[task] = future.result()
            assert taken <= len(done) + 3
    assert done == {number: number**2 for number in range(20)}


def test_an_executor_that_breaks_fails_tasks_and_not_the_loop():
    class Broken(ThreadPoolExecutor):
        def submit(self, *_, **__):
            raise BrokenExecutor("killed")

    with Broken(1) as pool:
        outcomes = [future.exception() for _, future in as_done(pool, calls.square, range(100))]
    assert len(outcomes) == 100
    assert all(isinstance(outcome, BrokenExecutor) for outcome in outcomes)


@pytest.mark.parametrize(
    ("sizes", "memory_gb", "cores", "count"),
    [
        ([10_000_000] * 200, 64.0, 16, 16),  # as many as there are processors
        ([10_000_000] * 3, 64.0, 16, 3),  # no more than there are logs
        ([10_000_000] * 200, 2.5, 16, 4),  # 0.49 GB each of 2 GB
        ([2_000_000_000] + [10_000_000] * 200, 16.0, 16, 9),  # 8.45 GB for one, 0.49 GB for each of the others
        ([2_000_000_000] * 2, 4.0, 8, 1),  # one is tried in any case
        ([], 4.0, 8, 1),
    ],
)
def test_workers_are_counted_by_processors_and_memory(sizes, memory_gb, cores, count):
    assert count_workers(sizes, int(memory_gb * 1e9), cores) == count
