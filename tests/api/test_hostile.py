"""Requests that mean harm are refused with a reason or do none, and the service answers the next one."""

import json
import random
import socket
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import BinaryIO

import httpx
import pytest

from tests.api.conftest import Upload, served, unfinished
from tests.api.programs import PATIENCE, wait_until

HEAD = b"POST /api/v1/logs HTTP/1.1\r\nHost: x\r\nContent-Type: multipart/form-data; boundary=b\r\n"
PART = b'--b\r\nContent-Disposition: form-data; name="file"; filename="a.bin"\r\n\r\n'


def connect(client: httpx.Client) -> socket.socket:
    return socket.create_connection((client.base_url.host, client.base_url.port or 80), timeout=PATIENCE)


def exchange(client: httpx.Client, request: bytes) -> bytes:
    """Send bytes as they are and read one answer."""
    with connect(client) as connection, connection.makefile("rb") as answer:
        connection.sendall(request)
        return read_answer(answer)


def read_answer(answer: BinaryIO) -> bytes:
    """Read an answer whose length its head tells."""
    lines = []
    while (line := answer.readline()).strip():
        lines.append(line)
    lengths = [int(line.split(b":")[1]) for line in lines if line.lower().startswith(b"content-length:")]
    return b"".join(lines) + b"\r\n" + (answer.read(lengths[0]) if lengths else b"")


@pytest.fixture(scope="module")
def service(folder: Path) -> Iterator[httpx.Client]:
    """Run a service that takes any number of uploads."""
    with served(data=folder, upload_limit=4_000_000, upload_rate="", workers=2) as client:
        yield client


@pytest.mark.slow
def test_malformed_uploads_are_refused_with_a_reason(service: httpx.Client, folder: Path) -> None:
    """Forms cut, repeated and spoiled at random: each is kept as a log or refused with a 4xx that says why."""
    chance = random.Random(8)
    good = PART + b'data\r\n--b\r\nContent-Disposition: form-data; name="comment"\r\n\r\nx\r\n--b--\r\n'
    pieces = [PART, b"\r\n", b"--b", b"--", b"--b--\r\n", b"\0", b"\xff\xfe", b'"', b";", b":"]
    pieces += [b"Content-Disposition: ", b"name=", b"=?utf-8?b?", b"filename*=utf-8''%00", b"Content-Length: -1\r\n"]
    seen: dict[int, int] = {}

    def spoiled() -> bytes:
        body = bytearray(good)
        for _ in range(chance.randint(1, 6)):
            at = chance.randrange(len(body) + 1)
            match chance.randrange(4):
                case 0:
                    del body[at : at + chance.randint(1, 30)]
                case 1:
                    body[at:at] = chance.choice(pieces)
                case 2:
                    body[at : at + 1] = chance.randbytes(1)
                case 3:
                    body += body[at:]
            del body[100_000:]
        return bytes(body)

    with connect(service) as connection, connection.makefile("rb") as answers:
        for _ in range(100):
            # Four to a packet, over one connection: the time goes into the service and not into the client.
            bodies = [spoiled() for _ in range(4)]
            connection.sendall(b"".join(HEAD + b"Content-Length: %d\r\n\r\n" % len(body) + body for body in bodies))
            for _ in bodies:
                head, _, content_ = read_answer(answers).partition(b"\r\n\r\n")
                status, content = int(head.split()[1]), json.loads(content_)
                seen[status] = seen.get(status, 0) + 1
                assert status in (201, 400, 422), content
                assert status == 201 or len(content["detail"]) > 20
    assert sum(seen.values()) == 400
    assert seen[400] > 100
    assert not unfinished(folder)
    assert service.get("/healthz").status_code == 200


