"""An analysis ends with its results or with a reason, whatever its process does, and the service goes on."""

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import pytest

from api import Settings, create_app
from tests.api import standins
from tests.api.conftest import running

Upload = Callable[..., httpx.Response]


def test_one_call_answers_with_models_and_report(service: httpx.Client, upload: Upload) -> None:
    response = upload(service, b"good log", "paper01.BIN")
    assert response.status_code == 201
    answer = response.json()
    assert answer["state"] == "done"
    assert answer["log"]["name"] == "paper01.BIN"
    # NaN is no JSON; what was not determined is null.
    assert answer["report"] == {
        "name": "paper01.BIN",
        "rmse": [{"axis": "x", "rmse": 0.25}],
        "bytes": 8,
        "nothing": None,
    }
    assert answer["models"] == {"models": []}
    assert service.get(response.headers["Location"]).json() == answer
    kinds = {
        name: service.get(answer["links"][name]).headers["Content-Type"] for name in answer["links"] if "." in name
    }
    assert kinds == {
        "report.html": "text/html; charset=utf-8",
        "report.json": "application/json",
        "models.json": "application/json",
        "rmse.csv": "text/csv; charset=utf-8",
        "tables/imu.parquet": "application/vnd.apache.parquet",
    }


@pytest.mark.parametrize(
    ("content", "kind", "says"),
    [
        (b"refused", "unusable-log", "set LOG_BITMASK to include motor outputs"),
        (b"bug", "analysis-crashed", "mistake of rotorid, not yours"),
        (b"crash", "analysis-crashed", "mistake of rotorid, not yours"),
        (b"greedy", "analysis-too-large", "more than the 600 MB"),
    ],
)
def test_a_poisonous_log_fails_alone(
    service: httpx.Client, upload: Upload, content: bytes, kind: str, says: str
) -> None:
    response = upload(service, content)
    assert response.status_code == 422
    assert response.headers["Content-Type"] == "application/problem+json"
    assert response.json()["type"] == f"urn:rotorid:problem:{kind}"
    assert says in response.json()["detail"]
    assert upload(service, b"good log").status_code == 201


def test_an_endless_analysis_is_ended(hasty_service: httpx.Client, upload: Upload) -> None:
    response = upload(hasty_service, b"hang")
    assert response.status_code == 422
    assert response.json()["type"] == "urn:rotorid:problem:analysis-too-slow"
    assert "ended after 1 s" in response.json()["detail"]


def test_an_analysis_can_be_followed(service: httpx.Client) -> None:
    log = service.post("/api/v1/logs", files={"file": ("a.bin", b"slow")}).json()
    started = service.post("/api/v1/analyses", json={"log": log["id"]})
    assert started.status_code == 202
    address = started.headers["Location"]
    early = service.get(f"{address}/report.html")
    assert (early.status_code, early.json()["detail"]) == (404, "This analysis is not done yet.")
    seen = []
    while (answer := service.get(address).json())["state"] not in ("done", "failed"):
        seen.append(answer)
        time.sleep(0.05)
    assert answer["state"] == "done"
    progress = [answer["progress"] for answer in seen]
    assert progress == sorted(progress)
    assert {"parsing", "transfer functions"} & {answer["stage"] for answer in seen}


def test_status_is_quick_while_the_workers_are_busy(service: httpx.Client) -> None:
    logs = [service.post("/api/v1/logs", files={"file": ("a.bin", b"slow")}).json()["id"] for _ in range(4)]
    addresses = [service.post("/api/v1/analyses", json={"log": log}).headers["Location"] for log in logs]
    durations = []
    while any(service.get(address).json()["state"] != "done" for address in addresses):
        start = time.perf_counter()
        assert service.get("/healthz").json() == {"status": "ok"}
        durations.append(time.perf_counter() - start)
    # Two workers and two waiting analyses; an event loop held up by them would answer after seconds.
    assert sorted(durations)[len(durations) // 2] < 0.2


def test_what_a_stopping_service_was_doing_goes_on_when_it_is_back(tmp_path: Path, upload: Upload) -> None:
    settings = Settings(data=tmp_path, workers=1)
    with ThreadPoolExecutor() as clients, running(create_app(settings, standins.analyze, preload=())) as client:
        log = client.post("/api/v1/logs", files={"file": ("a.bin", b"slow")}).json()["id"]
        address = client.post("/api/v1/analyses", json={"log": log}).headers["Location"]
        while client.get(address).json()["stage"] != "transfer functions":
            time.sleep(0.05)
        waiting = clients.submit(upload, client, b"good, but second")  # one worker: this one stands in the queue
        while len(client.get("/api/v1/analyses").json()["items"]) < 2:
            time.sleep(0.05)
    assert waiting.result().status_code == 503
    assert "goes on when the service is back" in waiting.result().json()["detail"]
    with running(create_app(settings, standins.analyze, preload=())) as client:
        while client.get("/api/v1/analyses", params={"state": "done"}).json()["items"][1:] == []:
            time.sleep(0.05)
        assert client.get(address).json()["report"]["name"] == "a.bin"
        assert client.get(address).json()["attempts"] == 1


def test_a_data_folder_that_cannot_be_written_is_known_at_the_start(tmp_path: Path) -> None:
    (tmp_path / "data").write_text("a file where the folder should be")
    with pytest.raises(OSError, match="data"):
        create_app(Settings(data=tmp_path / "data"))
