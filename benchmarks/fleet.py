"""A folder of logs of 10 MB with one worker and with two: time, memory of a worker, cost by stage, and a second run.

`python -m benchmarks.fleet --logs 200` for as many logs as the goal names; a few by default. The logs are made by the
simulator: octocopters that fly between random points of their own at one of six places, inertial sensors and rate loop
logged at 400 Hz.
Every run is a process of its own, with what every worker does once (loading compiled code) done before on a short log.

The ratio of run times needs an idle computer. The ratio of CPU times per log does not: it tells what two workers cost
each other and, with the coordinator's own CPU time, how far more of them would be kept busy.
"""

import argparse
import json
import shutil
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from concurrent.futures import Executor, Future
from datetime import timedelta
from pathlib import Path
from typing import Any

from benchmarks._measure import (
    SAMPLES,
    Row,
    command_cpu,
    forget_peak,
    in_process,
    listed,
    memory,
    row,
    wandering_flight,
)

SHORT = SAMPLES / "octa01_zurich_calm.bin"

#: Logs of a run that is one of many benchmarks.
FEW = 4

#: Flight time that makes 10 MB at these rates, min.
MINUTES = 2.6


def write_log(folder: Path, number: int, minutes: float = MINUTES) -> Path:
    """Fly the log of a number; another number is another flight."""
    from simulation import FLIGHTS
    from simulation.sample_logs import write_flight

    like = [name for name in FLIGHTS if name.startswith("octa")][number % 6]
    # On a day of its own, lest it count as another recording of a flight at the same time and place.
    day = FLIGHTS[like].start_utc + timedelta(days=number)
    path, truth, *_ = write_flight(
        wandering_flight(f"flight{number:03d}", minutes, number, like, start_utc=day), folder
    )
    truth.unlink()
    return path


class Measuring(Executor):
    """Another executor, and what each of its calls cost."""

    def __init__(self, inner: Any) -> None:
        self._inner = inner
        self.in_flight = inner.in_flight
        self.costs: list[dict[str, Any]] = []

    def submit(self, function: Callable[..., Any], /, *args: Any, **named: Any) -> Future[Any]:
        """Make a function called there."""
        outcome: Future[Any] = Future()

        def unwrap(done: Future[Any]) -> None:
            if done.exception() is not None:
                outcome.set_exception(done.exception())
                return
            cost, result = done.result()
            self.costs.append(cost)
            outcome.set_result(result)

        self._inner.submit(measured, function, args, named).add_done_callback(unwrap)
        return outcome


def measured(function: Callable[..., Any], args: tuple[Any, ...], named: dict[str, Any]) -> tuple[dict[str, Any], Any]:
    """Call a function in a worker and measure what it costs."""
    before = memory("VmRSS")
    forget_peak()
    cpu = time.process_time()
    result = function(*args, **named)
    cost = {
        "what": function.__name__,
        "cpu": time.process_time() - cpu,
        "before": before,
        "peak": memory("VmHWM"),
    }
    return cost, result


def run_once(count: int, logs: Path, out: Path) -> dict[str, Any]:
    """Analyse a folder with so many workers; in a process of its own."""
    import pipeline
    import reports
    from pipeline.execution.executors import Processes
    from pipeline.flight.analysis import analyze
    from rotorid.cli.analyze import PRELOAD

    with Processes(count, PRELOAD) as processes:
        for first in [processes.submit(measured, analyze, (SHORT,), {}) for _ in range(count)]:
            first.result()
        executor = Measuring(processes)
        cpu = time.process_time()
        fleet = pipeline.analyze_fleet([logs], executor=executor, store=out, publish=reports.publish)
        reports.write_fleet(fleet)
        fleet.confirm_report()
        cpu = time.process_time() - cpu
    analyses = [cost for cost in executor.costs if cost["what"] == "run"]
    stages: dict[str, float] = defaultdict(float)
    for flight in fleet.flights:
        for stage, spent in fleet.store.read_json(f"flights/{flight.folder}/report.json")["timings_s"].items():
            stages[stage] += spent / len(fleet.flights)
    return {
        "flown": sum(flight.flight.duration for flight in fleet.flights if flight.flight) / 60.0,
        "logs_seconds": fleet.timings["logs"],
        "cpu_coordinator": cpu,
        "cpu_logs": sum(cost["cpu"] for cost in analyses),
        "peak": max(cost["peak"] for cost in analyses),
        "base": min(cost["before"] for cost in analyses),
        "peak_coordinator": memory("VmHWM"),
        "stages": stages,
    }


def measure(count: int, folder: Path) -> list[Row]:
    """Measure everything with so many logs."""
    logs, out = folder / "logs", folder / "out2"
    megabytes = sum(write_log(logs, number).stat().st_size for number in range(count)) / 1e6
    one, two = (in_process("fleet", "--run", workers, folder) for workers in (1, 2))
    began = time.perf_counter()
    again = command_cpu("analyze", str(logs), "--out", str(out))
    seconds = time.perf_counter() - began
    serial = two["cpu_coordinator"]
    ideal = (serial + one["cpu_logs"]) / (serial + two["cpu_logs"] / 2.0) / 2.0
    clocks = one["logs_seconds"], two["logs_seconds"]
    stages = ", ".join(f"{name} {spent:.1f}" for name, spent in one["stages"].items() if spent >= 0.05)
    each = one["cpu_logs"]
    return [
        row(f"{count} logs of {megabytes / count:.0f} MB, 1 / 2 workers, s", f"{clocks[0]:.0f} / {clocks[1]:.0f}"),
        row("of the ideal from 1 to 2 workers, by the clock", clocks[0] / clocks[1] / 2.0, goal=">= 0.9"),
        row("the same by CPU time, with the coordinator's", ideal, goal=">= 0.9"),
        row("CPU per log / MB / minute flown, s", listed((each / count, each / megabytes, each / one["flown"]))),
        row("coordinator: CPU per log, s", serial / count),
        row("a worker's memory, before / at most, MB", f"{one['base'] / 1e6:.0f} / {one['peak'] / 1e6:.0f}"),
        row("coordinator's memory at most, MB", one["peak_coordinator"] / 1e6),
        row("stages of a log, s", stages),
        row("unchanged second run, s / CPU s", f"{seconds:.1f} / {again:.2f}", goal="< 2"),
    ]


def run(count: int = FEW) -> list[Row]:
    """Measure, for the table of all benchmarks."""
    folder = Path(tempfile.mkdtemp(prefix="rotorid-fleet-"))
    try:
        return measure(count, folder)
    finally:
        shutil.rmtree(folder)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--logs", type=int, default=FEW)
    parser.add_argument("--run", nargs=2, metavar=("WORKERS", "FOLDER"), help="one run, for the other's use")
    arguments = parser.parse_args()
    if arguments.run:
        workers, place = int(arguments.run[0]), Path(arguments.run[1])
        print(json.dumps(run_once(workers, place / "logs", place / f"out{workers}")))
    else:
        for what, ours, *_, goal in run(arguments.logs):
            print(f"{what:55} {ours} {goal}")
