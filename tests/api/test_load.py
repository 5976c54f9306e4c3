"""Small versions of `benchmarks/service.py`: many uploads at once are all kept, and large ones pass through."""

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from benchmarks import service as load
from benchmarks._measure import memory
from tests.api.programs import Service


@pytest.fixture
def service(tmp_path: Path) -> Iterator[Service]:
    with closing(Service(tmp_path / "data", ROTORID_UPLOAD_RATE="")) as started:
        yield started


@pytest.mark.slow
def test_many_uploads_at_once_are_all_kept_and_a_large_one_passes_through(service: Service) -> None:
    address, pid = str(service.client.base_url), service.process.pid
    assert load.upload_many(address, clients=50, size=1 * load.MB) == 0
    assert memory("VmHWM", pid) < 300 * load.MB
    assert load.upload_large(address, pid, size=150 * load.MB) < 50
