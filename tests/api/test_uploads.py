"""What arrives, arrives whole or not at all, and no upload of any kind upsets the service."""

import hashlib
import re
import socket
from pathlib import Path

import httpx
import pytest

from tests.api.conftest import unfinished
from tests.api.programs import PATIENCE

BOUNDARY = "b0undary"
FORM = {"Content-Type": f"multipart/form-data; boundary={BOUNDARY}"}


def form(*parts: tuple[str, bytes], end: bool = True) -> bytes:
    """Write a multipart form by hand, so that it can be wrong."""
    body = b"".join(f"--{BOUNDARY}\r\n{head}\r\n\r\n".encode() + data + b"\r\n" for head, data in parts)
    return body + f"--{BOUNDARY}--\r\n".encode() if end else body


def disposition(name: str, filename: str | None = None) -> str:
    return f'Content-Disposition: form-data; name="{name}"' + (f'; filename="{filename}"' if filename else "")


def test_logs_are_kept_byte_for_byte_in_their_order(service: httpx.Client, folder: Path) -> None:
    # Payloads hold what looks like line ends and boundaries; 3 MB is several reads of the socket and several writes.
    large = (bytes(range(256)) + b"\r\n--" + BOUNDARY.encode()[:-1] + b"\r\n") * 11_000
    contents = [b"first of three", large, b"third"]
    parts = [(disposition("file", f"{k}.bin"), content) for k, content in enumerate(contents)]
    body = form((disposition("comment"), b"a small field is ignored"), *parts)
    response = service.post("/api/v1/logs", content=body, headers=FORM)
    assert response.status_code == 201
    logs = response.json()["logs"]
    assert [(log["name"], log["size"]) for log in logs] == [(f"{k}.bin", len(data)) for k, data in enumerate(contents)]
    assert [(folder / "objects" / "logs" / log["id"]).read_bytes() for log in logs] == contents
    shown = service.get(f"/api/v1/logs/{logs[1]['id']}").json()
    assert shown == {name: value for name, value in logs[1].items() if name != "delete_token"}


@pytest.mark.parametrize(
    ("sent", "shown"),
    [
        ("../../../etc/passwd", "passwd"),
        (r"C:\logs\flight 1.bin", "flight 1.bin"),
        ("..", ".."),
        ("a" * 5000, "a" * 200),
        ("\u202eexe.nib", "exe.nib"),
        ("/", "log"),
        ("<script>alert(1)</script>.bin", "script>.bin"),
        ("Flüge/Höhe 🚁.bin", "Höhe 🚁.bin"),
    ],
)
def test_a_name_is_only_for_people(service: httpx.Client, folder: Path, sent: str, shown: str) -> None:
    before = {path.name for path in folder.parent.iterdir()}
    body = form((disposition("file", sent), f"data of {sent}".encode()))  # the same bytes would be the same log
    log = service.post("/api/v1/logs", content=body, headers=FORM)
    if len(sent) > 4000:  # the form parser's own limit on header lines
        assert log.status_code == 400
        return
    assert log.json()["name"] == shown
    assert re.fullmatch("[0-9a-f]{32}", log.json()["id"])
    assert (folder / "objects" / "logs" / log.json()["id"]).is_file()
    assert {path.name for path in folder.parent.iterdir()} == before


@pytest.mark.parametrize(
    ("body", "status", "says"),
    [
        (b"", 400, "ended before the file did"),
        (b"not a form", 400, "damaged"),
        (form((disposition("file", "a.bin"), b"data"), end=False), 400, "ended before the file did"),
        (form((disposition("log", "a.bin"), b"data")), 400, "no file called `file`"),
        (form((disposition("file"), b"data")), 400, "no file called `file`"),
        (form(), 400, "no file called `file`"),
        (form(("X-Other: 1", b"data")), 400, "must be provided"),
        (form((disposition("file", "a.bin"), b"1"), (disposition("file", "b.bin"), b"")), 422, "b.bin is empty"),
        (form(*[(disposition("file", "a.bin"), b"1")] * 101), 400, "Too many files"),
        (form((disposition("file", "a.bin"), b"")), 422, "a.bin is empty"),
        (form((disposition("file", "a.bin"), bytes(5 << 20))), 413, "larger than the 4 MB"),
        (form(("X: " + "x" * 10_000, b"data")), 400, "damaged"),
    ],
)
def test_a_bad_upload_is_refused_with_its_reason(
    service: httpx.Client, folder: Path, body: bytes, status: int, says: str
) -> None:
    logs = folder / "objects" / "logs"
    logs.mkdir(parents=True, exist_ok=True)  # made by the first upload, which may come later
    kept = len(list(logs.iterdir()))
    response = service.post("/api/v1/logs", content=body, headers=FORM)
    assert response.status_code == status
    assert response.headers["Content-Type"] == "application/problem+json"
    assert says in response.json()["detail"]
    assert not unfinished(folder)
    assert len(list(logs.iterdir())) == kept


def test_what_is_no_form_is_refused(service: httpx.Client) -> None:
    for headers in ({}, {"Content-Type": "application/json"}, {"Content-Type": "multipart/form-data"}):
        response = service.post("/api/v1/logs", content=b"{}", headers=headers)
        assert response.status_code == 415
        assert "curl -F file=@" in response.json()["detail"]


@pytest.mark.parametrize(("part", "status"), [(disposition("file", "a.bin"), 413), (disposition("comment"), 400)])
def test_a_body_of_unknown_length_is_limited_as_it_arrives(service: httpx.Client, part: str, status: int) -> None:
    head = f"--{BOUNDARY}\r\n{part}\r\n\r\n".encode()
    # Not much over the limit, so that the client has sent all when the answer comes.
    response = service.post("/api/v1/logs", content=iter([head, *[bytes(64 << 10)] * 65]), headers=FORM)
    assert response.status_code == status


def test_an_upload_that_stalls_is_given_up(hasty_service: httpx.Client, tmp_path: Path) -> None:
    address = (hasty_service.base_url.host, hasty_service.base_url.port or 80)
    head = f"POST /api/v1/logs HTTP/1.1\r\nHost: x\r\nContent-Length: 1000\r\nContent-Type: {FORM['Content-Type']}"
    with socket.create_connection(address, timeout=PATIENCE) as connection:
        connection.sendall(head.encode() + b"\r\n\r\n" + form((disposition("file", "a.bin"), b"data"), end=False))
        answer = connection.recv(4096).decode()
    assert answer.startswith("HTTP/1.1 408 ")
    assert not unfinished(tmp_path)


def test_other_sites_cannot_upload_through_a_visitors_browser(service: httpx.Client) -> None:
    for site, status in (("cross-site", 403), ("same-site", 403), ("same-origin", 201), ("none", 201)):
        response = service.post("/api/v1/logs", files={"file": ("a.bin", b"data")}, headers={"Sec-Fetch-Site": site})
        assert response.status_code == status


def test_the_same_content_uploaded_again_is_the_same_log(service: httpx.Client) -> None:
    first = service.post("/api/v1/logs", files={"file": ("a.bin", b"one and the same")}).json()
    again = service.post("/api/v1/logs", files={"file": ("b.bin", b"one and the same")})
    assert again.status_code == 201
    assert again.json() == {**first, "delete_token": None}
    assert first["sha256"] == hashlib.sha256(b"one and the same").hexdigest()
