"""Backup and restore of a whole service, each in one call: the database as rows, the storage as objects, in one file.

The file is a tar of ``manifest.json``, ``tables/NAME.json`` (a row a line) and ``objects/KEY``. Rows are read in one
transaction before the objects, so that every row of a backup has its bytes: bytes without a row are harmless. A backup
can be restored into another database and storage, such as from SQLite to PostgreSQL.
"""

import io
import json
import os
import tarfile
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from sqlalchemy import DateTime, func, select
from sqlalchemy.orm import Session

from api.settings import Settings
from api.store.database import Database
from api.store.records import Record, UtcTime
from pipeline.storage.store import Store, open_store, sync

#: Of the format of backups.
_VERSION = 1

#: Rows written at once.
_BATCH = 500


class BackupError(Exception):
    """A backup cannot be saved or restored, for a reason to show to the operator."""


def save(settings: Settings, target: Path) -> tuple[int, int]:
    """Write everything into a file, which appears only when complete; return the number of rows and objects."""
    database, objects = Database(settings.database_url), open_store(settings.storage_url)
    database.migrate()
    partial = target.with_name(target.name + ".partial")
    rows = count = 0
    try:
        with partial.open("xb") as file:
            partial.chmod(0o600)
            with (
                tarfile.open(fileobj=file, mode="w") as archive,
                tempfile.TemporaryDirectory(dir=target.parent) as scratch,
            ):
                tables = Path(scratch) / "tables"
                tables.mkdir()
                with database.read() as session:
                    for table in Record.metadata.sorted_tables:
                        rows += _dump(session, table, tables / f"{table.name}.json")
                about = {"version": _VERSION, "made": datetime.now(UTC).isoformat(), "rows": rows}
                _add(archive, "manifest.json", json.dumps(about).encode())
                for path in sorted(tables.iterdir()):
                    archive.add(path, f"tables/{path.name}")
                for key, _ in objects.files(""):
                    with suppress(FileNotFoundError):  # deleted at this moment
                        _add(archive, f"objects/{key}", objects.read(key))
                        count += 1
            file.flush()
            os.fsync(file.fileno())
        partial.replace(target)
        sync(target.parent)
    except FileExistsError as error:
        raise BackupError(f"{partial} is there: another backup is being made, or one was broken off") from error
    except BaseException:
        partial.unlink(missing_ok=True)
        raise
    finally:
        database.close()
    return rows, count


def restore(settings: Settings, source: Path) -> tuple[int, int]:
    """Restore a backup into an empty service; return the number of rows and objects."""
    database, objects = Database(settings.database_url), open_store(settings.storage_url)
    try:
        database.migrate()
        objects.prepare()
        with database.read() as session:
            if any(session.scalar(select(func.count()).select_from(table)) for table in Record.metadata.sorted_tables):
                raise BackupError("the service has logs or tokens already; restore into an empty one")
        return _restore(database, objects, settings, source)
    except AttributeError as error:
        if not hasattr(tarfile, "data_filter"):
            raise BackupError("restoring needs Python 3.11.4 or newer, whose archives are unpacked safely") from error
        raise BackupError(f"{source.name} is no backup of rotorid, or damaged: {error}") from error
    except (tarfile.TarError, EOFError, LookupError, ValueError, TypeError) as error:
        raise BackupError(f"{source.name} is no backup of rotorid, or damaged: {error}") from error
    finally:
        database.close()


def _restore(database: Database, objects: Store, settings: Settings, source: Path) -> tuple[int, int]:
    rows = count = 0
    with tarfile.open(source, "r:") as archive, tempfile.TemporaryDirectory(dir=settings.data) as scratch:
        head = archive.extractfile("manifest.json")
        about = {} if head is None else json.load(head)
        if about.get("version") != _VERSION:
            raise BackupError(f"{source.name} was made by another version of rotorid")
        # Objects first, so that no row refers to a missing object.
        kept = Path(scratch).resolve() / "objects"
        for member in archive:
            if not member.name.startswith("objects/") or not member.isfile():
                continue
            # tarfile's safe extraction decides where a member may be written; its path there is the key.
            archive.extract(safe := tarfile.data_filter(member, scratch).replace(mode=0o600), scratch, filter="data")
            place = (Path(scratch) / safe.name).resolve()
            objects.put(place, place.relative_to(kept).as_posix())
            count += 1
        with database.write() as session:
            for table in Record.metadata.sorted_tables:
                for batch in _batches(archive, f"tables/{table.name}.json"):
                    session.execute(table.insert(), [_parsed(table, row) for row in batch])
                    rows += len(batch)
        if rows != about["rows"]:
            raise BackupError(f"{source.name} holds {rows} of {about['rows']} rows: it is damaged")
    return rows, count


def _dump(session: Session, table: Any, file: Path) -> int:
    count = 0
    with file.open("w", encoding="utf-8") as lines:
        for row in session.execute(select(table)).mappings():
            facts = {name: v.isoformat() if isinstance(v, datetime) else v for name, v in row.items()}
            lines.write(json.dumps(facts) + "\n")
            count += 1
    return count


def _parsed(table: Any, row: dict[str, Any]) -> dict[str, Any]:
    times = {column.name for column in table.columns if isinstance(column.type, UtcTime | DateTime)}
    return {n: datetime.fromisoformat(v) if n in times and v is not None else v for n, v in row.items()}


def _batches(archive: tarfile.TarFile, name: str) -> Iterator[list[dict[str, Any]]]:
    try:
        file = archive.extractfile(name)
    except KeyError:  # a table that the backup's version did not have
        return
    batch = []
    for line in file or ():
        batch.append(json.loads(line))
        if len(batch) == _BATCH:
            yield batch
            batch = []
    if batch:
        yield batch


def _add(archive: tarfile.TarFile, name: str, content: bytes) -> None:
    member = tarfile.TarInfo(name)
    member.size, member.mode = len(content), 0o600
    archive.addfile(member, io.BytesIO(content))
