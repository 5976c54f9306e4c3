"""Whatever is killed, and whenever: what was accepted is there, and every analysis ends once with its right result."""

import os
import random
import signal
import socket
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import httpx
import pytest

from tests.api import postgresql
from tests.api.conftest import unfinished

PROJECT = Path(__file__).parents[2]


class Service:
    """A service in a process of its own."""

    def __init__(self, data: Path, **settings: str) -> None:
        self.data = data
        with socket.create_server(("127.0.0.1", 0)) as free:
            self.port = free.getsockname()[1]
        self._settings = {"ROTORID_DATA": str(data), "ROTORID_WORKERS": "2", "ROTORID_LEASE": "1.5", **settings}
        self.client = httpx.Client(base_url=f"http://127.0.0.1:{self.port}", timeout=30.0)
        self.start()

    def start(self) -> None:
        """Start it and wait until it answers."""
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tests.api.serving", str(self.port)], cwd=PROJECT, env=os.environ | self._settings
        )
        wait_until(self.answers, 60.0)

    def answers(self) -> bool:
        """Say whether it is up."""
        try:
            return self.client.get("/healthz").status_code == 200
        except httpx.TransportError:
            return False

    def kill(self) -> None:
        """Kill the server, as a power cut would."""
        self.process.kill()
        self.process.wait()

    def workers(self) -> list[int]:
        """List the processes of analyses: the children of the process that they are forked from."""
        return [pid for child in children(self.process.pid) for pid in children(child) if is_analysis(pid)]

    def close(self) -> None:
        """End it."""
        self.process.terminate()
        self.process.wait()
        self.client.close()


def children(pid: int) -> list[int]:
    """List the children of a process."""
    try:
        threads = list(Path(f"/proc/{pid}/task").iterdir())
        return [int(child) for thread in threads for child in (thread / "children").read_text().split()]
    except OSError:
        return []


def is_analysis(pid: int) -> bool:
    """Tell a process that analyses, which is nice, from those that keep house for `multiprocessing`."""
    try:
        return os.getpriority(os.PRIO_PROCESS, pid) >= 5
    except ProcessLookupError:
        return False


def wait_until(holds: Callable[[], bool], seconds: float) -> None:
    """Look again and again; fail when something does not come to hold."""
    deadline = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < deadline, "waited too long"
        time.sleep(0.02)


@pytest.fixture(params=["sqlite", "postgresql"])
def service(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Service]:
    """Run a service on each of the databases."""
    if request.param == "sqlite":
        running = Service(tmp_path / "data")
        yield running
        running.close()
        return
    with postgresql.server(tmp_path / "postgresql") as url:
        running = Service(tmp_path / "data", ROTORID_DATABASE=url)
        yield running
        running.close()


@pytest.mark.slow
def test_thirty_kills_lose_nothing_and_do_nothing_twice(service: Service) -> None:
    """Kill workers, the server or both at random moments while analyses are in all of their stages."""
    chance = random.Random(20261121)
    accepted: dict[str, bytes] = {}
    analyses: dict[str, str] = {}
    for number in range(30):
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

    wait_until(all_ended, 120.0)
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
    assert sum(service.client.get(address).json()["state"] == "done" for address in analyses) >= 28


@pytest.mark.slow
def test_a_locked_database_delays_but_breaks_nothing(tmp_path: Path) -> None:
    service = Service(tmp_path / "data")
    try:
        log = service.client.post("/api/v1/logs", files={"file": ("a.bin", b"slow one")}).json()["id"]
        address = service.client.post("/api/v1/analyses", json={"logs": [log]}).headers["Location"]
        wait_until(lambda: service.client.get(address).json()["state"] == "running", 30.0)
        blocker = sqlite3.connect(tmp_path / "data" / "rotorid.db", isolation_level=None)
        blocker.execute("BEGIN IMMEDIATE")
        refused = service.client.post("/api/v1/logs", files={"file": ("b.bin", b"another")})
        assert refused.status_code == 503
        assert refused.json()["type"] == "urn:rotorid:problem:database-unavailable"
        assert int(refused.headers["Retry-After"]) > 0
        assert service.client.get(address).status_code == 200  # readers are not held up
        blocker.execute("ROLLBACK")
        blocker.close()
        wait_until(lambda: service.client.get(address).json()["state"] == "done", 60.0)
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
        wait_until(lambda: bool(unfinished(service.data)), 30.0)
        service.kill()
    service.start()
    assert not unfinished(service.data)
    assert service.client.get("/api/v1/logs").json() == {"items": [], "next": None}
    service.close()
