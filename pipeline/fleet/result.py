"""Result of a folder of logs: its flights, its craft, and the store that holds their products."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from core.lazy import lazy
from core.serialization import plain
from core.summary import Summarised, listed
from pipeline.config import AnalysisConfig
from pipeline.results.craft import GroupResult, Publish
from pipeline.results.fleet import FlightEntry, GroupEntry, LogFailure
from pipeline.results.model import ParameterRow
from pipeline.storage.manifest import CRAFTS, FLIGHTS, Manifest, page_key
from pipeline.storage.store import Store, TemporaryStore

if TYPE_CHECKING:
    import pandas as pd
else:
    pd = lazy("pandas")  # an unchanged folder must not wait for it

#: Why a flight is left out of the joint fit, and not counted twice.
ANOTHER_RECORDING = "another recording of a flight that is here too, left out of the joint fit"


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """What a run over a folder is asked for."""

    config: AnalysisConfig
    store: Store
    publish: Publish | None
    redo: bool  #: Make everything anew.

    @property
    def pages(self) -> str:
        """Names what writes pages."""
        return page_key(self.publish)


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentifiedCrafts:
    """Crafts of several flights, and what has no part in them."""

    entries: tuple[GroupEntry, ...] = ()  #: Those with most flights first.
    #: Sources of flights that are in no joint model though they could be, with the reason.
    left_out: tuple[tuple[str, str], ...] = ()
    failures: tuple[LogFailure, ...] = ()  #: Crafts whose products could not be stored.
    unstored: tuple[GroupEntry, ...] = ()  #: Their entries.
    #: Those of this run by folder, as `pipeline.FleetResult` has them.
    fitted: Mapping[str, GroupResult] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Craft(Summarised):
    """One aircraft of a folder of logs.

    Attributes
    ----------
    name : str
        The craft in words.
    training, held_out : tuple of str
        Names of the flights fitted jointly, and of those kept to validate.
    parameters : DataFrame
        Index ``parameter``; columns ``value sigma unit method reason`` (reason: why not determined).
    """

    name: str
    training: tuple[str, ...]
    held_out: tuple[str, ...]
    parameters: pd.DataFrame

    def summary(self) -> Mapping[str, str]:
        """Return the key facts of this craft."""
        known = self.parameters.index[self.parameters["value"].notna()].unique().tolist()
        return {
            "craft": self.name,
            "training": listed(self.training),
            "held out": listed(self.held_out) or "none",
            "determined": listed(known, 5) or "nothing",
        }


@dataclass(frozen=True, slots=True)
class _Parameters:
    """Of a report.json, what a `Craft` shows."""

    parameters: tuple[ParameterRow, ...] | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class FleetResult(Summarised):
    """Several logs: every flight for itself, every craft jointly, and the files that gave nothing."""

    flights: tuple[FlightEntry, ...]  #: In the order in which the logs were found. Their products are in the store.
    groups: tuple[GroupEntry, ...]  #: Crafts with several flights, those with most first.
    failures: tuple[LogFailure, ...]  #: Logs that gave nothing.
    config: AnalysisConfig
    store: Store  #: What has all products.
    #: What was found but not used, such as files that are no logs and second recordings of a flight.
    passed_over: tuple[LogFailure, ...] = ()
    duplicates: tuple[LogFailure, ...] = ()  #: Copies of logs that were analysed.
    #: Logs of earlier runs that are no longer there; their products are still in the store.
    removed: tuple[LogFailure, ...] = ()
    again: tuple[str, ...] = ()  #: Flights of which another recording is here too.
    reused: int = 0  #: Logs whose products, or whose reason to have none, were in the store already.
    manifest: Manifest | None = None
    #: Crafts whose models were fitted in this run, by the folders of `groups`; those of others are in the store.
    fitted: Mapping[str, GroupResult] = field(default_factory=dict)
    timings: Mapping[str, float] = field(default_factory=dict)  #: Seconds spent on logs and on crafts in this run.

    def summary(self) -> Mapping[str, str]:
        """Return the key facts of this result."""
        return {
            "flights": f"{len(self.flights)}: {listed([flight.name for flight in self.flights])}",
            "craft with several flights": listed([group.name for group in self.groups]) or "none",
            "failures": listed([f"{failure.file} ({failure.reason})" for failure in self.failures], 2) or "none",
            "report": self.report or "not kept; give out=FOLDER",
        }

    @property
    def report(self) -> str:
        """Path or URL of report.html; empty when nothing is kept."""
        return "" if isinstance(self.store, TemporaryStore) else f"{self.store.url.rstrip('/')}/report.html"

    @property
    def crafts(self) -> tuple[Craft, ...]:
        """The craft as the reports in the store have them, those with most flights first, single flights last."""
        grouped = {name for group in self.groups for name in (*group.training, *group.held_out)}
        alone = (flight for flight in self.flights if flight.name not in grouped)
        return (
            *(
                self._craft(f"{CRAFTS}/{group.folder}", group.name, group.training, group.held_out)
                for group in self.groups
            ),
            *(self._craft(f"{FLIGHTS}/{flight.folder}", flight.craft_name, (flight.name,), ()) for flight in alone),
        )

    def _craft(self, folder: str, name: str, training: tuple[str, ...], held_out: tuple[str, ...]) -> Craft:
        report = self.store.read_as(f"{folder}/report.json", _Parameters)
        shown = ["value", "sigma", "unit", "method", "note"]
        rows = pd.DataFrame(plain(() if report is None else report.parameters or ()), columns=["parameter", *shown])
        table = rows.set_index("parameter").rename(columns={"note": "reason"})
        return Craft(name=name, training=training, held_out=held_out, parameters=table)

    @property
    def reported(self) -> bool:
        """Whether the report in the store is of these very products."""
        if self.manifest is None or self.manifest.reported != self.manifest.identity:
            return False
        return {"report.html", "report.json"} <= set(self.store.names(""))

    def confirm_report(self) -> None:
        """Note in the store that the report was written; OSError where nothing can be written."""
        if self.manifest is not None:
            replace(self.manifest, reported=self.manifest.identity).write(self.store)
