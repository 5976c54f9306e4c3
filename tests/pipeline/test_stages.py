"""A stage may fail and the others go on; processors, memory and loops to compile are those of the machine."""

import logging
import os
import subprocess
import sys
import threading
from pathlib import Path

import psutil
import pytest

import estimation
from logparse import FlightLog, MissingDataError, read_log
from pipeline.execution import executors, machine
from pipeline.execution.progress import Clock
from pipeline.execution.stages import STAGES, Overall, Stages, silent
from pipeline.execution.workload import Workload
from pipeline.flight.analysis import analyze
from pipeline.results.failure import Failure
from pipeline.results.span import Span
from tests.paths import ROOT, SAMPLES


def test_a_foreseen_error_becomes_a_reason_and_a_bug_a_finding_and_a_line_in_the_log(caplog):
    stages = Stages(silent, 3600.0)

    def work(_):
        raise MissingDataError("no GPS: set bit 2 of LOG_BITMASK")

    assert stages.run("trajectory", work) == Failure("trajectory", "no GPS: set bit 2 of LOG_BITMASK")
    assert not stages.findings
    assert stages.timings["trajectory"] >= 0.0
    with caplog.at_level(logging.ERROR):
        assert "ZeroDivisionError" in stages.run("model", lambda _: 1 / 0).reason
    assert [finding.id for finding in stages.findings] == ["internal-error"]
    assert "Traceback" in caplog.text


@pytest.mark.parametrize("stage", ["tables", "flights"])
def test_a_bug_in_what_nothing_can_be_done_without_is_not_blamed_on_the_log(stage, monkeypatch):
    """An OverflowError in the reader once said that the log cannot be used."""

    def overflow(_):
        raise OverflowError("cannot convert float infinity to integer")

    monkeypatch.setattr(FlightLog, stage, property(overflow))
    if stage == "flights":
        monkeypatch.setattr(estimation, "estimate", lambda *_, **__: overflow(None))
    with pytest.raises(OverflowError, match="infinity"):
        analyze(sorted(SAMPLES.glob("*.bin"))[0])


def test_a_stage_that_takes_too_long_is_given_up():
    stages = Stages(silent, 0.01)

    def work(report):
        while True:
            report("fit", 0.5)

    assert "--time-limit" in stages.run("model", work).reason


@pytest.mark.parametrize("pace", [0.5, 1.0, 4.0])
@pytest.mark.parametrize("wrong", [0.5, 1.0, 2.0])
def test_the_share_of_time_is_right_on_slow_and_fast_computers_and_with_a_stage_guessed_wrong(pace, wrong):
    clock, heard = [0.0], []
    report = Overall(lambda title, fraction: heard.append(fraction), loaded=0.7)
    takes = {"read": 0.1, "rotation": 1.0, "trajectory": 1.5 * wrong, "motors": 1.0, "rigid_body": 0.5, "report": 0.3}
    whole = pace * (0.7 + sum(takes.values()))
    shares = []
    for name, seconds in takes.items():
        for step in range(11):
            report(name, 0.1 * step)
            shares.append(0.7 * pace / whole + clock[0] / whole)
            clock[0] += pace * seconds / 10.0 if step < 10 else 0.0
        if name == "read":
            report.expect(takes | {"trajectory": 1.5})
    assert heard == sorted(heard)
    pairs = [(second, share) for second, share in zip(heard, shares, strict=True) if share > 0.2]
    assert all(share / 1.5 < second < share * 1.5 for second, share in pairs)
    assert heard[-1] == pytest.approx(1.0)


def test_what_a_log_lacks_is_not_waited_for():
    log = read_log("sample_logs/octa01_zurich_calm.bin")
    flight = Span(log.flight.start, log.flight.stop)
    seconds = Workload.of(log, flight).seconds()
    assert seconds.keys() <= STAGES.keys()
    assert all(second > 0.0 for second in seconds.values())
    assert "motors" not in Workload.of(log, Span(flight.start, flight.start + 10.0)).seconds()
    assert Workload.of(log, None).seconds().keys() == {"read", "tables", "account", "trajectory", "report"}


def test_the_time_to_go_is_right_for_even_work_whatever_came_before_it():
    clock = Clock()
    clock.reach(0.0, 1.0)
    clock.reach(0.01, 2.0)  # reading the log
    clock.reach(0.0, 3.0)  # compiling
    clock.reach(0.02, 10.0)  # from here on 1 % a second; loading packages took ten
    for k in range(1, 98):
        clock.reach(0.02 + 0.01 * k, 10.0 + k)
        left = clock.left(10.0 + k)
        assert left == pytest.approx(98.0 - k, abs=1e-6) if k >= 10 else left == 0.0
    # It counts down while nothing new is heard, also where a stage is reported again.
    clock.reach(0.5, 108.5)
    assert clock.left(107.5) == pytest.approx(0.5, abs=1e-6)
    assert clock.left(200.0) == 0.0


# Work on a second processor: the same result, whatever becomes of the process that does it.


def test_what_a_copy_finds_comes_back() -> None:
    result = executors.begin(lambda: (os.getpid(), b"x" * 1_000_000))
    pid, made = result()
    assert len(made) == 1_000_000
    assert (pid != os.getpid()) == (executors.processors() > 1)


