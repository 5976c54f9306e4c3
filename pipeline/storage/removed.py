"""Tables of logs that are no longer among the inputs: out of the datasets, but kept in case the logs come back.

A renamed log is analysed under its new name. Were its old tables still in the dataset, a query would count one flight
twice.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import count
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

from core.lazy import lazy
from pipeline.names import flight_folder
from pipeline.storage.manifest import FLIGHTS, FileRecord
from pipeline.storage.store import ENTRY, Store

if TYPE_CHECKING:
    from pipeline.storage import dataset as datasets
else:
    datasets = lazy("pipeline.storage.dataset")  # brings the numerical packages: an unchanged folder must not wait

#: Folder of the store that has the datasets of logs that are gone.
REMOVED = "removed"


def set_aside(store: Store, records: Sequence[FileRecord]) -> None:
    """Move the tables of flights out of the datasets."""
    for place in _places(store, records, ""):
        store.remove(f"{REMOVED}/{place}")
        store.move(place, f"{REMOVED}/{place}")


def bring_back(store: Store, records: Sequence[FileRecord]) -> None:
    """Move them back, where nothing newer stands."""
    for place in list(_places(store, records, f"{REMOVED}/")):
        if store.names(place):
            store.remove(f"{REMOVED}/{place}")
        else:
            store.move(f"{REMOVED}/{place}", place)


def _places(store: Store, records: Sequence[FileRecord], below: str) -> Iterator[str]:
    """List the partitions that flights have in the datasets, as far as they are there."""
    if not records:
        return
    for folder, vehicle in _flights(store, records):
        for dataset in (datasets.TABLES, datasets.EXPERIMENTS):
            for name in store.names(f"{below}{dataset}"):
                place = str(PurePosixPath(datasets.part(dataset, name, vehicle, folder)).parent)
                if store.names(below + place):
                    yield place


def _flights(store: Store, records: Sequence[FileRecord]) -> Iterator[tuple[str, str]]:
    """List folder and vehicle of every flight of logs."""
    for record in records:
        for number in count(1):
            folder = flight_folder(record.folder, number)
            entry = store.read_json(f"{FLIGHTS}/{folder}/{ENTRY}")
            if entry is None:
                break
            yield folder, entry["vehicle"]
