"""Files of a few words that stand for logs, and what stands for their analysis: flights made in milliseconds.

``octa 3`` is the third flight of a craft called octa, ``octa 3 2`` a log of its third and fourth; ``broken``, ``bug``,
``kill`` and ``full`` say what happens.
"""

import dataclasses
import hashlib
import os
import signal
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path

from logparse import LogError
from pipeline import AnalysisConfig, FlightResult, GroupResult, LogFailure
from pipeline.fleet import job
from pipeline.names import flight_name
from pipeline.results.fleet import FlightEntry, Split
from pipeline.results.report import CraftReport
from tests.reports.conftest import made_flight
from tests.reports.made import made

#: Names of the flights that were analysed in this process.
ANALYZED: list[str] = []


def analyze_flights(path: Path, config: AnalysisConfig, progress: object, *, name: str) -> Iterator[FlightResult]:
    """Do as the file says."""
    content = path.read_bytes()
    word, *numbers = content.decode().split(" ")
    if word == "broken":
        raise LogError(f"{path.name} is broken")
    if word == "bug":
        raise ZeroDivisionError("division by zero")
    if word == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    first, count = int(numbers[0]), int(numbers[1]) if len(numbers) > 1 else 1
    for number in range(1, count + 1):
        called = flight_name(name, number, count)
        ANALYZED.append(called)
        made = made_flight(called, seed=first + number - 1, fit=False)
        log = dataclasses.replace(
            made.log,
            file=path.name,
            bytes=len(content),
            sha256=hashlib.sha256(content).hexdigest(),
            start_utc=(made.log.started + timedelta(days=first + number - 1)).isoformat(),
            flight_number=number,
            flight_count=count,
        )
        yield dataclasses.replace(made, log=log, craft=word, config=config)


def run(work: job.Job) -> tuple[FlightEntry, ...] | LogFailure | None:
    """Do a job with such files, in another process."""
    job.analyze_flights = analyze_flights
    return job.run(work)


def identify_craft(name: str, flights: object, split: Split, *_: object) -> GroupResult:
    """Stand for the joint fit, which is tested for itself."""
    report = made(CraftReport, name=name, training=split.training, held_out=split.held_out, split=split.sentence)
    return GroupResult(report=report)
