"""A page of another site can change nothing through a visitor's browser, and forms work for who loaded their page only.

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
from api.routes import craft_pages, page_forms, pages, sign_in
from api.settings import Access
from api.web.form_tokens import COOKIE, FIELD, HEADER
from tests.api import standins
from tests.api.conftest import running, served


@pytest.fixture(scope="module", params=[Access.OPEN, Access.TOKENS])
def app(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> FastAPI:
    settings = Settings(data=tmp_path_factory.mktemp("data"), access=request.param, workers=1, proxies="127.0.0.1")
    return create_app(settings, standins.analyze, preload=())


@pytest.fixture(scope="module")
def service(app: FastAPI) -> Iterator[httpx.Client]:
    with running(app) as client:
        del client.headers[HEADER]
        client.cookies.clear()
        client.cookies.set("rotorid_token", app.state.parts.tokens.create("ann"))
        yield client


HOSTS = ("127.0.0.1:8000", "localhost", "drone.lab", "drone.lab:8443", "[fd00::1]:8000")
CASES = (
    ("own", "own", True),
    (None, "own", True),  # an old browser, which tells no origin
    ("own", None, False),
    ("own", "guessed", False),
    ("own", "", False),
    (None, None, False),
    ("other port", "own", False),
    ("other scheme", "own", False),
    ("null", "own", False),
    ("http://evil.example", "own", False),
)


@pytest.mark.parametrize(
    ("scheme", "host", "origin", "token", "taken"),
    [  # each case under both schemes, each host under both schemes in taken and refused cases
        (scheme, HOSTS[(k + 2 * (scheme == "https")) % len(HOSTS)], *case)
        for scheme in ("http", "https")
        for k, case in enumerate(CASES)
    ]
    + [(scheme, host, "own", "own", True) for scheme in ("http", "https") for host in HOSTS[1:]],
)
def test_a_form_is_taken_from_its_own_page_only(
    service: httpx.Client, scheme: str, host: str, origin: str | None, token: str | None, *, taken: bool
) -> None:
    headers = {"Host": host, "X-Forwarded-Proto": scheme, "Cookie": service.headers.get("Cookie", "")}
    name = host.rpartition(":")[0] if re.search(r":\d+$", host) else host
    other = {"http": "https", "https": "http"}[scheme]
    headers |= {
        None: {},
        "own": {"Origin": f"{scheme}://{host}"},
        "other port": {"Origin": f"{scheme}://{name}:3000"},
        "other scheme": {"Origin": f"{other}://{host}"},
    }.get(origin, {"Origin": str(origin)})
    kept = service.cookies.get("rotorid_token")
    jar = f"rotorid_token={kept}; {COOKIE}={'s' * 43}"
    fields = {} if token is None else {FIELD: {"own": "s" * 43, "guessed": "g" * 43, "": ""}[token]}
    mine = service.post(
        "/api/v1/logs", files={"file": ("mine.bin", b"kept")}, headers={"Cookie": f"rotorid_token={kept}"}
    ).json()["id"]
    answer = service.post(f"/logs/{mine}/delete", data=fields, headers=headers | {"Cookie": jar})
    assert answer.status_code == (303 if taken else 403), answer.text
    assert (service.get(f"/api/v1/logs/{mine}").status_code == 404) is taken


def test_no_form_is_taken_without_its_token(app: FastAPI, service: httpx.Client) -> None:
    routes = [
        route.path
        for router in (pages.router, page_forms.router, sign_in.router, craft_pages.forms)
        for route in router.routes
        if isinstance(route, APIRoute) and "POST" in route.methods
    ]
    assert len(routes) >= 15
    for path in routes:
        address = re.sub(r"{\w+(:path)?}", "0" * 32, path)
        for files in (None, {"file": ("a.bin", b"theirs")}):
            answer = service.post(address, files=files, data={"text": "x", "flights": "x"})
            assert (answer.status_code, answer.json()["type"].rpartition(":")[2]) == (403, "foreign-form"), path


def test_every_form_of_our_pages_carries_it(service: httpx.Client) -> None:
    assert service.post("/api/v1/logs", files={"file": ("a.bin", b"slow log")}).status_code == 201
    for path in ("/", "/logs", "/analyses", "/crafts", "/sign-in"):
        page = service.get(path)
        secret = service.cookies.get(COOKIE)
        forms = re.findall(r'<form\b[^>]*method="post"[^>]*>(?:<input[^>]*>)?', page.text)
        assert all(f'value="{secret}"' in form or f"{FIELD}={secret}" in form for form in forms), path
    assert service.get("/").text.count(FIELD) >= 1


def test_the_secret_is_kept_from_scripts_and_other_sites(tmp_path: Path) -> None:
    with served(data=tmp_path, workers=1, proxies="127.0.0.1") as client:
        client.cookies.clear()
        cookie = client.get("/", headers={"X-Forwarded-Proto": "https"}).headers["Set-Cookie"]
    assert cookie.startswith(f"{COOKIE}=")
    assert {"HttpOnly", "SameSite=strict", "Secure"} <= set(cookie.split("; "))


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