@pytest.mark.parametrize(
    ("request_line", "status"),
    [
        (b"GET /api/v1/logs HTTP/1.1\r\nHost: x\r\nX-A: b\r\n c\r\n\r\n", 200),  # folded, which is one header
        (b"GET /a%0d%0aX-Injected:%201 HTTP/1.1\r\nHost: x\r\n\r\n", 404),
        (b"GET /sign-in?next=/%0d%0aX-Injected:%201 HTTP/1.1\r\nHost: x\r\n\r\n", 303),
        (b"GET /sign-in?next=//evil.example HTTP/1.1\r\nHost: x\r\n\r\n", 303),
        (b"GET /static/..%2f..%2fsettings.py HTTP/1.1\r\nHost: x\r\n\r\n", 404),
        (b"GET /static//etc/passwd HTTP/1.1\r\nHost: x\r\n\r\n", 404),
        (b"GET /../../etc/passwd HTTP/1.1\r\nHost: x\r\n\r\n", 404),
        (b"GET / HTTP/1.1\r\nHost: x\r\nX: " + b"x" * 1_000_000 + b"\r\n\r\n", 400),
        (b"GET / HTTP/1.1\r\n\r\n", 400),
        (b"nonsense\r\n\r\n", 400),
        (b"POST /api/v1/logs HTTP/1.1\r\nHost: x\r\nContent-Length: 1\r\nContent-Length: 2\r\n\r\nab", 400),
        (b"POST /api/v1/logs HTTP/1.1\r\nHost: x\r\nContent-Length: -1\r\n\r\n", 400),
        (HEAD + b"Content-Length: 99999999999999\r\n\r\n", 413),
        (b"POST /api/v1/analyses HTTP/1.1\r\nHost: x\r\nContent-Length: 2000000\r\n\r\n{", 413),
    ],
)
def test_strange_requests(service: httpx.Client, request_line: bytes, status: int) -> None:
    head, _, body = exchange(service, request_line).partition(b"\r\n\r\n")
    assert head.startswith(b"HTTP/1.1 %d " % status)
    lines = head.lower().split(b"\r\n")
    assert not [line for line in lines if line.startswith((b"x-injected", b"location: //", b"location: http"))]
    assert b"root:" not in body
    assert service.get("/healthz").status_code == 200


def test_forms_of_many_parts_long_heads_or_a_long_boundary_are_refused(service: httpx.Client) -> None:
    """200,000 tiny parts once held the event loop for seconds, and a long boundary was a 500."""
    kind = "multipart/form-data; boundary="
    for boundary, body, says in (
        ("b" * 300, b"", "boundary of the form is longer than 256 bytes"),
        ("b", b'--b\r\nContent-Disposition: form-data; name="x"\r\n\r\n\r\n' * 50_000, "Too many fields"),
        ("b", b"--b\r\nX: " + b"x" * 1_000_000, "Maximum header size"),
        ("b", b"--b\r\n" + b"X: y\r\n" * 100_000, "Maximum header count"),
    ):
        refused = service.post("/api/v1/logs", content=body, headers={"Content-Type": kind + boundary})
        assert (refused.status_code, refused.json()["type"]) == (400, "urn:rotorid:problem:bad-upload")
        assert says in refused.json()["detail"]


def test_results_are_found_by_their_names_only(service: httpx.Client, upload: Upload) -> None:
    address = upload(service, b"good log").headers["Location"]
    climbing = ["tables/../../x", "../report.json", "%2e%2e/report.json", "..%2freport.json", "/etc/passwd"]
    for name in (*climbing, "%00", "REPORT.JSON"):
        refused = exchange(service, f"GET {address}/{name} HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n".encode())
        assert refused.startswith(b"HTTP/1.1 404 "), name


def test_large_and_deep_documents_are_refused(service: httpx.Client) -> None:
    post = "/api/v1/analyses"
    json_type = {"Content-Type": "application/json"}
    deep = b'{"configuration": ' * 50_000
    for body, status in (
        (b"x" * 1_100_000, 413),
        (deep, 400),
        (b"[" * 500_000, 400),
        (b'{"logs": ["' + b"x" * 900_000 + b'"]}', 422),
        (b'{"logs": [' + b'"a",' * 200_000 + b'"a"]}', 422),
        (b'{"logs": ["\\ud800"]}', 422),
        (b'{"logs": ["\\u0000"]}', 422),
        (b'{"logs": ["a"], "\\ud800": 1}', 422),
        (b'{"logs": ["a"], "configuration": {"training": ["\\ud800"]}}', 422),
        (b'{"logs": ["a"], "configuration": {"rate": NaN}}', 422),
        (b'{"logs": ["a"], "configuration": {"poles": ' + b"9" * 10_000 + b"}}", 400),
        (b"\xff\xfe", 422),
    ):
        refused = service.post(post, content=body, headers=json_type)
        assert refused.status_code == status, body[:60]
        assert refused.json()["detail"]
        assert len(refused.content) < 20_000
    chunks = service.post(post, content=iter([b"x" * 100_000] * 11), headers=json_type)
    assert chunks.status_code == 413
    many = service.post("/sign-in", content=b"&".join([b"a=b"] * 5000))
    assert many.status_code < 500


