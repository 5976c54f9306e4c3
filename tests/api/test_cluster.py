"""Analyses on a Dask cluster: a scheduler and workers as programs of their own, which may die at any moment."""

import os
import signal
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path

import pytest

from tests.api.programs import Service, children, is_analysis, wait_until
from tests.pipeline.dask_programs import Programs


def descendants(pid: int) -> list[int]:
    """List the children of a process, their children and so on."""
    found = children(pid)
    return found + [each for child in found for each in descendants(child)]


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Programs]:
    with closing(Programs(tmp_path / "cluster")) as started:
        yield started


@pytest.mark.slow
def test_a_worker_and_the_scheduler_die_and_every_analysis_ends_once(cluster: Programs, tmp_path: Path) -> None:
    with ExitStack() as stack:
        # Two at the same time, but the cluster does one: the other waits there for longer than a lease.
        settings = {"ROTORID_SCHEDULER": cluster.address, "ROTORID_WORKERS": "2", "ROTORID_LEASE": "3"}
        service = stack.enter_context(closing(Service(tmp_path / "data", **settings)))
        logs = [
            service.client.post("/api/v1/logs", files={"file": ("a.bin", b"slow %d" % number)}).json()["id"]
            for number in range(2)
        ]
        analyses = [service.client.post("/api/v1/analyses", json={"log": log}).headers["Location"] for log in logs]

        def states() -> list[str]:
            return [service.client.get(address).json()["state"] for address in analyses]

        assert set(states()) == {"queued"}  # the scheduler is not there yet
        scheduler = cluster.start_scheduler()
        first = cluster.start_worker()
        wait_until(lambda: any(is_analysis(pid) for pid in descendants(first.pid)))
        for pid in [first.pid, *descendants(first.pid)]:
            os.kill(pid, signal.SIGKILL)
        cluster.start_worker()
        wait_until(lambda: "done" in states(), pause=0.2)
        scheduler.kill()
        scheduler.wait()
        cluster.start_scheduler()
        cluster.start_worker()
        wait_until(lambda: set(states()) == {"done"}, pause=0.5)
        for address in analyses:
            found = service.client.get(address, params={"include": "report"}).json()
            # How often it was begun is not asked: on a busy computer leases of three seconds run out by themselves.
            assert found["report"]["bytes"] == 6
