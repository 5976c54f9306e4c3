"""A folder of logs of 10 MB with one worker and with two, and a second run in which nothing has changed.

`python -m benchmarks.fleet --logs 200` for as many logs as the goal names; a few by default. The logs are made by the
simulator: octocopters that fly between random points of their own at one of six places, inertial sensors and rate loop
logged at 400 Hz. The ratio of run times needs an idle computer.
"""

import argparse
import tempfile
import time
from datetime import timedelta
from pathlib import Path

from benchmarks._measure import Row, command_cpu, row, wandering_flight

#: Logs of a run that is one of many benchmarks, and the flight time that makes 10 MB at these rates, min.
FEW, MINUTES = 4, 2.6


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


def analysed(logs: Path, out: Path, jobs: int) -> float:
    """Analyse a folder with so many workers; seconds by the clock."""
    began = time.perf_counter()
    command_cpu("analyze", str(logs), "--out", str(out), "--jobs", str(jobs))
    return time.perf_counter() - began


def run(count: int = FEW) -> list[Row]:
    """Measure with so many logs."""
    with tempfile.TemporaryDirectory(prefix="rotorid-fleet-") as place:
        logs = Path(place) / "logs"
        megabytes = sum(write_log(logs, number).stat().st_size for number in range(count)) / 1e6
        one, two = (analysed(logs, Path(place) / f"out{jobs}", jobs) for jobs in (1, 2))
        again = analysed(logs, Path(place) / "out2", 2)
    return [
        row(f"{count} logs of {megabytes / count:.0f} MB: 1 / 2 workers, s", f"{one:.0f} / {two:.0f}"),
        row("of the ideal from 1 to 2 workers, by the clock", one / two / 2.0, goal=">= 0.9"),
        row("one worker, s per MB", one / megabytes),
        row("unchanged second run, s", again, goal="< 2"),
    ]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--logs", type=int, default=FEW)
    for what, ours, *_, goal in run(parser.parse_args().logs):
        print(f"{what:55} {ours} {goal}")
