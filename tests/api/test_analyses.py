"""An analysis ends with its results or with a reason, whatever its process does, and the service goes on."""

import json
import multiprocessing
import re
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import pytest

from api import Settings
from api.settings import LogFormat
from api.work.worker import Task, TaskLimits, run
from tests.api import standins
from tests.api.conftest import EVERYTHING, Upload, served
from tests.api.programs import wait_until
from tests.api.visits import ordered, told


def test_one_call_answers_with_models_and_report(service: httpx.Client, upload: Upload) -> None:
    # Equal logs are one, by the name that came first: this one is of this test alone.
    response = upload(service, b"good log that answers", "paper01.BIN")
    assert response.status_code == 201
    answer = response.json()
    assert answer["state"] == "done"
    assert answer["log"]["name"] == "paper01.BIN"
    # NaN is no JSON; what was not determined is null.
    assert answer["report"] == {
        "name": "paper01.BIN",
        "rmse": [{"axis": "x", "rmse": 0.25}],
        "bytes": 21,
        "nothing": None,
    }
    assert answer["models"] == {"models": []}
    assert service.get(response.headers["Location"], params={"include": EVERYTHING}).json() == answer
    short = service.get(response.headers["Location"]).json()
    assert (short["report"], short["models"], short["findings"]) == (None, None, None)
    assert short["rmse"] == [{"axis": "x", "rmse": 0.25}]
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


def test_a_bug_is_logged_with_its_traceback_under_the_reference_that_its_user_is_told(
    service: httpx.Client, upload: Upload, caplog: pytest.LogCaptureFixture
) -> None:
    detail = upload(service, b"bug that is logged").json()["detail"]
    (line,) = [record.getMessage() for record in caplog.records if "met a bug" in record.getMessage()]
    assert re.findall("[0-9a-f]{32}", line) == re.findall("[0-9a-f]{32}", detail)
    assert "KeyError: 'surprise'" in line
    assert "standins.py" in line


def test_what_the_pipeline_logs_in_a_worker_is_written(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """A bug that costs a report one part is no failure, and its traceback must not be lost."""
    receiver, sender = multiprocessing.Pipe(duplex=False)
    (tmp_path / "log").write_bytes(b"mumble")
    (tmp_path / "results").mkdir()
    task = Task([(tmp_path / "log", "log")], {}, tmp_path / "results")
    process = multiprocessing.get_context("spawn").Process(
        target=run, args=(sender, standins.analyze, task, TaskLimits(60.0, 10**9, 10**9), LogFormat.JSON)
    )
    process.start()
    process.join()
    written = [json.loads(line) for line in capfd.readouterr().err.splitlines() if line.startswith("{")]
    assert [(line["logger"], line["message"]) for line in written] == [("rotorid.pipeline", "stage gave up")]
    assert "ZeroDivisionError" in written[0]["exception"]
    receiver.close()


def test_an_analysis_can_be_followed(service: httpx.Client, tmp_path: Path) -> None:
    go_on = tmp_path / "go on"
    log = service.post("/api/v1/logs", files={"file": ("a.bin", f"until |{go_on}|".encode())}).json()
    started = service.post("/api/v1/analyses", json={"log": log["id"]})
    assert started.status_code == 202
    address = started.headers["Location"]
    early = service.get(f"{address}/report.html")
    assert (early.status_code, early.json()["detail"]) == (404, "This analysis is not done yet.")
    wait_until(lambda: told(service, address, "stage") == "transfer functions")
    before = service.get(address).json()
    assert (before["state"], before["progress"]) == ("running", 0.4)
    assert before["happened"] == "<b>motor 4 stopped</b>"  # told before the models
    assert "&lt;b&gt;motor 4 stopped" in service.get(before["links"]["page"]).text
    go_on.touch()
    wait_until(lambda: service.get(address).json()["state"] == "done")
    assert service.get(address).json()["progress"] == 1.0


def test_what_a_stopping_service_was_doing_goes_on_when_it_is_back(tmp_path: Path, upload: Upload) -> None:
    settings, go_on = Settings(data=tmp_path / "data", workers=1), tmp_path / "go on"
    with ThreadPoolExecutor() as clients, served(settings) as client:
        _, address = ordered(client, f"until |{go_on}|".encode())
        wait_until(lambda: told(client, address, "stage") == "transfer functions")
        waiting = clients.submit(upload, client, b"good, but second")  # one worker: this one stands in the queue
        wait_until(lambda: len(client.get("/api/v1/analyses").json()["items"]) == 2)
    assert waiting.result().status_code == 503
    assert "goes on when the service is back" in waiting.result().json()["detail"]
    go_on.touch()
    with served(settings) as client:
        wait_until(lambda: len(client.get("/api/v1/analyses", params={"state": "done"}).json()["items"]) == 2)
        assert client.get(address, params={"include": "report"}).json()["report"]["name"] == "a.bin"
        assert client.get(address).json()["attempts"] == 1
