"""One long flight from log to report: CPU of every stage, peak memory, and what compiling costs a fresh machine.

The log is made by the simulator: 20 min of an octocopter, inertial sensors and rate loop logged at 400 Hz, which comes
to more than 60 MB. Each measurement is a process of its own. For time and memory it first analyses a short log, so that
imports and compiled code are there, and then the long one: CPU time is that of the process, memory is the peak above
what it held before. For the cold run the cache of compiled code is an empty folder.
"""

import dataclasses
import gc
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pipeline.execution.compiling import compile_missing

ROOT = Path(__file__).parents[1]
SHORT = ROOT / "sample_logs" / "octa01_zurich_calm.bin"
SITL = ROOT.parent / "shared" / "logs" / "sitl"

Row = tuple[str, str, str, str, str]


def write_long_log(
    folder: Path, minutes: float = 20.0, *, like: str = "octa06_reykjavik_windy", hover: float = 0.0
) -> Path:
    """Fly an octocopter between random points for so long, and write its log.

    Parameters
    ----------
    folder : Path
    minutes : float
    like : str
        Sample flight whose craft, place and weather it has.
    hover : float
        Seconds over the place of take-off before and after, at the same height; 0 for none.
    """
    import numpy as np

    from simulation import FLIGHTS
    from simulation.flight_log import Logging
    from simulation.drive import Battery
    from simulation.mission import GoTo, Mission, Wait
    from simulation.sample_logs import write_flight

    random = np.random.default_rng(20)
    steps: list[GoTo | Wait] = []
    # A leg takes about 13 s: 20 m at up to 4 m/s with its ends, then a wait.
    for _ in range(round(minutes * 60.0 / 13.0)):
        north, east = random.uniform(-20.0, 20.0, 2)
        steps += [GoTo(float(north), float(east), float(random.uniform(5.0, 16.0)), 4.0), Wait(2.0)]
    if hover:
        steps = [GoTo(0.0, 0.0, 10.0), Wait(hover), *steps, GoTo(0.0, 0.0, 10.0), Wait(hover)]
    sample = FLIGHTS[like]
    vehicle = dataclasses.replace(sample.setup.vehicle, battery=Battery(capacity=25.0))
    setup = dataclasses.replace(sample.setup, vehicle=vehicle, mission=Mission(takeoff=7.0, steps=tuple(steps)))
    sample = dataclasses.replace(
        sample, name="long", setup=setup, logging=Logging(imu=400.0, rate=400.0), telemetry=False
    )
    return write_flight(sample, folder)[0]


def memory(kind: str) -> float:
    """Bytes of this process in memory: now (VmRSS) or at most so far (VmHWM)."""
    status = Path("/proc/self/status").read_text()
    return 1024.0 * int(status.split(kind + ":")[1].split()[0])


def forget_peak() -> None:
    """Reset VmHWM to what is in memory now."""
    Path("/proc/self/clear_refs").write_text("5")


def analyse(path: Path, folder: Path, progress: Callable[[str, float], None] | None = None) -> None:
    """Do all stages of one log, and the report."""
    import pipeline
    import reports

    result = pipeline.analyze(path, progress=progress)
    if progress is not None:
        progress("report", 0.0)
    reports.write(result, folder)
    if progress is not None:
        progress("report", 1.0)


