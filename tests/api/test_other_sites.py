"""A page of another site can change nothing through a visitor's browser, under whatever name the service is reached.

The browsers here are their requests: Sec-Fetch-Site goes to https and loopback only, Origin goes along everywhere.
"""

import re
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from fastapi import FastAPI
from fastapi.routing import APIRoute

from api import Settings, create_app
from api.routes import page_forms, pages, sign_in
from api.settings import Access
from tests.api import standins
from tests.api.conftest import running


@pytest.fixture(scope="module", params=[Access.OPEN, Access.TOKENS])
def app(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> FastAPI:
    settings = Settings(data=tmp_path_factory.mktemp("data"), access=request.param, workers=1, proxies="127.0.0.1")
    return create_app(settings, standins.analyze, preload=())


@pytest.fixture(scope="module")
def service(app: FastAPI) -> Iterator[httpx.Client]:
    secret = app.state.parts.tokens.create("ann")
    with running(app) as client:
        client.cookies.set("rotorid_token", secret)
        yield client


@pytest.mark.parametrize(
    ("scheme", "host", "origin", "own"),
    [
        ("http", "drone.lab:8000", "http://drone.lab:8000", True),
        ("http", "drone.lab", "http://drone.lab", True),
        ("http", "DRONE.lab:80", "http://drone.lab", True),
        ("https", "drone.lab", "https://drone.lab", True),
        ("https", "drone.lab:443", "https://drone.lab", True),
        ("http", "[::1]:8000", "http://[::1]:8000", True),
        ("http", "drone.lab:8000", None, True),  # a program
        ("http", "drone.lab:8000", "http://evil.example", False),
        ("http", "drone.lab:8000", "http://drone.lab:9000", False),
        ("http", "drone.lab:8000", "http://drone.lab", False),
        ("http", "drone.lab:8000", "https://drone.lab:8000", False),
        ("https", "drone.lab", "http://drone.lab", False),
        ("http", "127.0.0.1:8000", "http://localhost:8000", False),
        ("http", "127.0.0.1:8000", "http://127.0.0.1:3000", False),
        ("http", "drone.lab", "http://drone.lab.evil.example", False),
        ("http", "drone.lab", "http://evil.example@drone.lab.evil.example", False),
        ("http", "drone.lab", "null", False),
        ("http", "drone.lab", "", False),
        ("http", "drone.lab", "http://drone.lab:x", False),
        ("http", "drone.lab", "http://[", False),
    ],
)
def test_only_our_own_origin_uploads_and_deletes(
    service: httpx.Client, scheme: str, host: str, origin: str | None, *, own: bool
) -> None:
    headers = {"Host": host, "X-Forwarded-Proto": scheme} | ({} if origin is None else {"Origin": origin})
    mine = service.post("/api/v1/logs", files={"file": ("mine.bin", b"kept")}).json()["id"]
    answer = service.post("/api/v1/logs", files={"file": ("a.bin", b"theirs")}, headers=headers)
    assert answer.status_code == (201 if own else 403), answer.text
    answer = service.delete(f"/api/v1/logs/{mine}", headers=headers)
    assert answer.status_code == (204 if own else 403)


def test_no_route_that_changes_something_answers_another_site(app: FastAPI, service: httpx.Client) -> None:
    routes = [
        (method, route.path)
        for router in (pages.router, page_forms.router, sign_in.router)
        for route in router.routes
        if isinstance(route, APIRoute)
        for method in route.methods
    ]
    routes += [(method.upper(), path) for path, methods in app.openapi()["paths"].items() for method in methods]
    changing = [(method, path) for method, path in routes if method not in ("GET", "HEAD")]
    assert len(changing) >= 15
    for method, path in changing:
        address = re.sub(r"{\w+(:path)?}", "0" * 32, path)
        for origin in ("http://evil.example", "null"):
            refused = service.request(method, address, headers={"Origin": origin})
            assert (refused.status_code, refused.json()["type"]) == (403, "urn:rotorid:problem:other-site"), path


def test_our_forms_send_an_origin(service: httpx.Client) -> None:
    """Under `no-referrer` a browser sends `Origin: null` with a form (Fetch standard, append a request Origin)."""
    assert service.get("/sign-in").headers["Referrer-Policy"] == "same-origin"


def test_nobody_else_reads_the_database(tmp_path: Path) -> None:
    old = tmp_path / "rotorid.db"
    old.touch(mode=0o644)
    create_app(Settings(data=tmp_path), standins.analyze, preload=()).state.parts.database.close()
    for file in tmp_path.glob("rotorid.db*"):
        assert file.name.endswith("reserve") or file.stat().st_mode & 0o777 == 0o600
