"""With tokens everybody has only what is theirs, on every route; links, limits and who may delete."""

import re
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import httpx
import pytest
from fastapi import FastAPI
from fastapi.routing import APIRoute
from pydantic import ByteSize
from sqlalchemy import select, update
from typer.testing import CliRunner

from api import Settings
from api.routes import craft_pages, page_forms, pages
from api.settings import Access
from api.store.records import ShareRecord, TokenRecord
from api.web.dependencies import Parts
from rotorid.cli.main import app as command_line
from tests.api import flights
from tests.api.conftest import Served, served
from tests.api.programs import wait_until

BROWSER = {"Accept": "text/html"}


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    settings = Settings(data=tmp_path_factory.mktemp("data"), access=Access.TOKENS, workers=1, logs_limit=4)
    with served(settings, flights.analyze) as client:
        yield client


@pytest.fixture(scope="module")
def parts(service: Served) -> Parts:
    return service.parts


def headers(parts: Parts, owner: str, days: float | None = None) -> dict[str, str]:
    return {"Authorization": f"Bearer {parts.tokens.create(owner, days)}"}


@pytest.fixture(scope="module")
def theirs(service: Served, parts: Parts) -> dict[str, str]:
    """Make a log, an analysis of it and a craft somebody's; return what stands for them in addresses."""
    mine, file = headers(parts, "ann"), {"file": ("a.bin", flights.log(0))}
    answer = service.post("/api/v1/logs", params={"analyze": True}, files=file, headers=mine).json()
    craft = wait_until(lambda: service.get("/api/v1/crafts", headers=mine).json()["items"])[0]["id"]
    ids = {"log_id": answer["log"]["id"], "analysis_id": answer["id"], "craft_id": craft, "note_id": craft}
    return ids | {"name": "report.json", "message": "IMU", "sha256": answer["log"]["sha256"]}


def test_nothing_is_had_without_a_valid_token(service: httpx.Client, parts: Parts) -> None:
    expired = headers(parts, "ann", days=1.0)
    with parts.database.write() as session:
        newest = select(TokenRecord.id).order_by(TokenRecord.created.desc()).limit(1).scalar_subquery()
        past = datetime.now(UTC) - timedelta(seconds=1)
        session.execute(update(TokenRecord).where(TokenRecord.id == newest).values(expires=past))
    for wrong in (
        {},
        {"Authorization": "Bearer x"},
        {"Authorization": "Basic x"},
        {"Authorization": "Bearer"},
        expired,
    ):
        for method, path in (("GET", "/api/v1/logs"), ("POST", "/api/v1/logs"), ("GET", "/api/v1/analyses")):
            refused = service.request(method, path, headers=wrong)
            assert (refused.status_code, refused.json()["type"]) == (401, "urn:rotorid:problem:token-needed")
        assert service.get("/", headers=wrong | BROWSER).headers["Location"].startswith("/sign-in")


def test_only_digests_of_secrets_are_kept(parts: Parts, theirs: dict[str, str]) -> None:
    secret = parts.tokens.create("eve")
    link, _ = parts.shares.create(theirs["analysis_id"], None)
    file = parts.settings.data / "rotorid.db"
    kept = b"".join(path.read_bytes() for path in file.parent.glob("rotorid.db*"))
    assert secret.encode() not in kept
    assert link.encode() not in kept


#: What routes want to be told, by the end of their paths.
BODIES = {"craft_id}": {"name": "mine"}, "/merge": {"craft": "0" * 32}, "/notes": {"text": "mine"}}


