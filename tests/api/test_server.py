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
    """Run the service; what it wrote must be lines of JSON, as it was asked for, without a traceback."""
    port, folder = free_port(), tmp_path_factory.mktemp("server")
    environment = os.environ | {"ROTORID_DATA": str(folder / "data"), "ROTORID_LOG_FORMAT": "json"}
    command = [ROTORID, "serve", "--host", "127.0.0.1", "--port", str(port)]
    with (folder / "written").open("w") as written:
        process = subprocess.Popen(command, env=environment, stderr=written)
    try:
        with httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=1000.0) as client:

            def answers() -> bool:
                assert process.poll() is None, (folder / "written").read_text()
                with suppress(httpx.ConnectError):
                    return client.get("/healthz").is_success
                return False

            wait_until(answers)
            yield client
        process.send_signal(signal.SIGINT)
        process.wait(timeout=PATIENCE)
        lines = [json.loads(line) for line in (folder / "written").read_text().splitlines()]
        assert any("kept in" in line["message"] for line in lines)
        assert not [line for line in lines if "exception" in line]
    finally:
        process.kill()


@pytest.mark.slow
def test_a_sample_log_becomes_models_report_and_tables(server: httpx.Client) -> None:
    """Uploaded and analysed as docs/service.md does with curl; nothing tells where the service keeps it."""
    with SAMPLE.open("rb") as file:
        log = server.post("/api/v1/logs", files={"file": (SAMPLE.name, file)}).json()
    order = {"log": log["id"], "configuration": {"poles": 1, "zeros": 0}}
    address = server.post("/api/v1/analyses", json=order).headers["Location"]
    wait_until(lambda: bool(server.get(address).json()["ended"]))
    answer = server.get(address, params={"include": ["report", "models"]}).json()
    assert answer["report"]["log"]["file"] == answer["log"]["name"] == SAMPLE.name
    texts = {name: server.get(answer["links"][name]).text for name in ("report.html", "report.json", "models.json")}
    assert answer["report"] == json.loads(texts["report.json"])
    assert answer["models"] == json.loads(texts["models.json"])
    assert SAMPLE.stem in texts["report.html"]
    rmse = server.get(answer["links"]["rmse.csv"]).text
    for row, reported in zip(csv.DictReader(io.StringIO(rmse)), answer["report"]["rmse"], strict=True):
        assert row["part"] in ("training", "held-out")
        for axis in "xyz":
            assert float(row[f"rmse_{axis}_m"]) == reported["rmse_m"][axis] > 0.0
    for text in (*texts.values(), rmse):
        assert log["id"] not in text
        assert "/logs/" not in text
    assert {"tables/imu.parquet", "tables/gps.parquet", "tables/attitude.parquet"} <= set(answer["files"])
    motors = pd.read_parquet(io.BytesIO(server.get(answer["links"]["tables/motors.parquet"]).content))
    assert motors["t"].is_monotonic_increasing
    assert {"m1", "m8"} <= set(motors.columns)
    assert server.get(answer["links"]["models.mat"]).content[:6] == b"MATLAB"


def test_the_server_itself_does_not_load_the_numerical_packages() -> None:
    code = "import api, sys; print([room for room in ('numpy', 'pandas', 'numba') if room in sys.modules])"
    assert subprocess.check_output([sys.executable, "-c", code], text=True, cwd=ROOT) == "[]\n"
