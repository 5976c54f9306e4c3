"""A service in one file and back, the upgrade of a database of the first version with data, and what is measured."""

import sqlite3
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
from rotorid.cli.main import app as command_line
from tests.api import flights, postgresql
from tests.api.conftest import served
from tests.api.visits import fly, only_craft, settled


def run(data: Path, *arguments: str, **settings: str) -> tuple[int, str]:
    found = CliRunner().invoke(command_line, list(arguments), env={"ROTORID_DATA": str(data), **settings})
    return found.exit_code, f"{found.output}{found.exception or ''}"


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["sqlite", "postgresql"])
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
    files = [client.get(each["links"]["report.json"]).content for each in analyses]
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
        found = client.get(f"/api/v1/analyses/{analysis}").json()
        assert (found["configuration"], found["state"], found["log"]["name"]) == ({"poles": 4}, "cancelled", "old.bin")
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
