"""What a client of the service does: upload a flight, order its analysis, wait until a craft is settled."""

from typing import Any

import httpx

from tests.api.programs import wait_until


def fly(client: httpx.Client, name: str, content: bytes) -> str:
    """Upload a log, wait for its analysis and return the log's id."""
    answer = client.post("/api/v1/logs", params={"analyze": True}, files={"file": (name, content)})
    assert answer.status_code == 201, answer.text
    return str(answer.json()["logs"][0]["id"])


def ordered(client: httpx.Client, content: bytes, name: str = "a.bin") -> tuple[str, str]:
    """Upload a log and order its analysis; return the log's id and the analysis's address."""
    log = str(client.post("/api/v1/logs", files={"file": (name, content)}).json()["id"])
    return log, client.post("/api/v1/analyses", json={"log": log}).headers["Location"]


def told(client: httpx.Client, address: str, what: str) -> str:
    """Return what is told of an analysis: its state, its stage."""
    return str(client.get(address).json()[what])


def only_craft(client: httpx.Client) -> dict[str, Any]:
    (craft,) = client.get("/api/v1/crafts").json()["items"]
    return dict(craft)


def settled(client: httpx.Client, craft_id: str) -> dict[str, Any]:
    """Wait until a craft has been looked at and no joint fit of it waits."""

    def look() -> dict[str, Any] | None:
        craft: dict[str, Any] = client.get(f"/api/v1/crafts/{craft_id}").json()
        return craft if craft["current"] and craft["joint"]["waiting"] is None else None

    return wait_until(look)
