"""Storage in a folder and on S3 over HTTP; a service in one file and back, and after an upgrade."""

import sqlite3
import urllib.request
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import httpx
import pytest
from alembic import command
from alembic.config import Config
from sqlalchemy import create_engine
from typer.testing import CliRunner

import api
from api import Settings
from api.store.database import Database
from pipeline.storage.store import open_store
from rotorid.cli.main import app as command_line
from tests.api import flights, postgresql
from tests.api.conftest import served
from tests.api.visits import fly, only_craft, settled
from tests.forms import thinned
from tests.s3_server import s3_server

BUCKET = "s3://rotorid/service"


@pytest.fixture(scope="module")
def s3() -> Iterator[str]:
    with s3_server() as address:
        yield address


@pytest.fixture(params=["folder", "s3"])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    if request.param == "folder":
        return str(tmp_path / "objects")
    request.getfixturevalue("s3")
    return f"{BUCKET}/{tmp_path.name}"


def test_objects(url: str, tmp_path: Path) -> None:
    objects = open_store(url)
    objects.prepare()
    objects.prepare()
    content = bytes(range(256)) * 100
    for key in ("logs/a", "analyses/b/c/report.html", "analyses/b/d/tables/imu.parquet"):
        source = tmp_path / "source"
        source.write_bytes(content)
        objects.put(source, key)
    assert objects.read("logs/a") == content
    objects.get("logs/a", tmp_path / "fetched")
    assert (tmp_path / "fetched").read_bytes() == content
    listed = dict(objects.files("analyses"))
    assert listed.keys() == {"analyses/b/c/report.html", "analyses/b/d/tables/imu.parquet"}
    assert all(abs(datetime.now(UTC) - written) < timedelta(minutes=5) for written in listed.values())
    objects.remove("analyses/b/c")
    objects.remove("logs/a")
    objects.remove("logs/never")
    assert [key for key, _ in objects.files("analyses")] == ["analyses/b/d/tables/imu.parquet"]
    assert list(objects.files("nothing")) == []
    for act in (lambda: objects.read("logs/a"), lambda: objects.get("logs/a", tmp_path / "again")):
        with pytest.raises(FileNotFoundError):
            act()


