"""What an operator relies on: documented settings, limits of disk and rights, lines to read, old things cleared."""

import errno
import json
import logging
import os
import re
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from sqlalchemy import text

from api import Settings
from api.log_lines import HideSecrets, JsonLines
from api.server import serve
from api.store.database import Database
from tests.api.conftest import Upload, served, unfinished
from tests.api.programs import wait_until
from tests.paths import ROOT

MANUAL = ROOT / "docs" / "service.md"


def test_every_setting_is_documented_and_nothing_else() -> None:
    documented = set(re.findall(r"^\| `(ROTORID_\w+)` \|", MANUAL.read_text(encoding="utf-8"), re.MULTILINE))
    assert documented == {f"ROTORID_{name.upper()}" for name in Settings.model_fields}
    assert all(field.description for field in Settings.model_fields.values())


@pytest.mark.parametrize(
    ("variable", "value", "says"),
    [
        ("ROTORID_UPLOAD_RATE", "often", "ROTORID_UPLOAD_RATE: Value error, write a number and a time"),
        ("ROTORID_DATABASE", "nonsense", "Check ROTORID_DATABASE"),
        ("ROTORID_DATABASE", "sqlite:////nowhere/at/all.db", "Check ROTORID_DATABASE"),
        ("ROTORID_STORAGE", "nowhere://bucket", "ROTORID_STORAGE names: Protocol not known: nowhere"),
        ("ROTORID_ACCESS", "sometimes", "ROTORID_ACCESS: "),
        ("ROTORID_UPLOAD_LIMIT", "many", "ROTORID_UPLOAD_LIMIT: "),
        ("ROTORID_WORKERS", "-1", "ROTORID_WORKERS: "),
        ("ROTORID_DATA", "/dev/null/data", "Set ROTORID_DATA to a folder"),
    ],
)
def test_a_wrong_setting_is_told_in_a_line(
    variable: str, value: str, says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROTORID_DATA", str(tmp_path))
    monkeypatch.setenv(variable, value)
    monkeypatch.setattr("api.log_lines.configure", lambda _: None)
    with pytest.raises(SystemExit, match=re.escape(says)):
        serve()


def test_a_database_of_a_newer_rotorid_is_refused_in_a_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    database = Database(Settings(data=tmp_path).database_url)
    database.migrate()
    with database.write() as session:
        session.execute(text("UPDATE alembic_version SET version_num = '9999'"))
    database.close()
    monkeypatch.setenv("ROTORID_DATA", str(tmp_path))
    monkeypatch.setattr("api.log_lines.configure", lambda _: None)
    with pytest.raises(SystemExit, match=r"newer rotorid than this one\. Install that version again"):
        serve()


@contextmanager
def small_disk(folder: Path, size: str) -> Iterator[None]:
    """Mount a small file system of memory; the test is skipped where that is not allowed."""
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder)]
    if os.geteuid() != 0 or subprocess.run(command, capture_output=True, check=False).returncode != 0:
        pytest.skip("a file system can only be mounted as root")
    try:
        yield
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)


def test_a_full_disk_is_told_and_the_service_goes_on_when_there_is_room(tmp_path: Path, upload: Upload) -> None:
    data = tmp_path / "data"
    with ExitStack() as stack:
        stack.enter_context(small_disk(data, "5m"))
        client = stack.enter_context(served(data=data, workers=1))
        assert upload(client, b"good log").status_code == 201
        kept = client.post("/api/v1/logs", files={"file": ("a.bin", bytes(2_000_000))}).json()
        for _ in range(2):
            refused = client.post("/api/v1/logs", files={"file": ("b.bin", b"x" * 4_000_000)})
            assert (refused.status_code, refused.json()["type"]) == (507, "urn:rotorid:problem:disk-full")
            assert not unfinished(data)
        ballast = data / "ballast"
        fill(ballast)
        refused = client.post("/api/v1/logs", files={"file": ("c.bin", b"small")})
        assert refused.status_code in (503, 507)
        assert refused.headers["Content-Type"] == "application/problem+json"
        assert len(client.get("/api/v1/logs").json()["items"]) == 2
        # Deleting is how room is made: it must not itself need any.
        assert client.delete(f"/api/v1/logs/{kept['id']}").status_code == 204
        assert len(client.get("/api/v1/logs").json()["items"]) == 1
        ballast.unlink()
        assert upload(client, b"good, and room for it").status_code == 201


def fill(path: Path) -> None:
    """Write until nothing more fits."""
    with path.open("wb", buffering=0) as file:
        for size in (65536, 4096, 512):
            try:
                while True:
                    file.write(bytes(size))
            except OSError:
                continue


def test_a_folder_that_became_read_only_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with served(data=tmp_path, workers=1) as client:

        def read_only(*_: object, **__: object) -> None:
            raise OSError(errno.EROFS, "Read-only file system")

        with monkeypatch.context() as patched:
            patched.setattr(Path, "replace", read_only)
            refused = client.post("/api/v1/logs", files={"file": ("a.bin", b"data")})
        assert (refused.status_code, refused.json()["type"]) == (503, "urn:rotorid:problem:storage-unavailable")
        assert "Read-only file system" in refused.json()["detail"]
        assert refused.headers["Retry-After"]
        assert client.get("/api/v1/logs").json()["items"] == []
        assert not unfinished(tmp_path)
        assert client.post("/api/v1/logs", files={"file": ("a.bin", b"data")}).status_code == 201


def test_logs_past_their_time_are_removed_with_their_analyses(tmp_path: Path, upload: Upload) -> None:
    with served(data=tmp_path, workers=1, retention=30.0) as client:
        done = upload(client, b"good log")
        clean = client.parts.housekeeping.clean
        clean(datetime.now(UTC) + timedelta(days=29))
        assert client.get(done.headers["Location"]).json()["rmse"]
        clean(datetime.now(UTC) + timedelta(days=31))
        assert client.get(done.headers["Location"]).status_code == 404
        assert client.get("/api/v1/logs").json()["items"] == []
        assert not [path for path in (tmp_path / "objects").rglob("*") if path.is_file()]


def test_what_a_dead_server_left_behind_is_cleared_away(tmp_path: Path) -> None:
    left = tmp_path / "scratch" / "dead"
    left.mkdir(parents=True)
    (left / "upload").write_bytes(b"half")
    with served(data=tmp_path, workers=1):
        wait_until(lambda: not left.exists())
    assert not list((tmp_path / "scratch").iterdir())


def test_lines_for_programs_are_json_and_keep_secrets() -> None:
    def line(name: str, message: str, *arguments: object, error: BaseException | None = None) -> dict[str, object]:
        exception = None if error is None else (type(error), error, None)
        record = logging.LogRecord(name, logging.INFO, "", 0, message, arguments, exception)
        assert HideSecrets().filter(record)
        written = JsonLines().format(record)
        assert "\n" not in written
        fields: dict[str, object] = json.loads(written)
        return fields

    request = line("uvicorn.access", '%s - "%s %s HTTP/%s" %d', "1.2.3.4:5", "GET", "/shared/SECRET/x?y=1", "1.1", 200)
    assert (request["method"], request["path"], request["status"]) == ("GET", "/shared/.../x?y=1", 200)
    assert "SECRET" not in str(request)
    event = line("rotorid.api", "%s failed\nbadly", "it", error=ValueError("because"))
    assert (event["level"], event["message"]) == ("info", "it failed\nbadly")
    assert "ValueError: because" in str(event["exception"])
    assert datetime.fromisoformat(str(event["time"])).tzinfo is not None
