"""The flights and craft of a folder that `rotorid analyze` wrote, for machine access."""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from api.machine.answers import NOT_DETERMINED, CraftRef, FlightRef
from core.serialization import restored
from pipeline.errors import ConfigError
from pipeline.fleet.review import review
from pipeline.flight.craft import in_order, took_off
from pipeline.results.answer import AnswerLine
from pipeline.results.craft_review import CraftReview
from pipeline.results.entry import FlightEntry
from pipeline.results.quantity import ParameterChange
from pipeline.results.report import FlightReport
from pipeline.storage.manifest import FLIGHTS
from pipeline.storage.store import ENTRY, FolderStore
from reports.numbers.comparison import compare_reports
from reports.numbers.reading import read_report

Answer = TypeVar("Answer")


class FolderLibrary:
    """A folder; looked through with every question, so that what a run adds is there."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._store = FolderStore(folder)
        self._kept: dict[Path, tuple[tuple[int, int], Any]] = {}
        self._reviews: dict[str, tuple[tuple[list[str], list[tuple[int, int]]], CraftReview]] = {}
        if not self._entries():
            read_report(folder)

    def flights(self, craft: str = "", text: str = "", limit: int | None = None) -> tuple[Sequence[FlightRef], int]:
        """List flights, the newest first, and count them."""
        entries = self._entries()
        if not entries:
            report = read_report(self._folder)
            found = [self._ref(report)] if isinstance(report, FlightReport) and not craft else []
            found = [each for each in found if text.casefold() in each.name.casefold()]
            return found, len(found)
        chosen = [
            entry
            for entry in reversed(in_order(entries))
            if (not craft or entry.vehicle == craft) and text.casefold() in entry.name.casefold()
        ]
        listed = [
            FlightRef(
                id=entry.folder,
                name=entry.name,
                craft=entry.vehicle,
                craft_name=entry.craft_name,
                start_utc=None if (start := took_off(entry)) is None else start.isoformat(),
                happened=self._as_last_read(self._folder / FLIGHTS / entry.folder / "report.json", _word),
            )
            for entry in chosen[:limit]
        ]
        return listed, len(chosen)

    def flight(self, name: str) -> str | None:
        """Return the id of a flight by that id or its name; None where there is none."""
        refs = [(entry.folder, entry.name) for entry in self._entries()]
        refs = refs or [(each.id, each.name) for each in self.flights()[0]]
        by_id = (flight for flight, _ in refs if flight == name)
        return next(by_id, None) or next((flight for flight, called in refs if called == name), None)

    def crafts(self) -> Sequence[CraftRef]:
        """List the craft, grouped as the folder's report groups them."""
        found: dict[str, list[FlightEntry]] = {}
        for entry in self._entries():
            found.setdefault(entry.vehicle, []).append(entry)
        return [
            CraftRef(id=craft, name=flights[0].craft_name, kind=flights[0].craft_name, flights=len(flights))
            for craft, flights in found.items()
        ]

    def report(self, flight: str) -> FlightReport | None:
        """Read the report of a flight."""
        names = self._store.names(FLIGHTS)
        if flight not in names and (names or flight != _ONLY):
            return None
        return _report(self._folder / FLIGHTS / flight / "report.json" if names else self._folder / "report.json")

    def review(self, craft: str) -> CraftReview | None:
        """Look at a craft as a whole."""
        names = [entry.folder for entry in self._entries() if entry.vehicle == craft]
        places = [self._folder / FLIGHTS / name / ENTRY for name in names]
        stamps = [self._kept[place][0] for place in places if place in self._kept]
        kept = self._reviews.get(craft)
        if kept is not None and kept[0] == (names, stamps):
            return kept[1]
        # With their tracks, by which recordings of one flight are told.
        found = (self._store.read_as(f"{FLIGHTS}/{name}/{ENTRY}", FlightEntry) for name in names)
        entries = [entry for entry in found if entry is not None]
        if not entries:
            return None
        self._reviews[craft] = (names, stamps), review(entries)
        return self._reviews[craft][1]

    def compare(self, a: str, b: str) -> Sequence[ParameterChange] | None:
        """Compare the parameters of two flights."""
        older, newer = self.report(a), self.report(b)
        if older is None or newer is None:
            return None
        pairs = compare_reports(older, newer, (older.name, newer.name)).pairs
        return [row for pair in pairs for row in pair.parameters]

    def _entries(self) -> list[FlightEntry]:
        places = [self._folder / FLIGHTS / name / ENTRY for name in self._store.names(FLIGHTS)]
        found = (self._as_last_read(place, _entry) for place in places)
        return [entry for entry in found if entry is not None]

    def _as_last_read(self, file: Path, read: Callable[[Path], Answer]) -> Answer:
        """Return what a file says, read again only when it has changed."""
        try:
            state = file.stat()
        except OSError:
            return read(file)
        stamp = (state.st_mtime_ns, state.st_size)
        kept = self._kept.get(file)
        if kept is None or kept[0] != stamp:
            self._kept[file] = kept = stamp, read(file)
        answer: Answer = kept[1]
        return answer

    def _ref(self, report: FlightReport) -> FlightRef:
        return FlightRef(
            id=_ONLY,
            name=report.name,
            craft="",
            craft_name=report.vehicle.frame_class or "",
            start_utc=report.log.start_utc,
            happened=_of_lines(() if report.answer is None else report.answer.lines),
        )


#: Id of the flight of a folder that holds the report of one log.
_ONLY = "flight"


def _of_lines(lines: Sequence[AnswerLine]) -> str:
    return next((line.word for line in lines if line.purpose == "Happened"), NOT_DETERMINED)


def _report(file: Path) -> FlightReport | None:
    try:
        report = read_report(file)
    except (ConfigError, OSError):
        return None
    return report if isinstance(report, FlightReport) else None


def _word(file: Path) -> str:
    """Read what happened in a flight, and nothing else of its report."""
    try:
        lines = restored((json.loads(file.read_bytes())["answer"] or {"lines": []})["lines"], list[AnswerLine])
    except (OSError, ValueError, KeyError, TypeError):
        return NOT_DETERMINED
    return _of_lines(lines)


def _entry(file: Path) -> FlightEntry | None:
    """Read an entry without its track, which is most of it."""
    try:
        return replace(restored(json.loads(file.read_bytes()), FlightEntry), track=())
    except (OSError, ValueError):
        return None
