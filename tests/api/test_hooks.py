"""Webhooks reach their receivers signed, and nothing that only the service can reach."""

import hashlib
import hmac
import json
import socket
import threading
from collections.abc import Iterator
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import httpx
import pytest

from api import Settings
from api.crafts import hooks
from api.crafts.hooks import ForbiddenAddressError, check_address, resolve, send
from api.settings import Webhooks
from tests.api import flights
from tests.api.conftest import served
from tests.api.visits import fly, only_craft, settled


@pytest.mark.parametrize(
    "url",
    [
        "http://ops.example.org/",
        "file:///etc/passwd",
        "https://",
        "https://user:word@ops.example.org/",
        "https://ops.example.org:22/",
        "https://127.0.0.1/",
        "https://127.1/",
        "https://0/",
        "https://0x7f000001/",
        "https://2130706433/",
        "https://①②⑦.⓪.⓪.①/",
        "https://localhost/",
        "https://10.0.0.5/",
        "https://169.254.169.254/latest/meta-data/",
        "https://100.64.0.1/",
        "https://224.0.0.1/",
        "https://[::1]/",
        "https://[fe80::1]/",
        "https://[::ffff:127.0.0.1]/",
        "https://[64:ff9b::7f00:1]/",
        "https://[2002:7f00:1::]/",
        "https://[::127.0.0.1]/",
        "https://[fec0::1]/",
        "https://hooks.example.org/\u00fc",
        "https://a..example.org/",
        "https://hooks.example.org/a b",
        "nonsense",
    ],
)
def test_what_only_the_service_can_reach_is_refused(url: str) -> None:
    with pytest.raises(ForbiddenAddressError):
        check_address(url, Webhooks.PUBLIC)


@pytest.mark.parametrize("private", ["10.1.2.3", "::ffff:10.0.0.1"])
def test_a_name_that_leads_inside_is_refused_when_it_is_used(monkeypatch: pytest.MonkeyPatch, private: str) -> None:
    """Every address of the name counts: whoever owns it may list a public one first."""
    kind = socket.AF_INET6 if ":" in private else socket.AF_INET
    addresses = [(socket.AF_INET, 1, 6, "", ("93.184.216.34", 443)), (kind, 1, 6, "", (private, 443))]
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: addresses)
    with pytest.raises(ForbiddenAddressError):
        resolve("rebound.example.org", 443, Webhooks.PUBLIC)
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: addresses[:1])
    assert resolve("rebound.example.org", 443, Webhooks.PUBLIC) == "93.184.216.34"


class _Receiver(BaseHTTPRequestHandler):
    got: list[tuple[dict[str, str], bytes]]
    answers: list[int]

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["Content-Length"]))
        type(self).got.append((dict(self.headers), body))
        self.send_response(type(self).answers.pop(0))
        self.send_header("Location", "http://127.0.0.1:1/")
        self.end_headers()

    def log_message(self, *_: object) -> None:
        """Log nothing."""


@pytest.fixture
def receiver() -> Iterator[str]:
    _Receiver.got, _Receiver.answers = [], [302, 500, 204]
    server = HTTPServer(("127.0.0.1", 0), _Receiver)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}/alerts?to=us"
    server.shutdown()
    thread.join()
    server.server_close()


def test_an_alert_is_sent_signed_until_it_is_taken(
    tmp_path: Path, receiver: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hooks, "LOOK_EVERY", 3600.0)  # the test looks itself
    with served(data=tmp_path, workers=1, webhooks=Webhooks.ANY, analyze=flights.analyze) as client:
        made = client.post("/api/v1/hooks", json={"url": receiver}).json()
        fly(client, "crash.bin", flights.log(0, word="motor fault", text="Motor 1 lost 32 ± 3 % of its thrust."))
        craft = settled(client, only_craft(client)["id"])
        now = datetime.now(UTC) + timedelta(seconds=1)
        for tries in range(3):
            client.parts.hooks.deliver(now + timedelta(hours=tries))
            client.parts.hooks.deliver(now + timedelta(hours=tries))  # it is not due yet
        assert len(_Receiver.got) == 3
        client.parts.hooks.deliver(now + timedelta(days=9))
        assert len(_Receiver.got) == 3  # and is sent no more when it was taken
        head, body = _Receiver.got[-1]
        signature = hmac.new(made["secret"].encode(), body, hashlib.sha256).hexdigest()
        assert head["Rotorid-Signature"] == f"sha256={signature}"
        sent = json.loads(body)
        assert (sent["kind"], sent["craft"]["id"]) == ("flight-unhealthy", craft["id"])
        assert sent["text"] == "crash: motor fault. Motor 1 lost 32 ± 3 % of its thrust."
        (hook,) = client.get("/api/v1/hooks").json()
        assert hook["state"].endswith("delivered")
        assert "secret" not in hook
        assert client.delete(f"/api/v1/hooks/{hook['id']}").status_code == 204
        assert client.delete(f"/api/v1/hooks/{hook['id']}").status_code == 404


@pytest.fixture
def dripping() -> Iterator[str]:
    """Run a server that answers one byte in a tenth of a second, for ever."""
    listener, over = socket.create_server(("127.0.0.1", 0)), threading.Event()

    def drip() -> None:
        while not over.is_set():
            with suppress(OSError), listener.accept()[0] as connection:
                while not over.wait(0.1):
                    connection.sendall(b"H")

    thread = threading.Thread(target=drip)
    thread.start()
    yield f"http://127.0.0.1:{listener.getsockname()[1]}/"
    over.set()
    listener.shutdown(socket.SHUT_RDWR)
    thread.join()
    listener.close()


def test_who_answers_byte_by_byte_is_cut_off(dripping: str) -> None:
    """One such address held the webhooks of all owners for as long as it liked: each byte came in time."""
    with pytest.raises(OSError, match=r"no HTTP answer within 0\.5 s"):
        send(dripping, b"{}", "secret", Webhooks.ANY, timeout=0.5)


def test_an_address_that_takes_nothing_is_tried_once_in_a_while_for_all_its_alerts(
    tmp_path: Path, receiver: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hooks, "LOOK_EVERY", 3600.0)  # the test looks itself
    _Receiver.answers[:] = [500, 204, 204]
    with served(data=tmp_path, workers=1, webhooks=Webhooks.ANY, analyze=flights.analyze) as client:
        client.post("/api/v1/hooks", json={"url": receiver})
        for name in ("octa", "quad"):
            fly(client, f"{name}.bin", flights.log(0, craft=name, word="no"))
        for craft in client.get("/api/v1/crafts").json()["items"]:
            settled(client, craft["id"])
        now = datetime.now(UTC) + timedelta(seconds=1)
        client.parts.hooks.deliver(now)
        client.parts.hooks.deliver(now)
        assert len(_Receiver.got) == 1
        client.parts.hooks.deliver(now + timedelta(hours=1))
        assert len(_Receiver.got) == 3


def test_an_inner_address_is_refused_by_the_service(tmp_path: Path) -> None:
    with served(data=tmp_path, workers=1, analyze=flights.analyze) as client:
        answer = client.post("/api/v1/hooks", json={"url": "https://169.254.169.254/"})
        assert (answer.status_code, answer.json()["type"]) == (422, "urn:rotorid:problem:forbidden-address")
    off = Settings(data=tmp_path, workers=1, webhooks=Webhooks.OFF)
    with served(off, analyze=flights.analyze) as client:
        answer: httpx.Response = client.post("/api/v1/hooks", json={"url": "https://ops.example.org/"})
        assert answer.status_code == 422
