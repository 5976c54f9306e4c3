"""Whatever is killed, and whenever: what was accepted is there, and every analysis ends once with its right result."""

import os
import random
import signal
import socket
import sqlite3
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.api import postgresql
from tests.api.conftest import unfinished
from tests.api.programs import Service, wait_until


@pytest.fixture(params=["sqlite", "postgresql"])
def service(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Service]:
    """Run a service on each of the databases."""
    with ExitStack() as stack:
        settings = {}
        if request.param == "postgresql":
            settings["ROTORID_DATABASE"] = stack.enter_context(postgresql.running()).url
        running = Service(tmp_path / "data", **settings)
        stack.callback(running.close)
        yield running


@pytest.mark.slow
@pytest.mark.parametrize(("service", "kills"), [("sqlite", 30), ("postgresql", 8)], indirect=["service"])
def test_kills_lose_nothing_and_do_nothing_twice(service: Service, kills: int) -> None:
    """Kill workers, the server or both at random moments while analyses are in all of their stages."""
    chance = random.Random(20261121)
    accepted: dict[str, bytes] = {}
    analyses: dict[str, str] = {}
    for number in range(kills):
        content = b"slow %d" % number
        log = service.client.post("/api/v1/logs", files={"file": (f"{number}.bin", content)}).json()["id"]
        accepted[log] = content
        analyses[service.client.post("/api/v1/analyses", json={"logs": [log]}).headers["Location"]] = log
        time.sleep(chance.uniform(0.0, 0.6))
        victim = chance.choice(["worker", "server", "both"])
        if victim in ("worker", "both"):
            for pid in service.workers():
                os.kill(pid, signal.SIGKILL)
        if victim in ("server", "both"):
            service.kill()
            service.start()

    def all_ended() -> bool:
        return all(service.client.get(address).json()["ended"] for address in analyses)

    wait_until(all_ended, pause=0.5)
    for address, log in analyses.items():
        answer = service.client.get(address).json()
        if answer["state"] == "failed":  # its workers were shot as often as an analysis is begun
            assert answer["attempts"] >= 5
            assert answer["problem"]["type"] in (
                "urn:rotorid:problem:analysis-crashed",
                "urn:rotorid:problem:analysis-too-large",
            )
            continue
        assert answer["state"] == "done"
        assert answer["report"]["bytes"] == len(accepted[log])
        assert service.client.get(f"{address}/rmse.csv").text.startswith("flight,")
    for log, content in accepted.items():
        assert (service.data / "objects" / "logs" / log).read_bytes() == content
    assert sum(service.client.get(address).json()["state"] == "done" for address in analyses) >= kills - 2


@pytest.mark.slow
def test_a_database_that_is_gone_for_ten_seconds_delays_but_breaks_nothing(tmp_path: Path) -> None:
    with postgresql.running() as database:
        service = Service(tmp_path / "data", ROTORID_DATABASE=database.url)
        try:
            log = service.client.post("/api/v1/logs", files={"file": ("a.bin", b"slow one")}).json()["id"]
            address = service.client.post("/api/v1/analyses", json={"logs": [log]}).headers["Location"]
            wait_until(lambda: service.client.get(address).json()["state"] == "running")
            database.stop()
            gone = time.monotonic()
            for refused in (
                service.client.post("/api/v1/logs", files={"file": ("b.bin", b"another")}),
                service.client.post("/api/v1/analyses", json={"logs": [log]}),
                service.client.get(address),
                service.client.get("/readyz"),
                service.client.get("/metrics"),
            ):
                assert refused.status_code == 503
                assert refused.json()["type"] == "urn:rotorid:problem:database-unavailable"
                assert int(refused.headers["Retry-After"]) > 0
            assert service.client.get("/healthz").status_code == 200
            assert not unfinished(service.data)
            time.sleep(max(0.0, gone + 10.0 - time.monotonic()))
            database.start()
            wait_until(lambda: service.client.get("/readyz").status_code == 200)
            wait_until(lambda: service.client.get(address).json()["state"] == "done", pause=0.2)
            assert service.client.post("/api/v1/logs", files={"file": ("b.bin", b"another")}).status_code == 201
        finally:
            service.close()


@pytest.mark.slow
def test_a_locked_database_delays_but_breaks_nothing(tmp_path: Path) -> None:
    service = Service(tmp_path / "data")
    try:
        log = service.client.post("/api/v1/logs", files={"file": ("a.bin", b"slow one")}).json()["id"]
        address = service.client.post("/api/v1/analyses", json={"logs": [log]}).headers["Location"]
        wait_until(lambda: service.client.get(address).json()["state"] == "running")
        blocker = sqlite3.connect(tmp_path / "data" / "rotorid.db", isolation_level=None)
        blocker.execute("BEGIN IMMEDIATE")
        refused = service.client.post("/api/v1/logs", files={"file": ("b.bin", b"another")})
        assert refused.status_code == 503
        assert refused.json()["type"] == "urn:rotorid:problem:database-unavailable"
        assert int(refused.headers["Retry-After"]) > 0
        assert service.client.get(address).status_code == 200  # readers are not held up
        blocker.execute("ROLLBACK")
        blocker.close()
        wait_until(lambda: service.client.get(address).json()["state"] == "done")
        assert service.client.post("/api/v1/logs", files={"file": ("b.bin", b"another")}).status_code == 201
    finally:
        service.close()


@pytest.mark.slow
def test_what_died_in_the_middle_of_an_upload_leaves_nothing(tmp_path: Path) -> None:
    service = Service(tmp_path / "data")
    with socket.create_connection(("127.0.0.1", service.port)) as connection:
        body = b'--b\r\nContent-Disposition: form-data; name="file"; filename="a"\r\n\r\n' + bytes(3_000_000)
        head = (
            "POST /api/v1/logs HTTP/1.1\r\nHost: x\r\nContent-Type: multipart/form-data; boundary=b\r\n"
            f"Content-Length: {len(body) + 1000}\r\n\r\n"
        )
        connection.sendall(head.encode() + body)
        wait_until(lambda: bool(unfinished(service.data)))
        service.kill()
    service.start()
    assert not unfinished(service.data)
    assert service.client.get("/api/v1/logs").json() == {"items": [], "next": None}
    service.close()