def test_what_a_copy_that_dies_or_waits_for_ever_does_not_bring_is_made_when_it_is_asked_for() -> None:
    here = os.getpid()

    def dies_in_the_copy() -> str:
        if os.getpid() != here:
            os._exit(9)
        return "done"

    assert executors.begin(dies_in_the_copy)() == "done"
    lock = threading.Lock()
    lock.acquire()

    def waits_in_the_copy() -> str:
        if os.getpid() != here:
            lock.acquire()
        return "done"

    assert executors.begin(waits_in_the_copy, longest=0.1)() == "done"


def test_an_error_of_the_work_is_raised_here() -> None:
    def fails() -> None:
        raise ValueError("of the work")

    result = executors.begin(fails)
    with pytest.raises(ValueError, match="of the work"):
        result()


# Processors and memory of a container are those of its control groups, of both versions, and not the computer's.


V1 = "sys/fs/cgroup/memory/memory."
#: Files of control groups, and the processors and bytes that they leave.
GROUPS = {
    "version 2 takes the tightest limit of all levels": (
        {
            "proc/self/cgroup": "0::/slice/job",
            "sys/fs/cgroup/slice/cpu.max": "350000 100000",
            "sys/fs/cgroup/slice/memory.max": "max",
            "sys/fs/cgroup/slice/memory.current": "7000000000",
            "sys/fs/cgroup/slice/job/cpu.max": "max 100000",
            "sys/fs/cgroup/slice/job/memory.max": "8000000000",
            "sys/fs/cgroup/slice/job/memory.current": "7000000000",
            "sys/fs/cgroup/slice/job/memory.stat": "anon 1000000000\ninactive_file 5500000000",
        },
        (3, 6_500_000_000),
    ),
    "version 1 inside a container whose path is the host's": (
        {
            "proc/self/cgroup": "4:memory:/docker/5f0c\n2:cpu,cpuacct:/docker/5f0c",
            "sys/fs/cgroup/cpu/cpu.cfs_quota_us": "200000",
            "sys/fs/cgroup/cpu/cpu.cfs_period_us": "100000",
            f"{V1}limit_in_bytes": "4000000000",
            f"{V1}usage_in_bytes": "1000000000",
            f"{V1}stat": "total_inactive_file 200000000",
        },
        (2, 3_200_000_000),
    ),
    "no limit": (
        {
            "proc/self/cgroup": "4:memory:/\n2:cpu,cpuacct:/",
            "sys/fs/cgroup/cpu/cpu.cfs_quota_us": "-1",
            "sys/fs/cgroup/cpu/cpu.cfs_period_us": "100000",
            f"{V1}limit_in_bytes": "9223372036854771712",
            f"{V1}usage_in_bytes": "1000000000",
        },
        (64, 256_000_000_000),
    ),
}


@pytest.mark.parametrize("case", GROUPS)
def test_limits_of_control_groups_count(case, monkeypatch, tmp_path):
    """Of a computer with 64 processors and 256 GB."""
    monkeypatch.setattr("os.sched_getaffinity", lambda _: set(range(64)), raising=False)
    monkeypatch.setattr(psutil, "virtual_memory", lambda: type("", (), {"available": 256_000_000_000}))
    files, left = GROUPS[case]
    for name, content in files.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"{content}\n")
    assert (machine.processors(tmp_path), machine.available_memory(tmp_path)) == left


# Compiled loops that a machine lacks are compiled once, side by side; which those are: tests/rotorid/test_start.


MODULE = """
from core.compiled import njit
from core.kernel_types import Vector

@njit(cache=True)
def total(values: Vector, start: float) -> float:
    for value in values:
        start += value
    return start

@njit(cache=True)
def most(values: Vector) -> float:
    return max(values)

@njit(cache=True)
def broken(values: Vector) -> float:
    return values.no_such_thing
"""

COMPILE = """
import resource, sys
import numpy as np
from loops import broken, most, total
from core.compiled import is_kept
from pipeline.execution.compiling import compile_missing

heard = []
compile_missing(lambda stage, fraction: heard.append(stage), (total, broken, most))
print(len(heard), is_kept(total), is_kept(most), total(np.ones(3), 1.0), most(np.ones(3)))
"""


def _run(script: str, **environment: str) -> list[str]:
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env={**os.environ, **environment})
    return done.stdout.split()


def test_loops_that_a_machine_has_not_compiled_are_compiled_once(tmp_path: Path) -> None:
    """What cannot be compiled is passed over: its call will say why."""
    (tmp_path / "loops.py").write_text(MODULE)
    place = {"PYTHONPATH": f"{tmp_path}:{ROOT}", "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    assert _run(COMPILE, **place) == ["1", "True", "True", "4.0", "1.0"]
    files = sorted(tmp_path.rglob("*.nbc"))
    assert len(files) == 2
    assert _run(COMPILE.replace("broken, most)", "most)"), **place) == ["0", "True", "True", "4.0", "1.0"]
    assert sorted(tmp_path.rglob("*.nbc")) == files
