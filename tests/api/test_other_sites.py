"""A page of another site can change nothing through a visitor's browser, and forms work for who loaded their page only.

The browsers here are their requests: Sec-Fetch-Site goes to https and loopback only, Origin goes along everywhere.
"""

import re
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from fastapi.routing import APIRoute

from api import Settings, create_app
from api.routes import craft_pages, page_forms, pages, sign_in
from api.settings import Access
from api.web.own_pages import COOKIE, FIELD, HEADER
from tests.api import standins
from tests.api.conftest import Served, served


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """Run a service that a visitor has signed in to."""
    with served(data=tmp_path_factory.mktemp("data"), access=Access.TOKENS, workers=1, proxies="127.0.0.1") as client:
        del client.headers[HEADER]
        client.cookies.clear()
        client.cookies.set("rotorid_token", client.parts.tokens.create("ann"))
        yield client


#: Cookie of a browser that loaded one of our pages.
SECRET = "s" * 43


def tried(
    service: httpx.Client, scheme: str, host: str, origin: str | None, token: str | None = SECRET
) -> tuple[int, int, int]:
    """Upload, delete by a form and delete by the interface for programs, as a page of an origin does."""
    kept = f"rotorid_token={service.cookies.get('rotorid_token')}"
    mine = [
        service.post("/api/v1/logs", files={"file": (name, name.encode())}, headers={"Cookie": kept}).json()["id"]
        for name in ("form.bin", "program.bin")
    ]
    headers = {"Host": host, "X-Forwarded-Proto": scheme, "Cookie": f"{kept}; {COOKIE}={SECRET}"}
    headers |= {} if origin is None else {"Origin": origin}
    form = {} if token is None else {FIELD: token}
    statuses = (
        service.post("/api/v1/logs", files={"file": ("a.bin", b"theirs")}, headers=headers).status_code,
        service.post(f"/logs/{mine[0]}/delete", data=form, headers=headers).status_code,
        service.delete(f"/api/v1/logs/{mine[1]}", headers=headers).status_code,
    )
    left = [service.get(f"/api/v1/logs/{log}", headers={"Cookie": kept}).status_code == 200 for log in mine]
    assert left == [status == 403 for status in statuses[1:]]
    return statuses


@pytest.mark.parametrize(
    ("scheme", "host", "origin"),
    [
        ("http", "DRONE.lab:80", "http://drone.lab"),
        ("https", "drone.lab", "https://drone.lab"),
        ("http", "[fd00::1]:8000", "http://[fd00::1]:8000"),
        ("https", "localhost", None),  # an old browser, or a program
    ],
)
def test_our_own_pages_and_programs_change_what_they_like(
    service: httpx.Client, scheme: str, host: str, origin: str | None
) -> None:
    assert tried(service, scheme, host, origin) == (201, 303, 204)
    for guess in ("g" * 43, "", None):  # but for a form without the token of its page
        assert tried(service, scheme, host, origin, guess)[1] == 403


@pytest.mark.parametrize(
    ("scheme", "host", "origin"),
    [
        ("http", "drone.lab:8000", "http://drone.lab:9000"),
        ("http", "drone.lab:8000", "http://drone.lab"),
        ("https", "drone.lab", "http://drone.lab"),
        ("http", "127.0.0.1:8000", "http://localhost:8000"),
        ("http", "drone.lab", "http://evil.example@drone.lab.evil.example"),
        ("https", "drone.lab:8443", "http://drone.lab:8443"),
        ("https", "drone.lab:8443", "null"),
        ("http", "drone.lab", ""),
        ("http", "drone.lab", "http://drone.lab:x"),
    ],
)
def test_a_page_of_another_site_changes_nothing(service: httpx.Client, scheme: str, host: str, origin: str) -> None:
    assert tried(service, scheme, host, origin) == (403, 403, 403)


#: Methods and paths of the forms.
FORMS = [
    (method, route.path)
    for router in (pages.router, page_forms.router, sign_in.router, craft_pages.forms)
    for route in router.routes
    if isinstance(route, APIRoute)
    for method in route.methods - {"GET", "HEAD"}
]


def test_no_form_is_taken_without_its_token(service: Served) -> None:
    assert len(FORMS) >= 15
    for method, path in FORMS:
        address = re.sub(r"{\w+(:path)?}", "0" * 32, path)
        for files in (None, {"file": ("a.bin", b"theirs")}):
            answer = service.request(method, address, files=files, data={"text": "x", "flights": "x"})
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


def test_no_route_that_changes_something_answers_another_site(service: Served) -> None:
    operations = [(method.upper(), path) for path, own in service.app.openapi()["paths"].items() for method in own]
    changing = [(method, path) for method, path in operations if method != "GET"]
    assert len(changing) >= 15
    for method, path in (*FORMS, *changing):
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
