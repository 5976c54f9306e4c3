"""Files of a few words that stand for logs, and what stands for their analysis: flights made in milliseconds.

``octa 3`` is the third flight of a craft called octa; ``broken``, ``bug``, ``kill`` and ``full`` say what happens.
"""

import dataclasses
import hashlib
import os
import signal
from datetime import timedelta
from pathlib import Path

from logparse import LogError, Vehicle
from pipeline import AnalysisConfig, Failure, FlightResult, GroupResult
from pipeline.fleet import job
from pipeline.results.entry import FlightEntry
from pipeline.results.split import Split
from tests.reports.conftest import made_flight

#: Names of the flights that were analysed in this process.
ANALYZED: list[str] = []


def analyze(path: Path, config: AnalysisConfig, progress: object, *, name: str) -> FlightResult:
    """Do as the file says."""
    content = path.read_bytes()
    word, _, number = content.decode().partition(" ")
    if word == "broken":
        raise LogError(f"{path.name} is broken")
    if word == "bug":
        raise ZeroDivisionError("division by zero")
    if word == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    ANALYZED.append(name)
    made = made_flight(name, seed=int(number), fit=False)
    log = dataclasses.replace(
        made.log,
        path=path,
        size=len(content),
        sha256=hashlib.sha256(content).hexdigest(),
        craft=word,
        start_utc=made.log.start_utc + timedelta(days=int(number)),
    )
    return dataclasses.replace(made, log=log, config=config)


def run(work: job.Job) -> FlightEntry | Failure | None:
    """Do a job with such files, in another process."""
    job.analyze = analyze
    return job.run(work)


def identify_craft(name: str, flights: object, split: Split, *_: object) -> GroupResult:
    """Stand for the joint fit, which is tested for itself."""
    return GroupResult(
        name=name, vehicle=Vehicle(), training=split.training, held_out=split.held_out, split=split.sentence
    )
