"""`rotorid serve` as a user starts it, with the real pipeline and the sample logs."""

import csv
import io
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import httpx
import pandas as pd
import pytest

from tests.api.programs import PATIENCE, free_port, wait_until
from tests.paths import ROOT

SAMPLE = ROOT / "sample_logs" / "octa01_zurich_calm.bin"
ROTORID = Path(sys.executable).with_name("rotorid")


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    port = free_port()
    environment = os.environ | {"ROTORID_DATA": str(tmp_path_factory.mktemp("data"))}
    process = subprocess.Popen(
        [ROTORID, "serve", "--host", "127.0.0.1", "--port", str(port)],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        with httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=1000.0) as client:

            def answers() -> bool:
                assert process.poll() is None, process.stdout and process.stdout.read()
                with suppress(httpx.ConnectError):
                    return client.get("/healthz").is_success
                return False

            wait_until(answers)
            yield client
        process.send_signal(signal.SIGINT)
        output, _ = process.communicate(timeout=PATIENCE)
        assert "Traceback" not in output
    finally:
        process.kill()


@pytest.fixture(scope="module")
def answer(server: httpx.Client) -> httpx.Response:
    """Upload a sample log in one call, as the README does with curl."""
    with SAMPLE.open("rb") as file:
        return server.post(
            "/api/v1/logs",
            params={"analyze": "true", "include": ["report", "models"]},
            files={"file": (SAMPLE.name, file)},
        )


@pytest.mark.slow
def test_a_sample_log_gives_models_and_rmse(server: httpx.Client, answer: httpx.Response) -> None:
    assert answer.status_code == 201, answer.text
    found = answer.json()
    assert found["log"]["name"] == SAMPLE.name
    assert found["report"] == json.loads(server.get(found["links"]["report.json"]).text)
    assert found["models"] == json.loads(server.get(found["links"]["models.json"]).text)
    rows = list(csv.DictReader(io.StringIO(server.get(found["links"]["rmse.csv"]).text)))
    assert {row["part"] for row in rows} == {"training", "held-out"}
    for row, reported in zip(rows, found["report"]["rmse"], strict=True):
        for axis in "xyz":
            assert float(row[f"rmse_{axis}_m"]) == reported["rmse_m"][axis] > 0.0


@pytest.mark.slow
def test_the_report_names_the_log_and_no_path_of_the_server(server: httpx.Client, answer: httpx.Response) -> None:
    links = answer.json()["links"]
    for name in ("report.html", "report.json", "models.json", "rmse.csv"):
        text = server.get(links[name]).text
        assert links["log"].rpartition("/")[2] not in text
        assert "/logs/" not in text
    assert SAMPLE.stem in server.get(links["report.html"]).text
    assert answer.json()["report"]["log"]["file"] == SAMPLE.name


@pytest.mark.slow
def test_the_tables_of_the_log_come_as_parquet(server: httpx.Client, answer: httpx.Response) -> None:
    found = answer.json()
    tables = {name for name in found["files"] if name.startswith("tables/")}
    assert {"tables/imu.parquet", "tables/motors.parquet", "tables/gps.parquet", "tables/attitude.parquet"} <= tables
    whole = server.get(found["links"]["tables/motors.parquet"])
    assert whole.headers["Content-Type"] == "application/vnd.apache.parquet"
    motors = pd.read_parquet(io.BytesIO(whole.content))
    assert motors["t"].is_monotonic_increasing
    assert {"m1", "m8"} <= set(motors.columns)
    end = server.get(found["links"]["tables/motors.parquet"], headers={"Range": "bytes=-4"})
    assert (end.status_code, end.content) == (206, b"PAR1")
    assert server.get(found["links"]["models.mat"]).content[:6] == b"MATLAB"


def test_the_server_itself_does_not_load_the_numerical_packages() -> None:
    code = "import api, sys; print([room for room in ('numpy', 'pandas', 'numba') if room in sys.modules])"
    assert subprocess.check_output([sys.executable, "-c", code], text=True, cwd=ROOT) == "[]\n"
