"""What a client of the service does with its craft: upload a flight, wait until a craft is settled."""

import time
from collections.abc import Callable
from typing import Any

import httpx

from tests.api.programs import PATIENCE


def fly(client: httpx.Client, name: str, content: bytes) -> str:
    """Upload a log, wait for its analysis and return the log's id."""
    answer = client.post("/api/v1/logs", params={"analyze": True}, files={"file": (name, content)})
    assert answer.status_code == 201, answer.text
    return str(answer.json()["logs"][0]["id"])


def wait(question: Callable[[], Any]) -> Any:
    """Ask until the answer is true."""
    until = time.monotonic() + PATIENCE
    while time.monotonic() < until:
        if answer := question():
            return answer
        time.sleep(0.1)
    raise AssertionError("it does not come to hold")


def only_craft(client: httpx.Client) -> dict[str, Any]:
    (craft,) = client.get("/api/v1/crafts").json()["items"]
    return dict(craft)


def settled(client: httpx.Client, craft_id: str) -> dict[str, Any]:
    """Wait until a craft has been looked at and no joint fit of it waits."""

    def look() -> dict[str, Any] | None:
        craft: dict[str, Any] = client.get(f"/api/v1/crafts/{craft_id}").json()
        return craft if craft["current"] and craft["joint"]["waiting"] is None else None

    return dict(wait(look))
