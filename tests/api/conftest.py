import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
from fastapi import FastAPI

from api import Settings, create_app
from api.server import Server
from api.web import own_pages
from api.web.dependencies import Parts
from api.work.worker import Analyze
from tests.api import standins
from tests.api.programs import PATIENCE

#: Uploads bytes as a file and has them analysed.
Upload = Callable[..., httpx.Response]

#: What an answer holds only where it is asked for.
EVERYTHING = ["report", "models", "findings"]


def unfinished(data: Path) -> list[Path]:
    """List the uploads in a data folder that are still arriving."""
    return [path for path in (data / "scratch").glob("*/*") if path.is_file()]


@pytest.fixture(scope="session", autouse=True)
def _analyses_start_at_once(forks: None) -> None:
    """Nearly every module here has its service analyse something."""


class Served(httpx.Client):
    """A client of a service that runs in this process, whose application and parts a test may reach into."""

    app: FastAPI
    parts: Parts


@contextmanager
def served(
    settings: Settings | None = None, analyze: Analyze = standins.analyze, *, local_only: bool = False, **named: Any
) -> Iterator[Served]:
    """Serve on a free port, over real sockets, under settings that are given or named; with a stand-in pipeline."""
    app = create_app(settings or Settings(**named), analyze, preload=(), local_only=local_only)
    server = Server(app, app.state.parts.settings)
    listener = socket.create_server(("127.0.0.1", 0))
    # Connections inherit it. A listener that uvicorn makes has it from asyncio; without, each answer waits for 40 ms.
    listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    address = f"http://127.0.0.1:{listener.getsockname()[1]}"
    with listener, Served(base_url=address, timeout=PATIENCE) as client:
        client.app, client.parts = app, app.state.parts
        # A browser has these from the page whose form it posts.
        client.cookies.set(own_pages.COOKIE, "t" * 43)
        client.headers[own_pages.HEADER] = "t" * 43
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
        thread.start()
        try:
            yield client
        finally:
            server.should_exit = True
            thread.join()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the data folder of the module's service."""
    return tmp_path_factory.mktemp("data")


@pytest.fixture(scope="module")
def service(folder: Path) -> Iterator[httpx.Client]:
    """Run a service whose pipeline is a stand-in, with limits that a test can reach."""
    with served(data=folder, upload_limit=4_000_000, workers=2, memory_limit=600_000_000) as client:
        yield client


@pytest.fixture
def hasty_service(tmp_path: Path) -> Iterator[httpx.Client]:
    """Run a service that gives uploads half a second."""
    with served(data=tmp_path, upload_stall=0.5, workers=1) as client:
        yield client


@pytest.fixture(scope="session")
def upload() -> Callable[..., httpx.Response]:
    """Return a function that uploads bytes as a file and has them analysed."""

    def post(client: httpx.Client, content: bytes, name: str = "flight.bin", **parameters: object) -> httpx.Response:
        return client.post(
            "/api/v1/logs",
            params={"analyze": True, "include": EVERYTHING, **parameters},
            files={"file": (name, content)},
        )

    return post
