"""What the benchmarks share: rows of the table, times and memory, processes of their own, logs from ../shared."""

import json
import lzma
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from estimation import Trajectory
    from logparse import FlightLog

ROOT = Path(__file__).parents[1]
SHARED = ROOT.parent / "shared"
LOGS = SHARED / "logs"
SITL = LOGS / "sitl"
SAMPLES = ROOT / "sample_logs"

#: The firmware craft of ../shared/logs/pairs.
CRAFT = ("quad15", "octa3", "octa8", "hexa3", "y6high", "quadslow")

#: What was measured, ours, the peer's, how many times faster or smaller ours is, and the goal.
Row = tuple[str, str, str, str, str]


def row(what: str, ours: object, peer: object = "-", ratio: object = "-", goal: str = "-") -> Row:
    """Return a row; numbers are written with three digits."""
    return what, text(ours), text(peer), text(ratio), goal


def text(cell: object) -> str:
    """Return a cell of a row as text."""
    return f"{cell:.3g}" if isinstance(cell, float) else str(cell)


def listed(values: Iterable[float], form: str = ".2f") -> str:
    """Return numbers with commas between them."""
    return ", ".join(f"{value:{form}}" for value in values)


def cpu(work: Callable[[], object], passes: int = 1, *, warm: bool = False) -> float:
    """Return the least CPU time of a few calls, s; a first one that does not count compiles where `warm`."""
    if warm:
        work()
    best = np.inf
    for _ in range(passes):
        begun = time.process_time()
        work()
        best = min(best, time.process_time() - begun)
    return float(best)


def timed(work: Callable[[], Any]) -> tuple[Any, float]:
    """Return what a call returns, and its CPU time, s."""
    begun = time.process_time()
    return work(), time.process_time() - begun


def copy_speed(size: int = 100_000_000) -> float:
    """Return the speed of copying memory, MB/s."""
    source = np.ones(size, np.uint8)
    target = np.ones_like(source)
    return size / 1e6 / cpu(lambda: np.copyto(target, source), 5)


def memory(kind: str, pid: int | str = "self") -> float:
    """Return bytes of a process in memory: now (VmRSS) or at most so far (VmHWM)."""
    status = Path(f"/proc/{pid}/status").read_text()
    return 1024.0 * int(status.split(kind + ":")[1].split()[0])


def forget_peak(pid: int | str = "self") -> None:
    """Reset VmHWM to what is in memory now."""
    Path(f"/proc/{pid}/clear_refs").write_text("5")


def used(*whose: int) -> float:
    """Return the CPU time so far of RUSAGE_SELF, RUSAGE_CHILDREN or both, s."""
    spent = [resource.getrusage(process) for process in whose]
    return sum(usage.ru_utime + usage.ru_stime for usage in spent)


def command_cpu(*arguments: str) -> float:
    """Return the CPU time of a `rotorid` command, imports included, s."""
    command = [sys.executable, "-c", "from rotorid.cli.main import main; main()", *arguments]
    before = used(resource.RUSAGE_CHILDREN)
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    subprocess.run(command, check=True, cwd=ROOT, capture_output=True, env=environment)
    return used(resource.RUSAGE_CHILDREN) - before


def in_process(module: str, *arguments: object, **environment: str) -> dict[str, Any] | None:
    """Run a benchmark's own program in a process of its own, and read what it prints; None where a peer is missing."""
    done = subprocess.run(
        [sys.executable, "-m", f"benchmarks.{module}", *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        cwd=ROOT,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"} | environment,
    )
    if done.returncode:
        if "ModuleNotFoundError" in done.stderr:
            return None
        raise RuntimeError(done.stderr)
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer


def unpacked(path: Path, scratch: Path) -> Path:
    """Return a log as it is, or unpacked into a folder where it is packed."""
    if path.suffix != ".xz":
        return path
    plain = scratch / path.stem
    if not plain.exists():
        plain.write_bytes(lzma.decompress(path.read_bytes()))
    return plain


def logs(*patterns: str) -> Iterator[tuple[Path, Path]]:
    """Yield the logs below ../shared/logs as they lie there, and where they can be read."""
    with tempfile.TemporaryDirectory() as scratch:
        for path in sorted(path for pattern in patterns for path in LOGS.glob(pattern)):
            yield path, unpacked(path, Path(scratch))


def readable(*patterns: str) -> "Iterator[tuple[Path, FlightLog]]":
    """Yield the logs below ../shared/logs that are flight logs and can be read."""
    from logparse import RotoridError, read_log

    for packed, path in logs(*patterns):
        if path.suffix not in (".tsv", ".md", ".json"):
            with suppress(RotoridError):
                yield packed, read_log(path)


@cache
def sitl_flight(name: str) -> "tuple[FlightLog, Trajectory]":
    """Return a log of ../shared/logs/sitl and its trajectory."""
    from estimation import estimate
    from logparse import read_log

    log = read_log(SITL / f"{name}.BIN")
    return log, estimate(log.tables)


def rms(values: Iterable[float]) -> float:
    """Return the root mean square of the values that are numbers; NaN where there are none."""
    known = [value for value in values if not np.isnan(value)]
    return float(np.sqrt(np.mean(np.square(known)))) if known else float("nan")


def wandering_flight(name: str, minutes: float, seed: int, like: str, **changes: Any) -> Any:
    """Return an octocopter's flight between random points for so long, IMU and rate loop logged at 400 Hz.

    It has the craft, place and weather of the sample flight `like`. `hover` are seconds over the place of take-off
    before and after, at the same height; `capacity` is that of the battery, A h; other changes are of the flight.
    """
    from dataclasses import replace

    from simulation import FLIGHTS
    from simulation.drive import Battery
    from simulation.flight_log import Logging
    from simulation.mission import GoTo, Mission, Wait

    random = np.random.default_rng(seed)
    steps: list[GoTo | Wait] = []
    # A leg takes about 13 s: 20 m at up to 4 m/s with its ends, then a wait.
    for _ in range(round(minutes * 60.0 / 13.0)):
        north, east = random.uniform(-20.0, 20.0, 2)
        steps += [GoTo(float(north), float(east), float(random.uniform(5.0, 16.0)), 4.0), Wait(2.0)]
    if hover := changes.pop("hover", 0.0):
        steps = [GoTo(0.0, 0.0, 10.0), Wait(hover), *steps, GoTo(0.0, 0.0, 10.0), Wait(hover)]
    sample = FLIGHTS[like]
    vehicle = sample.setup.vehicle
    if capacity := changes.pop("capacity", 0.0):
        vehicle = replace(vehicle, battery=Battery(capacity=capacity))
    setup = replace(sample.setup, vehicle=vehicle, mission=Mission(takeoff=7.0, steps=tuple(steps)))
    logging = Logging(imu=400.0, rate=400.0)
    return replace(sample, name=name, setup=setup, logging=logging, telemetry=False, **changes)


def read_timed(read: Callable[[str], object], path: str, small: str, passes: int) -> dict[str, Any]:
    """Read a log after a small one: least CPU time [s], what the first pass adds to memory [bytes], what was read."""
    read(small)
    before = memory("VmRSS")
    best, peak, result = np.inf, 0.0, None
    for k in range(passes):
        begun = time.process_time()
        result = read(path)
        best = min(best, time.process_time() - begun)
        if k == 0:
            peak = memory("VmHWM") - before
    return {"cpu": best, "peak": peak, "read": result if isinstance(result, tuple) else None}
