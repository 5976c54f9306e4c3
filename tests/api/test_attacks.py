"""What attackers and full disks found: archives, orphans, proxies, tokens, leases, bytes that are half written."""

import errno
import io
import json
import os
import tarfile
import tempfile
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path

import httpx
import pytest
from sqlalchemy.exc import OperationalError

from api import Settings
from api.access import BEARERS
from api.logs.catalog import Catalog
from api.settings import Access
from api.store import backup
from api.store.database import Database
from api.store.scratch import open_upload
from api.work.queue import Queue
from pipeline.storage.store import ObjectStore, open_store
from tests.api.conftest import Upload, served
from tests.api.programs import wait_until


@pytest.mark.parametrize(
    "name",
    [
        "objects/{out}/stolen",
        "objects//{out}/stolen",
        "objects/" + 20 * "../" + "{out}/stolen",  # to the root of the disk, however deep the storage lies
        "objects/../tables/stolen",
        "{out}/stolen",
    ],
)
def test_a_crafted_backup_writes_nothing_outside_the_storage(name: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    source, settings = tmp_path / "crafted.tar", Settings(data=tmp_path / "data")
    settings.data.mkdir()
    with tarfile.open(source, "w") as archive:
        for member, content in (("manifest.json", json.dumps({"version": 1, "rows": 0}).encode()), (name, b"x")):
            facts = tarfile.TarInfo(member.format(out=out))
            facts.size = len(content)
            archive.addfile(facts, io.BytesIO(content))
    with suppress(backup.BackupError):
        backup.restore(settings, source)
    storage = settings.data / "objects"
    assert [path for path in tmp_path.rglob("stolen") if not path.is_relative_to(storage)] == []


@pytest.fixture
def guarded(tmp_path: Path) -> Iterator[tuple[httpx.Client, str]]:
    """Run a service that asks for tokens, and yield it with one."""
    with served(data=tmp_path, access=Access.TOKENS, workers=1) as client:
        yield client, client.parts.tokens.create("ann")


@pytest.mark.parametrize(("proxies", "taken"), [("", 10), ("127.0.0.1", 12)])
def test_only_a_proxy_that_the_settings_name_says_for_whom_it_asks(tmp_path: Path, proxies: str, taken: int) -> None:
    with served(data=tmp_path, access=Access.TOKENS, workers=1, proxies=proxies) as client:
        named = [{"X-Forwarded-For": f"192.0.2.{k}"} for k in range(12)]
        answers = [client.post("/sign-in", data={"token": "wrong"}, headers=headers) for headers in named]
    assert [answer.status_code for answer in answers] == [401] * taken + [429] * (12 - taken)
    assert 0 <= int(answers[-1].headers.get("Retry-After", 0)) <= 60


def test_wrong_bearer_tokens_meet_a_limit_and_right_ones_do_not(guarded: tuple[httpx.Client, str]) -> None:
    client, token = guarded
    answers = [client.get("/api/v1/logs", headers={"Authorization": f"Bearer guess{k}"}) for k in range(65)]
    most = BEARERS.amount
    assert [answer.status_code for answer in answers] == [401] * most + [429] * (65 - most)
    assert int(answers[-1].headers["Retry-After"]) > 0
    assert client.get("/api/v1/logs", headers={"Authorization": f"Bearer {token}"}).status_code == 200


def test_a_probe_that_a_full_disk_refuses_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    objects = ObjectStore(str(tmp_path))

    def full(path: str, _: bytes) -> None:
        Path(path).touch()
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(objects._files, "pipe_file", full)
    with pytest.raises(OSError, match="No space"):
        objects.prepare()
    assert not list(tmp_path.iterdir())


def test_an_order_on_a_disk_that_fills_up_ends(tmp_path: Path, upload: Upload, monkeypatch: pytest.MonkeyPatch) -> None:
    """No room for the folder of the analysis, nor for the row that says so but in the reserve."""
    reserve, fail = tmp_path / "rotorid.db.reserve", Queue.fail

    def no_folder(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def fail_with_room(queue: Queue, *arguments: object) -> bool:
        if reserve.exists():
            raise OperationalError("UPDATE analyses", {}, Exception("database or disk is full"))
        return fail(queue, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(tempfile, "TemporaryDirectory", no_folder)
    monkeypatch.setattr(Queue, "fail", fail_with_room)
    with served(data=tmp_path, workers=1) as client:
        ended = upload(client, b"good log")
        assert (ended.status_code, ended.json()["type"]) == (507, "urn:rotorid:problem:results-not-kept")
        wait_until(reserve.exists)


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    """Yield a new database."""
    with closing(Database(f"sqlite:///{tmp_path / 'rotorid.db'}")) as opened:
        opened.migrate()
        yield opened


def test_a_row_is_written_after_its_bytes_are_synced_and_in_place(
    database: Database, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A power cut between the two may lose the row, and never the bytes of a row that is there."""
    catalog, steps = Catalog(database, open_store(str(tmp_path / "objects"))), []
    write = Database.write
    monkeypatch.setattr(os, "fsync", lambda _: steps.append("sync"))
    monkeypatch.setattr(Database, "write", lambda self: steps.append("row") or write(self))
    with open_upload(tmp_path) as upload:
        replace = Path.replace
        monkeypatch.setattr(Path, "replace", lambda *paths: steps.append("place") or replace(*paths))
        upload.write(b"log")
        catalog.keep_logs([(upload, "a.bin")], "ann")
    assert steps[:2] == ["sync", "place"]
    assert set(steps[2:-1]) == {"sync"}  # of the folders
    assert steps[-1] == "row"