def test_a_full_disk_leaves_nothing_half_copied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A storage on another disk than the scratch folder is copied to; what does not fit is not there."""
    objects = open_store(str(tmp_path / "objects"))
    objects.prepare()
    (tmp_path / "source").write_bytes(b"content")

    def other_disk(*_: object) -> None:
        raise OSError(18, "Invalid cross-device link")

    def full(_: Path, target: Path) -> None:
        target.write_bytes(b"con")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", other_disk)
    monkeypatch.setattr("shutil.copyfile", full)
    with pytest.raises(OSError, match="No space"):
        objects.put(tmp_path / "source", "logs/a")
    assert list((tmp_path / "objects" / "logs").iterdir()) == []


def test_the_whole_way_of_a_log_on_s3(s3: str, tmp_path: Path, upload: Callable[..., httpx.Response]) -> None:
    settings = Settings(data=tmp_path, storage=f"{BUCKET}/whole", workers=1)
    objects = open_store(settings.storage_url)
    with served(settings) as client:
        assert client.get("/readyz").json() == {"status": "ok"}
        answer = upload(client, b"good log").json()
        assert answer["state"] == "done"
        assert answer["report"]["bytes"] == 8
        table = answer["links"]["rmse.csv"]
        assert client.get(table).text.startswith("flight,x,y,z")
        part = client.get(table, headers={"Range": "bytes=7-9"})
        assert (part.status_code, part.text) == (206, "x,y")
        kept = {key for key, _ in objects.files("")}
        assert f"logs/{answer['log']['id']}" in kept
        # Bytes that no row names, once they are old, are swept; what rows name stays.
        (tmp_path / "orphan").write_bytes(b"lost")
        objects.put(tmp_path / "orphan", "logs/" + "0" * 32)
        objects.put(_file(tmp_path, b"lost"), f"analyses/{answer['id']}/{'1' * 32}/report.html")
        client.parts.housekeeping.clean(datetime.now(UTC) + timedelta(hours=2))
        assert {key for key, _ in objects.files("")} == kept
        assert client.delete(answer["links"]["log"]).status_code == 204
        assert list(objects.files("")) == []
        assert client.get(table).status_code == 404


def _file(folder: Path, content: bytes) -> Path:
    path = folder / "file"
    path.write_bytes(content)
    return path


def test_a_storage_that_fails_is_told_and_nothing_is_half_done(s3: str, tmp_path: Path) -> None:
    settings = Settings(data=tmp_path, storage=f"{BUCKET}/fails", workers=1)
    with served(settings) as client:
        urllib.request.urlopen(urllib.request.Request(f"{s3}/moto-api/reset", method="POST")).close()  # no bucket now
        refused = client.post("/api/v1/logs", files={"file": ("a.bin", b"data")})
        assert refused.status_code == 503
        assert refused.json()["type"] == "urn:rotorid:problem:storage-unavailable"
        assert client.get("/api/v1/logs").json()["items"] == []
        open_store(settings.storage_url).prepare()
        assert client.post("/api/v1/logs", files={"file": ("a.bin", b"data")}).status_code == 201


def run(data: Path, *arguments: str, **settings: str) -> tuple[int, str]:
    result = CliRunner().invoke(command_line, list(arguments), env={"ROTORID_DATA": str(data), **settings})
    return result.exit_code, f"{result.output}{result.exception or ''}"


@pytest.mark.slow
@pytest.mark.parametrize("kind", thinned(["sqlite", "postgresql"], 2))
def test_everything_comes_back_from_one_file(tmp_path: Path, kind: str) -> None:
    file = tmp_path / "saved.tar"
    with served(data=tmp_path / "old", workers=1, analyze=flights.analyze) as client:
        for day in range(2):
            fly(client, f"flight{day}.bin", flights.log(day))
        craft = settled(client, only_craft(client)["id"])
        client.put(craft["links"]["self"], json={"name": "Ours"})
        before = _seen(client, craft["id"])
        assert run(tmp_path / "old", "backup", str(file))[0] == 0  # while it runs
    assert file.stat().st_mode & 0o777 == 0o600
    assert run(tmp_path / "old", "backup", str(file))[0] != 0  # it is there
    code, said = run(tmp_path / "old", "restore", str(file))
    assert code != 0
    assert "restore into an empty one" in said

    def check(**settings: str) -> None:
        code, said = run(tmp_path / "new", "restore", str(file), **settings)
        assert code == 0, said
        chosen = Settings(data=tmp_path / "new", workers=1, database=settings.get("ROTORID_DATABASE", ""))
        with served(chosen, analyze=flights.analyze) as client:
            assert _seen(client, craft["id"]) == before
            fly(client, "flight2.bin", flights.log(2))  # and it goes on
            assert only_craft(client)["flights"] == 3

    if kind == "sqlite":
        check()
    else:
        with postgresql.running() as server:
            check(ROTORID_DATABASE=server.url)


def _seen(client: httpx.Client, craft: str) -> list[object]:
    analyses = client.get("/api/v1/analyses").json()["items"]
    files = [client.get(analysis["links"]["report.json"]).content for analysis in analyses]
    return [analyses, files, client.get("/api/v1/logs").json(), client.get(f"/api/v1/crafts/{craft}").json()]


@pytest.mark.parametrize("content", [b"", b"junk" * 1000, b"\x1f\x8b"])
def test_what_is_no_backup_is_refused_in_a_line(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "saved.tar").write_bytes(content)
    code, said = run(tmp_path / "new", "restore", str(tmp_path / "saved.tar"))
    assert code != 0
    assert "is no backup of rotorid, or damaged" in said


def test_a_database_of_the_first_version_is_brought_up_to_date_with_its_data(tmp_path: Path) -> None:
    file = tmp_path / "rotorid.db"
    config = Config()
    config.set_main_option("script_location", str(Path(api.__file__).parent / "store" / "migrations"))
    engine = create_engine(f"sqlite:///{file}")
    with engine.begin() as connection:
        config.attributes["connection"] = connection
        command.upgrade(config, "0001")
    engine.dispose()
    log, analysis = "1" * 32, "2" * 32
    with sqlite3.connect(file) as old:
        old.execute(
            "INSERT INTO logs VALUES (?, '', 'old.bin', 4, ?, '2025-01-02 03:04:05', ?)", (log, "a" * 64, "b" * 64)
        )
        old.execute(
            "INSERT INTO analyses (id, owner, configuration, state, stage, progress, attempts, deaths, created, files) "
            "VALUES (?, '', '{\"poles\": 4}', 'cancelled', '', 0.5, 1, 0, '2025-01-02 03:04:06', '{}')",
            (analysis,),
        )
        old.execute("INSERT INTO analysed_logs VALUES (?, 0, ?)", (analysis, log))
    old.close()
    (tmp_path / "objects" / "logs").mkdir(parents=True)
    (tmp_path / "objects" / "logs" / log).write_bytes(flights.log(0))
    with served(data=tmp_path, workers=1, analyze=flights.analyze) as client:
        answer = client.get(f"/api/v1/analyses/{analysis}").json()
        assert (answer["configuration"], answer["state"], answer["log"]["name"]) == (
            {"poles": 4},
            "cancelled",
            "old.bin",
        )
        assert client.get("/api/v1/crafts").json()["items"] == []
        assert client.get(f"/analyses/{analysis}").status_code == 200
        assert client.delete(f"/api/v1/logs/{log}").status_code == 204
    database = Database(f"sqlite:///{file}")
    database.migrate()  # once more changes nothing
    database.close()


def test_failures_and_the_queue_are_measured(tmp_path: Path) -> None:
    with served(data=tmp_path, workers=1) as client:
        for content in (b"refused 1", b"refused 2", b"bug"):
            client.post("/api/v1/logs", params={"analyze": True}, files={"file": ("a.bin", content)})
        text = client.get("/metrics").text
    assert 'rotorid_failures{problem="unusable-log"} 2.0' in text
    assert 'rotorid_failures{problem="analysis-crashed"} 1.0' in text
    assert "rotorid_queue_age_seconds 0.0" in text