def test_every_route_hides_what_is_another_s(service: Served, parts: Parts, theirs: dict[str, str]) -> None:
    """Another owner's id is answered as an id that never was, whatever is done with it."""
    mine = headers(parts, "bob")
    seen = 0
    for method, path in operations(service.app):
        if not re.search("{(log|analysis|craft)_id}", path):
            continue
        seen += 1
        their = re.sub(r"{(\w+)(:path)?}", lambda match: theirs[match[1]], path)
        nobodys = re.sub("[0-9a-f]{32}", "0" * 32, their)
        body: dict[str, Any] = {}
        if method in ("POST", "PUT") and path.startswith("/api/"):
            body = {"json": next((body for end, body in BODIES.items() if path.endswith(end)), None)}
        elif method == "POST":
            body = {"data": {"days": "7", "name": "mine", "text": "mine", "craft": "0" * 32, "flights": "0" * 32}}
        answers = [service.request(method, address, headers=mine, **body) for address in (their, nobodys)]
        assert [answer.status_code for answer in answers] == [404, 404], (method, path)
        assert "of this id" in answers[0].json()["detail"]
        assert answers[0].content == answers[1].content
    assert seen >= 30
    for named in ({"log": theirs["log_id"]}, {"logs": [theirs["log_id"]]}):
        refused = service.post("/api/v1/analyses", json=named, headers=mine)
        assert (refused.status_code, refused.json()["type"]) == (422, "urn:rotorid:problem:unknown-log")
    for path, more in (("/api/v1/logs", {}), ("/api/v1/analyses", {"log": theirs["log_id"]}), ("/api/v1/crafts", {})):
        for cursor in ({}, {"after": theirs["log_id"]}, {"after": theirs["analysis_id"]}, more):
            assert service.get(path, params=cursor, headers=mine).json()["items"] == []
    # The same bytes are another log of another owner, of another craft.
    file = {"file": ("a.bin", flights.log(0))}
    again = service.post("/api/v1/logs", params={"analyze": True}, files=file, headers=mine).json()
    assert again["log"]["id"] != theirs["log_id"]
    (craft,) = wait_until(lambda: service.get("/api/v1/crafts", headers=mine).json()["items"])
    assert craft["id"] != theirs["craft_id"]
    (flight,) = service.get(f"/api/v1/crafts/{theirs['craft_id']}/flights", headers=headers(parts, "ann")).json()
    move = {"flights": [flight["id"]]}
    assert service.post("/api/v1/crafts/flights/move", json=move, headers=mine).status_code == 404
    merge = {"craft": theirs["craft_id"]}
    assert service.post(f"/api/v1/crafts/{craft['id']}/merge", json=merge, headers=mine).status_code == 404
    # And whose they are has them still.
    owner = headers(parts, "ann")
    assert service.get(f"/api/v1/logs/{theirs['log_id']}", headers=owner).status_code == 200
    assert service.get(f"/api/v1/analyses/{theirs['analysis_id']}/report.json", headers=owner).status_code == 200


def operations(app: FastAPI) -> Iterator[tuple[str, str]]:
    """List methods and paths: of the interface for programs, and of the pages."""
    for path, methods in app.openapi()["paths"].items():
        for method in methods:
            yield method.upper(), path
    for router in (pages.router, page_forms.router, craft_pages.router, craft_pages.forms):
        for route in router.routes:
            assert isinstance(route, APIRoute)
            for method in route.methods - {"HEAD"}:
                yield method, route.path


def test_a_link_lets_read_one_analysis_until_it_is_taken_back(
    service: httpx.Client, parts: Parts, theirs: dict[str, str]
) -> None:
    owner = headers(parts, "ann")
    shares = f"/api/v1/analyses/{theirs['analysis_id']}/shares"
    link = service.post(shares, params={"days": 2}, headers=owner).json()
    forever = service.post(shares, headers=owner).json()
    assert link["expires"]
    assert forever["expires"] is None
    shown = service.get(link["api"]).json()
    assert shown["report"]["name"] == "a"
    mine = service.get(f"/api/v1/analyses/{theirs['analysis_id']}", headers=owner).json()
    texts = [service.get(link["api"]).text, service.get(forever["url"]).text]
    for address in (*shown["links"].values(), forever["api"]):
        answer = service.get(address)
        assert answer.status_code == 200
        texts += [answer.text] * (address not in (shown["links"]["self"], shown["links"]["page"]))
        assert service.delete(address).status_code in (404, 405)
    for hidden in ("analysis_id", "log_id", "sha256"):
        assert not [text for text in texts if theirs[hidden] in text], hidden
    assert theirs["sha256"] in service.get(mine["links"]["report.json"], headers=owner).text
    assert not [name for name in shown["files"] if name == "flights.json" or name.startswith("experiments/")]
    for name in mine["files"].keys() - shown["files"].keys():
        assert service.get(f"{link['api']}/{name}").status_code == 404
    for path in ("/tables/../../x", "/..%2f..%2fx", "/nothing", "/cancel", "/shares"):
        assert service.get(link["api"] + path).status_code == 404
    with parts.database.write() as session:
        past = datetime.now(UTC) - timedelta(seconds=1)
        session.execute(update(ShareRecord).where(ShareRecord.expires.is_not(None)).values(expires=past))
    assert service.get(link["api"]).status_code == 404
    assert service.get(forever["url"]).status_code == 200
    assert service.delete(shares, headers=owner).status_code == 204
    for address in (forever["api"], forever["url"], forever["api"] + "/report.html"):
        assert service.get(address).status_code == 404


def test_whoever_has_its_delete_token_may_delete_a_log(service: httpx.Client, parts: Parts) -> None:
    owner = headers(parts, "carl")
    logs = [
        service.post("/api/v1/logs", files={"file": ("a.bin", content)}, headers=owner).json()
        for content in (b"first", b"second")
    ]
    address = f"/api/v1/logs/{logs[0]['id']}"
    assert service.delete(address, headers={"Delete-Token": logs[1]["delete_token"]}).status_code == 404
    assert service.delete(address, headers={"Delete-Token": "x"}).status_code == 404
    assert service.delete(address).status_code == 401
    assert service.get(address, headers={"Delete-Token": logs[0]["delete_token"]}).status_code == 401
    assert service.delete(address, headers={"Delete-Token": logs[0]["delete_token"]}).status_code == 204
    assert service.get(address, headers=owner).status_code == 404
    assert service.get(f"/api/v1/logs/{logs[1]['id']}", headers=owner).status_code == 200


