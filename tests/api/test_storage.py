"""Storage in a folder and on S3 over HTTP: what is put is whole, read in parts, listed, removed and swept."""

import urllib.request
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import httpx
import pytest

from api import Settings
from pipeline.storage.store import open_store
from tests.api.conftest import served
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
