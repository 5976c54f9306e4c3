"""Workers, the server or both are killed at random moments, 30 times: what was accepted is there and ends once.

Once on SQLite, and once on PostgreSQL where that is installed. The service is that of the tests, whose analyses take
two seconds and do nothing.
"""

import os
import random
import signal
import tempfile
import time
from contextlib import closing
from pathlib import Path

import pytest

from benchmarks._measure import Row, row
from tests.api import postgresql
from tests.api.programs import Service, wait_until

#: Processes of which one analysis may die here before it is given up: more than are killed.
DEATHS = {"ROTORID_DEATHS": "1000"}


def run() -> list[Row]:
    rows = _killed("SQLite", {})
    try:
        with postgresql.running() as server:
            rows += _killed("PostgreSQL", {"ROTORID_DATABASE": server.url})
    except pytest.skip.Exception as missing:
        rows.append(row(f"the same on PostgreSQL: {missing}", "-", goal="0"))
    return rows


def _killed(name: str, settings: dict[str, str]) -> list[Row]:
    with tempfile.TemporaryDirectory() as folder, closing(Service(Path(folder), **DEATHS, **settings)) as service:
        lost, wrong = kill_at_random(service, kills=30)
    return [
        row(f"kill -9 of workers, server or both on {name}, 30 times: logs lost", f"{lost}", goal="0"),
        row("... analyses that do not end once with their right result", f"{wrong}", goal="0"),
    ]


def kill_at_random(service: Service, kills: int) -> tuple[int, int]:
    """Kill while analyses are in all of their stages; gives how many logs and how many results are not as they should.

    Three kills in a row are one of the workers, one of the server and one of both, in an order drawn. After them some
    analysis gets the time to end, however slow the computer: the oldest come first, so that none loses its server as
    often as it takes to be given up.
    """
    chance = random.Random(20261121)
    accepted: dict[str, bytes] = {}
    analyses: dict[str, str] = {}
    victims: list[str] = []

    def done() -> int:
        return sum(service.client.get(address).json()["state"] == "done" for address in analyses)

    for number in range(kills):
        content = b"slow %d" % number
        log = service.client.post("/api/v1/logs", files={"file": (f"{number}.bin", content)}).json()["id"]
        accepted[log] = content
        analyses[service.client.post("/api/v1/analyses", json={"logs": [log]}).headers["Location"]] = log
        time.sleep(chance.uniform(0.0, 0.6))
        if number % 3 == 0:
            victims = chance.sample(["worker", "server", "both"], 3)
        victim = victims[number % 3]
        if victim in ("worker", "both"):
            for pid in service.workers():
                os.kill(pid, signal.SIGKILL)
        if victim in ("server", "both"):
            service.kill()
            service.start()
        if number % 3 == 2:
            enough = min(done() + 1, len(analyses))
            wait_until(lambda enough=enough: done() >= enough)  # type: ignore[misc]

    wait_until(lambda: all(service.client.get(address).json()["ended"] for address in analyses), pause=0.5)
    lost = sum((service.data / "objects" / "logs" / log).read_bytes() != content for log, content in accepted.items())
    wrong = sum(not _is_right(service, address, accepted[log]) for address, log in analyses.items())
    return lost, wrong


def _is_right(service: Service, address: str, content: bytes) -> bool:
    answer = service.client.get(address, params={"include": "report"}).json()
    return (
        answer["state"] == "done"
        and answer["report"]["bytes"] == len(content)
        and service.client.get(f"{address}/rmse.csv").text.startswith("flight,")
    )