def measure(path: Path, stages: bool = False) -> dict[str, object]:
    """Run in a process of its own: CPU s of the stages, memory before and at most, bytes.

    With `stages` also the peak within each stage, bytes above the beginning.
    """
    with tempfile.TemporaryDirectory() as folder:
        analyse(SHORT, Path(folder) / "short")
        gc.collect()
        forget_peak()
        before = memory("VmRSS")
        cpu: dict[str, float] = {}
        peaks: dict[str, float] = {}
        held: dict[str, float] = {}
        running = ["read", time.process_time()]

        def follow(name: str, fraction: float) -> None:
            if fraction not in (0.0, 1.0):
                return
            now = time.process_time()
            last = str(running[0])
            cpu[last] = cpu.get(last, 0.0) + now - float(running[1])
            if stages:
                peaks[last] = max(peaks.get(last, 0.0), memory("VmHWM") - before)
                held[last] = memory("VmRSS") - before
                forget_peak()
            running[:] = name, now

        begun = time.process_time()
        analyse(path, Path(folder) / "long", follow)
        total = time.process_time() - begun
        peak = memory("VmHWM")
        page = (Path(folder) / "long" / "report.html").stat().st_size
    return {"cpu": cpu, "total": total, "before": before, "peak": peak, "page": page, "peaks": peaks, "held": held}


def cold() -> dict[str, float]:
    """Compile what an analysis needs, in a process of its own that has no compiled code: s of CPU and by the clock."""
    clock, cpu = time.perf_counter(), _cpu_with_children()
    compile_missing()
    return {"cpu": _cpu_with_children() - cpu, "clock": time.perf_counter() - clock}


def _cpu_with_children() -> float:
    used = [resource.getrusage(whose) for whose in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


def help_seconds(passes: int = 7) -> float:
    """Least CPU time of ``rotorid --help``."""
    spent = []
    for _ in range(passes):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(
            [sys.executable, "-c", "from rotorid.cli.main import main; main()", "--help"],
            check=True,
            cwd=ROOT,
            stdout=subprocess.DEVNULL,
        )
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        spent.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return min(spent)


def in_process(*arguments: object, **environment: str) -> dict[str, Any]:
    """Run one measurement in a fresh process."""
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.flight", *map(str, arguments)],
        capture_output=True,
        text=True,
        check=True,
        cwd=ROOT,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"} | environment,
    )
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def _rows(label: str, path: Path, targets: bool) -> list[Row]:
    size = path.stat().st_size
    found = in_process("measure", path)
    rows = [
        (
            f"{label}, {size / 1e6:.0f} MB, all stages, CPU",
            f"{found['total']:.1f} s",
            "-",
            "-",
            "< 6 s" * targets or "-",
        )
    ]
    if targets:
        rows += [
            (f"... {stage}", f"{seconds:.2f} s", "-", "-", "-")
            for stage, seconds in sorted(found["cpu"].items(), key=lambda item: -item[1])
            if seconds >= 0.05
        ]
    growth = found["peak"] - found["before"]
    return [
        *rows,
        (
            "... memory beyond the imported process, over file",
            f"{growth / size:.2f}",
            "-",
            "-",
            "< 1.3" * targets or "-",
        ),
        ("... most memory of the process", f"{found['peak'] / 1e6:.0f} MB", "-", "-", "-"),
        ("... report.html", f"{found['page'] / 1e6:.1f} MB", "-", "-", "-"),
    ]


def run() -> list[Row]:
    with tempfile.TemporaryDirectory() as folder:
        rows = _rows("20 min octocopter", write_long_log(Path(folder)), targets=True)
        compiled = in_process("cold", NUMBA_CACHE_DIR=str(Path(folder) / "cache"))
    for path in sorted(SITL.glob("*.BIN"), key=lambda path: -path.stat().st_size)[:3]:
        rows += _rows(path.stem, path, targets=False)
    return [
        *rows,
        ("first analysis on a fresh machine, compiling by the clock", f"{compiled['clock']:.1f} s", "-", "-", "< 10 s"),
        ("... CPU of both processes", f"{compiled['cpu']:.1f} s", "-", "-", "< 10 s"),
        ("rotorid --help, CPU", f"{help_seconds():.2f} s", "-", "-", "< 0.3 s"),
    ]


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["make", folder]:
            print(write_long_log(Path(folder)))
        case ["measure", path]:
            print(json.dumps(measure(Path(path))))
        case ["stages", path]:
            print(json.dumps(measure(Path(path), stages=True), indent=1))
        case ["cold"]:
            print(json.dumps(cold()))
