"""Whatever is killed, and whenever: what was accepted is there, and every analysis ends once with its right result."""

import os
import signal
import socket
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path

import pytest

from benchmarks import service as load
from benchmarks import service_faults
from benchmarks._measure import memory
from tests.api import postgresql
from tests.api.conftest import unfinished
from tests.api.programs import Service, descendants, is_analysis, wait_until
from tests.api.visits import ordered, told
from tests.forms import thinned
from tests.paths import ROOT
from tests.s3_server import s3_server


@contextmanager
def started(folder: Path, **settings: str) -> Iterator[Service]:
    with closing(Service(folder, ROTORID_UPLOAD_RATE="", **service_faults.DEATHS, **settings)) as service:
        yield service


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """Run a service on SQLite, which waits a second for its lock."""
    folder = tmp_path_factory.mktemp("service")
    with started(folder, ROTORID_DATABASE=f"sqlite:///{folder / 'rotorid.db'}?timeout=1") as running:
        yield running


@pytest.fixture(scope="module")
def database() -> Iterator[postgresql.Server]:
    with postgresql.running() as server:
        yield server


@pytest.fixture(scope="module")
def service_on_postgresql(database: postgresql.Server, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    with started(tmp_path_factory.mktemp("service"), ROTORID_DATABASE=database.url) as running:
        yield running


@pytest.mark.slow
@pytest.mark.parametrize("of", thinned(["service", "service_on_postgresql"], 2))
def test_kills_lose_nothing_and_do_nothing_twice(of: str, request: pytest.FixtureRequest) -> None:
    """A small version of `benchmarks/service_faults.py`, once of each kind: a server takes some seconds to be back."""
    assert service_faults.kill_at_random(request.getfixturevalue(of), kills=3) == (0, 0)


def begun(service: Service, go_on: Path) -> tuple[str, str]:
    """Make a log analysed until the file `go_on` is there; gives the log's id and the analysis's address."""
    log, address = ordered(service.client, f"until |{go_on}|".encode())
    wait_until(lambda: told(service.client, address, "stage") == "transfer functions")
    return log, address


@pytest.mark.whole
def test_a_database_that_is_gone_for_longer_than_a_lease_delays_but_breaks_nothing(
    tmp_path: Path, database: postgresql.Server, service_on_postgresql: Service
) -> None:
    """The analysis comes to its end meanwhile."""
    service, go_on = service_on_postgresql, tmp_path / "go on"
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
def test_a_locked_database_delays_but_breaks_nothing(service: Service, tmp_path: Path) -> None:
    go_on = tmp_path / "go on"
    _, address = begun(service, go_on)
    with closing(sqlite3.connect(service.data / "rotorid.db", isolation_level=None)) as blocker:
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
def test_what_died_in_the_middle_of_an_upload_leaves_nothing(service: Service) -> None:
    before = service.client.get("/api/v1/logs").json()
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
    assert service.client.get("/api/v1/logs").json() == before


@pytest.mark.slow
def test_processes_end_with_a_server_that_was_killed(service: Service, tmp_path: Path) -> None:
    log, address = ordered(service.client, f"until |{tmp_path / 'never'}|".encode())
    assert service.client.get(f"/api/v1/logs/{log}/messages").status_code == 422  # by the process that answers
    wait_until(lambda: bool(service.workers()))
    left = descendants(service.process.pid)
    assert len(left) == 4  # with the one that they are forked from, and Python's own
    service.kill()
    wait_until(lambda: not any(is_alive(pid) for pid in left))
    service.start()
    service.client.post(f"{address}/cancel")


def is_alive(pid: int) -> bool:
    """Return whether a process runs: not one that only waits to be buried."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except (FileNotFoundError, ProcessLookupError):
        return False


@pytest.fixture
def elsewhere() -> Iterator[dict[str, str]]:
    """Run PostgreSQL and S3; gives the settings that lead there."""
    s3fs = pytest.importorskip("s3fs")
    with s3_server(), postgresql.running() as server:
        s3fs.S3FileSystem().mkdir("bucket")
        yield {"ROTORID_DATABASE": server.url, "ROTORID_STORAGE": "s3://bucket/rotorid", "ROTORID_LEASE": "3"}


def start_worker(folder: Path, settings: dict[str, str]) -> subprocess.Popen[bytes]:
    """Start a worker that shares nothing with the server but the database and the storage."""
    own = {"ROTORID_DATA": str(folder), "ROTORID_WORKERS": "1", **settings}
    return subprocess.Popen([sys.executable, "-m", "tests.api.serving"], cwd=ROOT, env=os.environ | own)


@pytest.mark.whole
def test_workers_elsewhere_do_the_work_and_may_die(elsewhere: dict[str, str], tmp_path: Path) -> None:
    with ExitStack() as stack:
        service = stack.enter_context(closing(Service(tmp_path / "server", **elsewhere | {"ROTORID_WORKERS": "0"})))
        analyses = [ordered(service.client, b"slow %d" % number)[1] for number in range(3)]

        def states() -> list[str]:
            return [told(service.client, address, "state") for address in analyses]

        assert set(states()) == {"queued"}  # the server itself does nothing
        first = start_worker(tmp_path / "first", elsewhere)
        wait_until(lambda: any(is_analysis(pid) for pid in descendants(first.pid)))
        for pid in [first.pid, *descendants(first.pid)]:
            os.kill(pid, signal.SIGKILL)
        first.wait()
        second = start_worker(tmp_path / "second", elsewhere)
        wait_until(lambda: set(states()) == {"done"}, pause=0.3)
        for address in analyses:
            answer = service.client.get(address, params={"include": "report"}).json()
            assert answer["report"]["bytes"] == 6
            assert service.client.get(answer["links"]["rmse.csv"]).text.startswith("flight,x,y,z")
        # Told to stop, a worker gives back what it works on, and it counts as not begun.
        _, address = ordered(service.client, b"hang")
        wait_until(lambda: told(service.client, address, "state") == "running")
        second.terminate()
        assert second.wait() == 0
        given_back = service.client.get(address).json()
        assert (given_back["state"], given_back["attempts"]) == ("queued", 0)


@pytest.mark.whole
def test_many_uploads_at_once_are_all_kept_and_a_large_one_passes_through(tmp_path: Path) -> None:
    """With the patience of users' services: ten seconds were too few on a computer whose disk was busy."""
    with started(tmp_path) as service:
        address, pid = str(service.client.base_url), service.process.pid
        assert load.upload_many(address, clients=50, size=1 * load.MB) == []
        assert memory("VmHWM", pid) < 300 * load.MB
        assert load.upload_large(address, pid, size=150 * load.MB) < 50
