"""Workers on other computers: a server that only answers, PostgreSQL, S3, and programs that may die at any moment."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path

import pytest

from tests.api import postgresql
from tests.api.programs import PROJECT, Service, descendants, is_analysis, wait_until
from tests.api.visits import ordered, told
from tests.s3_server import s3_server


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
    return subprocess.Popen([sys.executable, "-m", "tests.api.serving"], cwd=PROJECT, env=os.environ | own)


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
            found = service.client.get(address, params={"include": "report"}).json()
            assert found["report"]["bytes"] == 6
            assert service.client.get(found["links"]["rmse.csv"]).text.startswith("flight,x,y,z")
        # Told to stop, a worker gives back what it works on, and it counts as not begun.
        _, address = ordered(service.client, b"hang")
        wait_until(lambda: told(service.client, address, "state") == "running")
        second.terminate()
        assert second.wait() == 0
        given_back = service.client.get(address).json()
        assert (given_back["state"], given_back["attempts"]) == ("queued", 0)