def test_an_owner_has_so_many_logs_and_no_more(service: httpx.Client, parts: Parts) -> None:
    owner = headers(parts, "dora")
    files = [("file", (f"{number}.bin", b"log %d" % number)) for number in range(5)]
    together = service.post("/api/v1/logs", files=files, headers=owner)
    assert (together.status_code, together.json()["type"]) == (403, "urn:rotorid:problem:too-many-logs")
    assert service.get("/api/v1/logs", headers=owner).json()["items"] == []  # all or none
    assert service.post("/api/v1/logs", files=files[:4], headers=owner).status_code == 201
    assert service.post("/api/v1/logs", files=files[4:], headers=owner).status_code == 403
    assert service.post("/api/v1/logs", files=files[4:], headers=headers(parts, "emil")).status_code == 201


def test_an_owner_has_so_many_bytes_and_orders_and_uploads_and_no_more(tmp_path: Path) -> None:
    settings = Settings(data=tmp_path, access=Access.TOKENS, bytes_limit=ByteSize(1000), queue_limit=2, workers=1)
    with served(settings.model_copy(update={"upload_rate": "3/hour"})) as client:
        ann, bob = (headers(client.parts, owner) for owner in ("ann", "bob"))

        def post(content: bytes, owner: dict[str, str]) -> httpx.Response:
            return client.post("/api/v1/logs", files={"file": ("a.bin", content)}, headers=owner)

        log = post(b"hang".ljust(600), ann).json()
        refused = post(bytes(600), ann)
        assert (refused.status_code, refused.json()["type"]) == (403, "urn:rotorid:problem:too-many-bytes")
        assert len(list((tmp_path / "objects" / "logs").iterdir())) == 1
        assert post(bytes(600), bob).status_code == 201
        orders = [client.post("/api/v1/analyses", json={"log": log["id"]}, headers=ann) for _ in range(3)]
        assert [order.status_code for order in orders] == [202, 202, 429]
        assert orders[2].json()["type"] == "urn:rotorid:problem:too-many-analyses"
        assert client.post(f"{orders[0].headers['Location']}/cancel", headers=ann).status_code == 200
        assert client.post("/api/v1/analyses", json={"log": log["id"]}, headers=ann).status_code == 202
        assert post(b"third", ann).status_code == 201
        refused = post(b"fourth", ann)
        assert (refused.status_code, refused.json()["type"]) == (429, "urn:rotorid:problem:too-many-uploads")
        assert 3500 <= int(refused.headers["Retry-After"]) <= 3600
        assert post(b"fourth", bob).status_code == 201


@pytest.mark.parametrize(
    ("settings", "known", "problem"),
    [
        ({"hosts": "drone.lab, other.lab"}, ("drone.lab:8000", "OTHER.lab", "localhost"), "unknown-host"),
        ({"local_only": True}, ("localhost:8000", "127.0.0.1:8000", "[::1]:8000"), "local-only"),
    ],
)
def test_a_service_answers_under_its_own_names_only(
    tmp_path: Path, settings: dict[str, Any], known: tuple[str, ...], problem: str
) -> None:
    with served(data=tmp_path, workers=1, access=Access.OPEN, **settings) as client:
        for path in ("/", "/api/v1/logs", "/healthz", "/static/style.css", "/shared/x", "/nothing"):
            for host in known:
                assert client.get(path, headers={"Host": host}).status_code != 421, (path, host)
            for host in ("evil.example", "evil.example:8000", "127.0.0.1.evil.example", "10.0.0.1"):
                refused = client.get(path, headers={"Host": host})
                assert (refused.status_code, refused.json()["type"].rpartition(":")[2]) == (421, problem), (path, host)


def test_tokens_are_made_listed_and_revoked_on_the_command_line(
    service: httpx.Client, parts: Parts, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROTORID_DATA", str(parts.settings.data))

    def rotorid(*words: str) -> str:
        result = CliRunner().invoke(command_line, ["token", *words])
        assert result.exit_code == 0, result.output
        return result.output.strip()

    secret = rotorid("create", "fred", "--days", "30")
    mine = {"Authorization": f"Bearer {secret}"}
    assert service.get("/api/v1/logs", headers=mine).status_code == 200
    listed = [line for line in rotorid("list").splitlines() if "fred" in line]
    assert len(listed) == 1
    assert secret not in listed[0]
    rotorid("revoke", listed[0].split()[0])
    assert service.get("/api/v1/logs", headers=mine).status_code == 401
    assert "fred" not in rotorid("list")
    for owner in ("", " ", "x" * 101):
        assert CliRunner().invoke(command_line, ["token", "create", owner]).exit_code != 0
