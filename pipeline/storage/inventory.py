"""Files that were found as records of logs: told apart by content, named, and with the keys of their products.

Tables of logs that are no longer among the inputs leave the datasets, but are kept in case the logs come back: a
renamed log is analysed under its new name, and were its old tables still there, a query would count one flight twice.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import replace
from pathlib import PurePath
from typing import TYPE_CHECKING

from core.lazy import lazy
from pipeline.config import AnalysisConfig
from pipeline.execution.executors import WorkerDiedError, outcomes
from pipeline.names import file_name, folder_names, is_url, printable
from pipeline.storage.manifest import FileRecord, Manifest, entries_of, flight_key
from pipeline.storage.sources import Source, called_a_log, digest
from pipeline.storage.store import Store

if TYPE_CHECKING:
    from pipeline.storage import dataset as datasets
else:
    datasets = lazy("pipeline.storage.dataset")  # brings the numerical packages: an unchanged folder must not wait


#: Files that are read at the same time: storage far away answers late.
READERS = 8


def index_sources(
    sources: Sequence[Source],
    former: Manifest,
    config: AnalysisConfig,
    executor: Executor | None = None,
) -> list[FileRecord]:
    """Make a record of every file, in the order given.

    Copies have the state ``"duplicate"``, files that cannot be read ``"failed"``; all others have names, folders and
    keys, and the state ``"interrupted"`` until they are done.
    """
    contents = _contents(sources, former, executor)
    originals = _originals(sources, contents, former)
    records = []
    for source in sources:
        record = FileRecord(url=source.url, size=source.size, modified=source.modified)
        content = contents[source.url]
        if isinstance(content, OSError):
            reason = f"cannot be read: {content.strerror or content}"
            state = "failed" if source.named or source.called_a_log else "no log"
            records.append(replace(record, reason=reason, state=state))
        elif originals.get(content, source.url) != source.url:
            original = originals[content]
            # With its folder: copies often have the same name.
            place = "/".join(PurePath(original).parts[-2:])
            reason = f"a copy of {printable(place)}"
            records.append(replace(record, sha256=content, reason=reason, original=original, state="duplicate"))
        else:
            records.append(replace(record, sha256=content))
    return _named(records, former, config)


def _contents(sources: Sequence[Source], former: Manifest, executor: Executor | None) -> dict[str, str | OSError]:
    """Return the SHA-256 of every file, or why it cannot be read."""
    last = {record.url: record for record in former.logs}
    contents: dict[str, str | OSError] = {}
    for source in sources:
        record = last.get(source.url)
        if record and record.sha256 and (record.size, record.modified) == (source.size, source.modified):
            contents[source.url] = record.sha256
    new = [source.url for source in sources if source.url not in contents]
    near = [url for url in new if executor is None or not is_url(url)]
    with ThreadPoolExecutor(READERS) as readers:
        contents |= zip(near, readers.map(_digest, near), strict=True)
    if len(near) < len(new):
        for url, outcome in outcomes(executor, _digest, (url for url in new if is_url(url))):
            contents[url] = OSError(str(outcome)) if isinstance(outcome, WorkerDiedError) else outcome
    return contents


def _digest(url: str) -> str | OSError:
    try:
        return digest(url)
    except OSError as error:
        return error


def _originals(sources: Sequence[Source], contents: Mapping[str, str | OSError], former: Manifest) -> dict[str, str]:
    """Choose of equal files the one that stands for all, by content.

    The one that was analysed before comes first, then what is called a log.
    """
    analyzed = {record.url for record in former.logs if record.state == "analysed"}
    originals: dict[str, str] = {}
    for source in sorted(
        sources, key=lambda source: (source.url not in analyzed, not source.named, not source.called_a_log)
    ):
        content = contents[source.url]
        # Empty files are copies of each other only by name.
        if source.size and isinstance(content, str):
            originals.setdefault(content, source.url)
    return originals


def _named(records: Sequence[FileRecord], former: Manifest, config: AnalysisConfig) -> list[FileRecord]:
    single = [record for record in records if not record.reason]
    names = flight_names(
        [record.url for record in single], {record.url: record.name for record in former.logs if record.name}
    )
    folders = folder_names(names.values(), {record.name: record.folder for record in former.logs if record.folder})
    return [
        record
        if record.reason
        else replace(
            record,
            name=names[record.url],
            folder=folders[names[record.url]],
            key=flight_key(record.sha256, names[record.url], config),
        )
        for record in records
    ]


def flight_names(urls: Sequence[str], known: Mapping[str, str] | None = None) -> dict[str, str]:
    """Name each flight after its file; where that is not unique, with the ending and a number."""
    names = {url: known[url] for url in urls if url in known} if known else {}
    taken = {name.casefold() for name in names.values()}
    stems = Counter(_stem(url).casefold() for url in urls if called_a_log(file_name(url)))
    for url in sorted(urls, key=lambda url: not called_a_log(file_name(url))):
        if url in names:
            continue
        base = _stem(url) if stems[_stem(url).casefold()] <= 1 else file_name(url)
        name, number = base, 1
        while name.casefold() in taken:
            number += 1
            name = f"{base} ({number})"
        taken.add(name.casefold())
        names[url] = name
    return names


def _stem(url: str) -> str:
    return PurePath(file_name(url)).stem


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
    for record in records:
        for flight, entry in entries_of(store, record.folder):
            places = datasets.partitions(store, entry["vehicle"], flight, below)
            yield from (place for place in places if store.names(below + place))
