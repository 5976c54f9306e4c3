"""The flights of an analysis as it hands them over to their craft: in the files of its results, beside the report."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from core.serialization import plain, restored
from pipeline.errors import ConfigError
from pipeline.results.answer import AnswerLine
from pipeline.results.entry import FlightEntry
from pipeline.results.model_report import ModelInShort, ModelReport
from pipeline.results.report import FlightReport
from pipeline.results.verdict import Trust
from reports.numbers.reading import read_report

#: The file of the results that holds the entries; for the service only.
FILE = "flights.json"

#: Best first.
_TRUST = (Trust.YES, Trust.LIMITED, Trust.NO, Trust.UNKNOWN)


@dataclass(frozen=True, slots=True)
class Flown:
    """A flight as its craft keeps it."""

    entry: FlightEntry
    answers: tuple[AnswerLine, ...] = ()
    trust: Trust = Trust.UNKNOWN  #: The most that is said of a model of it.


def write_flown(entries: Iterable[FlightEntry], folder: Path) -> None:
    """Write the entries of flights into a folder of results."""
    (folder / FILE).write_text(json.dumps(plain(list(entries))), encoding="utf-8")


def read_flown(folder: Path) -> list[Flown]:
    """Read what was handed over, with what the report says of it; nothing where nothing was."""
    try:
        entries = restored(json.loads((folder / FILE).read_bytes()), list[FlightEntry])
        report = read_report(folder / "report.json")
    except (OSError, ValueError, ConfigError):
        return []
    flights = [report] if isinstance(report, FlightReport) else report.flights
    said = {flight.name: flight for flight in flights}
    found = []
    for entry in entries:
        short = said.get(entry.name)
        answers = () if short is None or short.answer is None else short.answer.lines
        found.append(Flown(entry, answers, Trust.UNKNOWN if short is None else best(short.models)))
    return found


def without_experiments(flown: Sequence[Flown]) -> list[Flown]:
    """Return flights as no joint fit can use them: they were sampled at another rate than others."""
    return [replace(each, entry=replace(each.entry, experiments=())) for each in flown]


def best(models: Iterable[ModelReport | ModelInShort]) -> Trust:
    """Return the most that is said of one of several models."""
    return min((model.verdict.trust for model in models), key=_TRUST.index, default=Trust.UNKNOWN)
