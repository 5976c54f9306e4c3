"""One long flight from log to report: CPU of every stage, peak memory, and what compiling costs a fresh machine.

The log is made by the simulator: 20 min of an octocopter, inertial sensors and rate loop logged at 400 Hz, which comes
to more than 60 MB. Each measurement is a process of its own. For time and memory it first analyses a short log, so that
imports and compiled code are there, and then the long one: CPU time is that of the process, memory is the peak above
what it held before. For the cold run the cache of compiled code is an empty folder.
"""

import gc
import json
import resource
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from benchmarks._measure import (
    SAMPLES,
    Row,
    command_cpu,
    forget_peak,
    in_process,
    memory,
    row,
    used,
    wandering_flight,
)
from pipeline.execution.compiling import compile_missing

SHORT = SAMPLES / "octa01_zurich_calm.bin"
BOTH = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)


def write_long_log(folder: Path, like: str = "octa06_reykjavik_windy", hover: float = 0.0) -> Path:
    """Fly an octocopter between random points for 20 min, and write its log; `hover` as for `wandering_flight`."""
    from simulation.sample_logs import write_flight

    return write_flight(wandering_flight("long", 20.0, 20, like, hover=hover, capacity=25.0), folder)[0]


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


def measure(path: Path) -> dict[str, object]:
    """Run in a process of its own: CPU s of the stages, memory before and at most, bytes."""
    with tempfile.TemporaryDirectory() as folder:
        analyse(SHORT, Path(folder) / "short")
        gc.collect()
        forget_peak()
        before = memory("VmRSS")
        cpu: dict[str, float] = {}
        running = ["read", time.process_time()]

        def follow(name: str, fraction: float) -> None:
            if fraction not in (0.0, 1.0):
                return
            now = time.process_time()
            last = str(running[0])
            cpu[last] = cpu.get(last, 0.0) + now - float(running[1])
            running[:] = name, now

        begun = time.process_time()
        analyse(path, Path(folder) / "long", follow)
        total = time.process_time() - begun
        peak = memory("VmHWM")
        page = (Path(folder) / "long" / "report.html").stat().st_size
    return {"cpu": cpu, "total": total, "before": before, "peak": peak, "page": page}


def cold() -> dict[str, float]:
    """Compile what an analysis needs, in a process of its own that has no compiled code: s of CPU and by the clock."""
    clock, cpu = time.perf_counter(), used(*BOTH)
    compile_missing()
    return {"cpu": used(*BOTH) - cpu, "clock": time.perf_counter() - clock}


def rows_of(label: str, path: Path, seconds: str, over_file: str) -> list[Row]:
    """Measure the analysis of a log, with goals of its CPU time and of its memory over the file."""
    size = path.stat().st_size
    measured = in_process("flight", "measure", path)
    growth = (measured["peak"] - measured["before"]) / size
    slow = sorted(measured["cpu"].items(), key=lambda item: -item[1])
    return [
        row(f"{label}, {size / 1e6:.0f} MB, all stages, CPU", f"{measured['total']:.1f} s", goal=seconds),
        *(row(f"... {stage}", f"{spent:.2f} s") for stage, spent in slow if spent >= 0.1 * measured["total"]),
        row("... memory beyond the imported process, over file", f"{growth:.2f}", goal=over_file),
        row("... report.html", f"{measured['page'] / 1e6:.1f} MB"),
    ]


def run() -> list[Row]:
    with tempfile.TemporaryDirectory() as folder:
        rows = rows_of("20 min octocopter", write_long_log(Path(folder)), "< 6 s", "< 1.3")
        compiled = in_process("flight", "cold", NUMBA_CACHE_DIR=str(Path(folder) / "cache"))
    return [
        *rows,
        row("first analysis on a fresh machine, compiling by the clock", f"{compiled['clock']:.1f} s", goal="< 10 s"),
        row("... CPU of both processes", f"{compiled['cpu']:.1f} s", goal="< 10 s"),
        row("rotorid --help, CPU", f"{min(command_cpu('--help') for _ in range(7)):.2f} s", goal="< 0.3 s"),
    ]


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["make", folder]:
            print(write_long_log(Path(folder)))
        case ["measure", path]:
            print(json.dumps(measure(Path(path))))
        case ["cold"]:
            print(json.dumps(cold()))
