"""Where logs and results are kept: a folder in which nothing is ever seen half-written.

::

    incoming/ID/            an upload that is still arriving
    logs/ID/upload          the file as it came
    logs/ID/log.json        its `Log` record, with the name that the user gave it
    analyses/ID/analysis.json   the `Analysis` record
    analyses/ID/results/    report.html, report.json, models.json, rmse.csv

Ids are random; no name that a user sent becomes part of a path.
"""

import os
import re
import secrets
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import BinaryIO, TypeVar

from pydantic import BaseModel

from api.resources import Analysis, Log

#: Files of a finished analysis, with their media types.
RESULTS = {
    "report.html": "text/html; charset=utf-8",
    "report.json": "application/json",
    "models.json": "application/json",
    "rmse.csv": "text/csv; charset=utf-8",
}

_ID = re.compile(r"[0-9a-f]{32}")

Record = TypeVar("Record", bound=BaseModel)


def new_id() -> str:
    """Draw an identifier that nobody guesses."""
    return secrets.token_hex(16)


class Incoming:
    """A log that is arriving: bytes go to a file of their own until the log is kept or given up."""

    def __init__(self, folder: Path, file: BinaryIO) -> None:
        self.folder = folder
        self.size = 0
        self._file = file

    def write(self, data: bytes | bytearray) -> None:
        """Append bytes."""
        self._file.write(data)
        self.size += len(data)

    def sync(self) -> None:
        """Have the bytes on the disk, not only on their way."""
        self._file.flush()
        os.fsync(self._file.fileno())


class Storage:
    """A folder of logs and analyses."""

    def __init__(self, folder: Path) -> None:
        self._incoming = folder / "incoming"
        self._logs = folder / "logs"
        self._analyses = folder / "analyses"

    def prepare(self) -> None:
        """Make the folders and clear away uploads that a stopped service left unfinished; OSError where it cannot."""
        shutil.rmtree(self._incoming, ignore_errors=True)
        for folder in (self._incoming, self._logs, self._analyses):
            folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=self._incoming):
            pass  # so that a read-only folder is known at the start, not at the first upload

    @contextmanager
    def receive(self) -> Iterator[Incoming]:
        """Open a place for a log to arrive at; unless kept before the end, it is removed."""
        folder = self._incoming / new_id()
        folder.mkdir()
        try:
            with (folder / "upload").open("wb", buffering=0) as file:
                yield Incoming(folder, file)
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def keep_log(self, incoming: Incoming, name: str) -> Log:
        """Keep a log that has fully arrived."""
        log = Log(id=new_id(), name=name, size=incoming.size, received=datetime.now(UTC))
        incoming.sync()
        _write_record(incoming.folder / "log.json", log)
        incoming.folder.rename(self._logs / log.id)
        return log

    def load_log(self, log_id: str) -> Log | None:
        """Look a log up; None when there is none of this id."""
        return _read_record(self._logs, log_id, "log.json", Log)

    def log_path(self, log: Log) -> Path:
        """Give the file with the log's bytes."""
        return self._logs / log.id / "upload"

    def save_analysis(self, analysis: Analysis) -> None:
        """Write an analysis' record, replacing an earlier one."""
        folder = self._analyses / analysis.id
        folder.mkdir(exist_ok=True)
        _write_record(folder / "analysis.json", analysis)

    def load_analysis(self, analysis_id: str) -> Analysis | None:
        """Look an analysis up; None when there is none of this id."""
        return _read_record(self._analyses, analysis_id, "analysis.json", Analysis)

    def scratch(self, analysis: Analysis) -> Path:
        """Give the folder that an analysis writes its files to before they are results."""
        folder = self._analyses / analysis.id / "unfinished"
        folder.mkdir(exist_ok=True)
        return folder

    def keep_results(self, analysis: Analysis) -> None:
        """Make what is in the scratch folder the results."""
        self.scratch(analysis).rename(self._analyses / analysis.id / "results")

    def drop_scratch(self, analysis: Analysis) -> None:
        """Remove what an analysis that failed had written."""
        shutil.rmtree(self.scratch(analysis), ignore_errors=True)

    def result(self, analysis: Analysis, name: str) -> Path | None:
        """Give one of the `RESULTS` of an analysis; None when it has none of this name."""
        path = self._analyses / analysis.id / "results" / name
        return path if name in RESULTS and path.is_file() else None


def _write_record(path: Path, record: BaseModel) -> None:
    """Write a record so that a reader sees the old or the new one, never a part."""
    partial = path.with_name(path.name + ".new")
    with partial.open("w", encoding="utf-8") as file:
        file.write(record.model_dump_json(indent=1))
        file.flush()
        os.fsync(file.fileno())
    partial.replace(path)


def _read_record(parent: Path, record_id: str, name: str, kind: type[Record]) -> Record | None:
    if not _ID.fullmatch(record_id):
        return None
    with suppress(FileNotFoundError):
        return kind.model_validate_json((parent / record_id / name).read_bytes())
    return None
