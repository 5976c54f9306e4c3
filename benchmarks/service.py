"""What the service bears: many uploads at once, a very large one, and questions while its workers are busy.

Everything goes over loopback against `rotorid serve` in a process of its own.
"""

import hashlib
import os
import statistics
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import httpx

from benchmarks._measure import SAMPLES, Row, forget_peak, memory, row
from tests.api.programs import SERVE, Service

MB = 1_000_000

#: A log's first bytes, so that it is taken for one, and what no packing makes smaller.
_BLOCK = (SAMPLES / "octa01_zurich_calm.bin").read_bytes()[:30_000] + os.urandom(MB - 30_000)


def run() -> list[Row]:
    with tempfile.TemporaryDirectory() as folder, closing(Service(Path(folder), SERVE, **SETTINGS)) as service:
        address, pid = f"http://127.0.0.1:{service.port}", service.process.pid
        started = time.perf_counter()
        refused = upload_many(address, clients=50, size=10 * MB)
        took = time.perf_counter() - started
        many = memory("VmHWM", pid) / MB
        growth = upload_large(address, pid, size=1000 * MB)
        idle, busy, states = status_reads(address)
    return [
        row("50 clients upload 10 MB each at once: lost", f"{len(refused)}", goal="0"),
        row("... most memory of the server's process", f"{many:.0f} MB", goal="300 MB"),
        row("... rate of all together", f"{500 / took:.0f} MB/s"),
        row("growth of the server's process over an upload of 1 GB", f"{growth:.0f} MB", goal="100 MB"),
        row(f"median of {len(states)} status reads while workers are busy", f"{busy:.1f} ms", goal="50 ms"),
        row("... and when they are not", f"{idle:.1f} ms"),
    ]


def upload_many(address: str, *, clients: int, size: int) -> list[str]:
    """Upload different logs at the same moment; return the answers about those that are not kept as they were sent."""

    def upload(number: int) -> tuple[str, str]:
        digest = hashlib.sha256()
        with httpx.Client(base_url=address, timeout=300.0) as client:
            answer = client.post("/api/v1/logs", content=_form(b"%d" % number, size, digest), headers=_FORM)
            kept = answer.json()
        right = answer.status_code == 201 and (kept["sha256"], kept["size"]) == (digest.hexdigest(), size)
        return digest.hexdigest(), "" if right else answer.text

    with ThreadPoolExecutor(clients) as pool:
        sent = dict(pool.map(upload, range(clients)))
    listed = httpx.get(f"{address}/api/v1/logs", params={"limit": 500}, timeout=60.0).json()["items"]
    kept = {log["sha256"] for log in listed if log["size"] == size}
    return [wrong or "not listed" for digest, wrong in sent.items() if wrong or digest not in kept]


def upload_large(address: str, pid: int, *, size: int) -> float:
    """Upload one log; gives how much more memory the process needed for it than before, MB."""
    forget_peak(pid)
    before = memory("VmHWM", pid)
    answer = httpx.post(
        f"{address}/api/v1/logs", content=_form(b"large", size, hashlib.sha256()), headers=_FORM, timeout=600.0
    )
    assert answer.json().get("size") == size, answer.text
    return max(0.0, memory("VmHWM", pid) - before) / MB


def status_reads(address: str) -> tuple[float, float, list[str]]:
    """Time reads of an analysis, in ms, before and while sample logs are analysed; and what they said."""
    with httpx.Client(base_url=address, timeout=60.0) as client:
        samples = sorted(SAMPLES.glob("*.bin"))
        logs = [
            client.post("/api/v1/logs", files={"file": (path.name, path.read_bytes())}).json()["id"] for path in samples
        ]
        idle = statistics.median(_time(client, f"/api/v1/logs/{logs[0]}")[0] for _ in range(50))
        analyses = [client.post("/api/v1/analyses", json={"log": log}).headers["Location"] for log in logs]
        busy, states = [], []
        while len(busy) < 300 and client.get(analyses[-1]).json()["state"] in ("queued", "running"):
            took, state = _time(client, analyses[-1])
            busy.append(took)
            states.append(state)
            time.sleep(0.05)
        for analysis in analyses:
            client.post(f"{analysis}/cancel")
    return idle, statistics.median(busy), states


SETTINGS = {"ROTORID_UPLOAD_LIMIT": "2GB", "ROTORID_UPLOAD_RATE": ""}
_FORM = {"Content-Type": "multipart/form-data; boundary=b"}


def _form(begin: bytes, size: int, digest: "hashlib._Hash") -> Iterator[bytes]:
    """Write a form with a log of `size` bytes piece by piece, and take its digest."""
    yield b'--b\r\nContent-Disposition: form-data; name="file"; filename="a.bin"\r\n\r\n'
    left = size
    while left:
        piece = _BLOCK[: -len(begin)] + begin if left == size else _BLOCK
        piece = piece[:left]
        digest.update(piece)
        left -= len(piece)
        yield piece
    yield b"\r\n--b--\r\n"


def _time(client: httpx.Client, address: str) -> tuple[float, str]:
    start = time.perf_counter()
    answer = client.get(address)
    return 1e3 * (time.perf_counter() - start), answer.json().get("state", "")
