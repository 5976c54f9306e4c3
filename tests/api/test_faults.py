"""Whatever is killed, and whenever: what was accepted is there, and every analysis ends once with its right result."""

import socket
import sqlite3
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path

import pytest

from benchmarks import service_faults
from tests.api import postgresql
from tests.api.conftest import unfinished
from tests.api.programs import Service, wait_until
from tests.api.visits import ordered, told


@pytest.fixture(params=["sqlite", pytest.param("postgresql", marks=pytest.mark.whole)])
def service(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Service]:
    """Run a service on each of the databases."""
    with ExitStack() as stack:
        settings = dict(service_faults.DEATHS)
        if request.param == "postgresql":
            settings["ROTORID_DATABASE"] = stack.enter_context(postgresql.running()).url
        running = Service(tmp_path / "data", **settings)
        stack.callback(running.close)
        yield running


@pytest.mark.slow
def test_kills_lose_nothing_and_do_nothing_twice(service: Service) -> None:
    """A small version of `benchmarks/service_faults.py`, once of each kind: a server takes some seconds to be back."""
    assert service_faults.kill_at_random(service, kills=3) == (0, 0)


def begun(service: Service, go_on: Path) -> tuple[str, str]:
    """Make a log analysed until the file `go_on` is there; gives the log's id and the analysis's address."""
    log, address = ordered(service.client, f"until |{go_on}|".encode())
    wait_until(lambda: told(service.client, address, "stage") == "transfer functions")
    return log, address


@pytest.mark.whole
def test_a_database_that_is_gone_for_longer_than_a_lease_delays_but_breaks_nothing(tmp_path: Path) -> None:
    """The analysis comes to its end meanwhile."""
    go_on = tmp_path / "go on"
    with (
        postgresql.running() as database,
        closing(Service(tmp_path / "data", ROTORID_DATABASE=database.url)) as service,
    ):
        log, address = begun(service, go_on)
        database.stop()
        gone = time.monotonic()
        go_on.touch()
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
        time.sleep(max(0.0, gone + 4.0 - time.monotonic()))
        database.start()
        wait_until(lambda: service.client.get("/readyz").status_code == 200)
        wait_until(lambda: service.client.get(address).json()["state"] == "done", pause=0.2)
        assert service.client.post("/api/v1/logs", files={"file": ("b.bin", b"another")}).status_code == 201


@pytest.mark.slow
def test_a_locked_database_delays_but_breaks_nothing(tmp_path: Path) -> None:
    go_on = tmp_path / "go on"
    file = tmp_path / "data" / "rotorid.db"
    with closing(Service(tmp_path / "data", ROTORID_DATABASE=f"sqlite:///{file}?timeout=1")) as service:
        _, address = begun(service, go_on)
        with closing(sqlite3.connect(file, isolation_level=None)) as blocker:
            blocker.execute("BEGIN IMMEDIATE")
            go_on.touch()
            refused = service.client.post("/api/v1/logs", files={"file": ("b.bin", b"another")})
            assert refused.status_code == 503
            assert refused.json()["type"] == "urn:rotorid:problem:database-unavailable"
            assert int(refused.headers["Retry-After"]) > 0
            assert service.client.get(address).status_code == 200  # readers are not held up
            blocker.execute("ROLLBACK")
        wait_until(lambda: service.client.get(address).json()["state"] == "done")
        assert service.client.post("/api/v1/logs", files={"file": ("b.bin", b"another")}).status_code == 201


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
