"""Who has a token signs in with it, leads nobody astray, and reads reports in the sandbox; nobody else does."""

from collections.abc import Iterator
from datetime import timedelta
from typing import NamedTuple

import httpx
import pytest

from api import Settings
from api.access import ReportKeys, Tokens
from api.settings import Access
from api.web.page_templates import local_path
from tests.api.conftest import served

BROWSER = {"Accept": "text/html,application/xhtml+xml"}


class Guarded(NamedTuple):
    """A service with tokens, and two of its users."""

    client: httpx.Client
    tokens: Tokens
    keys: ReportKeys
    late_keys: ReportKeys
    anna: str
    boris: str

    def get(self, path: str, secret: str = "") -> httpx.Response:
        # With the form's secret, as a browser sends it: without, the service gives the client another.
        cookies = {"Cookie": f"rotorid_token={secret}; rotorid_form={'t' * 43}"} if secret else {}
        return self.client.get(path, headers=BROWSER | cookies)


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Guarded]:
    settings = Settings(data=tmp_path_factory.mktemp("guarded"), workers=1, access=Access.TOKENS, proxies="127.0.0.1")
    with served(settings) as client:
        parts = client.parts
        keys, late = ReportKeys(parts.database), ReportKeys(parts.database, timedelta(seconds=-1))
        yield Guarded(client, parts.tokens, keys, late, parts.tokens.create("anna"), parts.tokens.create("boris"))


@pytest.fixture(scope="module")
def analysis(guarded: Guarded) -> str:
    """Return the id of a finished analysis of Anna's."""
    answer = guarded.client.post(
        "/api/v1/logs",
        params={"analyze": True},
        files={"file": ("a.bin", b"good log")},
        headers={"Authorization": f"Bearer {guarded.anna}"},
    )
    return str(answer.json()["id"])


@pytest.mark.parametrize("path", ["/", "/analyses", "/analyses?state=done", f"/analyses/{'0' * 32}"])
def test_a_browser_without_a_token_is_led_to_the_sign_in(guarded: Guarded, path: str) -> None:
    for secret in ("", "wrong"):
        answer = guarded.get(path, secret)
        assert answer.status_code == 303
        assert answer.headers["Location"] == f"/sign-in?next={path.partition('?')[0]}"
    assert guarded.client.get(path).status_code == 401  # a script is told, not led


def test_the_cookie_is_kept_from_scripts_and_other_sites(guarded: Guarded) -> None:
    form = {"token": f" {guarded.anna}\n", "next": "/analyses"}
    for headers, secure in (({}, False), ({"X-Forwarded-Proto": "https"}, True)):
        answer = guarded.client.post("/sign-in", data=form, headers=headers)
        guarded.client.cookies.delete("rotorid_token")
        assert (answer.status_code, answer.headers["Location"]) == (303, "/analyses")
        cookie = answer.headers["Set-Cookie"].lower()
        assert "httponly" in cookie
        assert "samesite=strict" in cookie
        assert ("secure" in cookie) is secure
    wrong = guarded.client.post("/sign-in", data={"token": "wrong"})
    assert wrong.status_code == 401
    assert "Set-Cookie" not in wrong.headers
    other_site = guarded.client.post("/sign-in", data=form, headers={"Sec-Fetch-Site": "cross-site"})
    assert other_site.status_code == 403


def test_signing_in_leads_to_our_own_pages_only() -> None:
    for path in ("/", "/analyses?state=done", "/shared/a%20b"):
        assert local_path(path) == path
    for address in ("https://example.com", "//example.com", "/\\example.com", "javascript:alert(1)", "/a\nb", ""):
        assert local_path(address) == "/"


def test_lists_show_nobody_the_analyses_of_others(guarded: Guarded, analysis: str) -> None:
    assert "a.bin" in guarded.get("/analyses", guarded.anna).text
    assert "a.bin" not in guarded.get("/analyses", guarded.boris).text
    assert guarded.get(f"/analyses/{analysis}", guarded.anna).status_code == 200


def test_a_key_opens_one_report_for_a_while(guarded: Guarded, analysis: str) -> None:
    key = guarded.keys.make(guarded.anna, analysis)
    report = guarded.get(f"/reports/{key}/report.html")
    assert "<title>report</title>" in report.text
    assert "sandbox" in report.headers["Content-Security-Policy"]
    token, _, until, code = key.split(".")
    for forged in (
        f"{token}.{analysis}.{int(until) + 1}.{code}",
        f"{token}.{'0' * 32}.{until}.{code}",
        f"{'0' * 32}.{analysis}.{until}.{code}",
        f"{token}.{analysis}.{until}.{'é' * 64}",
        guarded.keys.make(guarded.boris, analysis),  # who may not read it cannot make a key for it either
        "...",
        "key",
    ):
        assert guarded.get(f"/reports/{forged}/report.html").status_code == 404
    assert guarded.get(f"/reports/{guarded.late_keys.make(guarded.anna, analysis)}/report.html").status_code == 404


def test_a_key_ends_with_its_token(guarded: Guarded, analysis: str) -> None:
    secret = guarded.tokens.create("anna")
    key = guarded.keys.make(secret, analysis)
    assert guarded.get(f"/reports/{key}/report.html").status_code == 200
    guarded.tokens.revoke(guarded.tokens.list()[-1].id)
    assert guarded.get(f"/reports/{key}/report.html").status_code == 404
