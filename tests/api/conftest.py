import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest
import uvicorn
from fastapi import FastAPI

from api import Settings, create_app
from tests.api import standins


@contextmanager
def running(app: FastAPI) -> Iterator[httpx.Client]:
    """Serve an application on a free port, over real sockets, and give a client for it."""
    server = uvicorn.Server(uvicorn.Config(app, log_config=None, timeout_graceful_shutdown=1))
    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
        thread.start()
        try:
            with httpx.Client(base_url=f"http://127.0.0.1:{listener.getsockname()[1]}", timeout=60.0) as client:
                yield client
        finally:
            server.should_exit = True
            thread.join()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give the data folder of the module's service."""
    return tmp_path_factory.mktemp("data")


@pytest.fixture(scope="module")
def service(folder: Path) -> Iterator[httpx.Client]:
    """Run a service whose pipeline is a stand-in, with limits that a test can reach."""
    settings = Settings(
        data=folder, upload_limit=4_000_000, upload_stall=0.5, workers=2, time_limit=5.0, memory_limit=10**9
    )
    with running(create_app(settings, standins.analyze, preload=())) as client:
        yield client


@pytest.fixture(scope="session")
def upload() -> Callable[..., httpx.Response]:
    """Give a function that uploads bytes as a file and has them analysed."""

    def post(client: httpx.Client, content: bytes, name: str = "flight.bin", **parameters: object) -> httpx.Response:
        return client.post("/api/v1/logs", params={"analyze": True, **parameters}, files={"file": (name, content)})

    return post