def test_text_of_a_log_is_never_markup(service: httpx.Client, upload: Upload) -> None:
    script = "<script>alert(1)</script>"
    for content, state in ((b"good log of a script", "done"), (b"markup", "failed")):
        upload(service, content, f"{script}.bin")
        listed = service.get("/api/v1/analyses", params={"state": state}).json()["items"]
        for page in ("/", "/analyses", listed[0]["links"]["page"]):
            text = service.get(page).text
            assert "<script>alert" not in text
            assert "script&gt;" in text


@pytest.fixture
def impatient_service(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[httpx.Client]:
    monkeypatch.setattr("api.web.middleware.PATIENCE", 1.0)
    with served(data=tmp_path, upload_stall=1.0, workers=1) as client:
        yield client


def drip(connection: socket.socket) -> bytes:
    """Send a byte now and then; gives what is answered before the other side closes."""
    deadline = time.monotonic() + PATIENCE
    connection.settimeout(0.1)
    answer = b""
    while time.monotonic() < deadline:
        try:
            connection.sendall(b"x")
            piece = connection.recv(65536)
        except TimeoutError:
            continue
        except OSError:
            return answer
        if not piece:
            return answer
        answer += piece
    pytest.fail("the connection stays open")


def test_whoever_sends_drop_by_drop_is_cut_off(impatient_service: httpx.Client, tmp_path: Path) -> None:
    begun = {
        "nothing": (b"", b""),
        "head": (b"GET / HTTP/1.1\r\nHost: ", b""),
        "upload": (HEAD + b"Content-Length: 100000\r\n\r\n" + PART, b"HTTP/1.1 408 "),
        "head of upload": (HEAD + b"Content-Length: 1000\r\nX: ", b""),
        "document": (HEAD.replace(b"logs", b"analyses") + b"Content-Length: 1000\r\n\r\n", b"HTTP/1.1 408 "),
        "no route": (HEAD.replace(b"logs", b"nothing") + b"Content-Length: 1000\r\n\r\n", b"HTTP/1.1 408 "),
        "too large": (HEAD + b"Content-Length: 99999999999\r\n\r\n", b"HTTP/1.1 413 "),
    }
    with ExitStack() as stack, ThreadPoolExecutor(len(begun)) as pool:
        connections = [stack.enter_context(connect(impatient_service)) for _ in begun]
        for connection, (begin, _) in zip(connections, begun.values(), strict=True):
            connection.sendall(begin)
        answers = pool.map(drip, connections)
        for (what, (_, status)), answer in zip(begun.items(), answers, strict=True):
            assert answer.startswith(status), what
    assert not unfinished(tmp_path)


def test_a_slow_answer_is_no_reason_to_cut_off(impatient_service: httpx.Client) -> None:
    """Two seconds without a byte from either side; the request comes in one piece, whatever the computer does."""
    body = PART + b"slow log\r\n--b--\r\n"
    head = HEAD.replace(b"/logs ", b"/logs?analyze=true ") + b"Content-Length: %d\r\n\r\n" % len(body)
    assert exchange(impatient_service, head + body).startswith(b"HTTP/1.1 201 ")


def test_many_silent_connections_keep_nobody_out(impatient_service: httpx.Client) -> None:
    silent = [connect(impatient_service) for _ in range(200)]
    assert impatient_service.get("/healthz").status_code == 200
    with connect(impatient_service) as connection, connection.makefile("rb") as answers:
        for _ in range(3):  # one that asks again and again is kept
            connection.sendall(b"GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n")
            assert read_answer(answers).startswith(b"HTTP/1.1 200 ")
            time.sleep(0.4)
    wait_until(lambda: all(_is_closed(connection) for connection in silent))
    for connection in silent:
        connection.close()


def _is_closed(connection: socket.socket) -> bool:
    connection.settimeout(0.0)
    try:
        return connection.recv(1) == b""
    except BlockingIOError:
        return False
