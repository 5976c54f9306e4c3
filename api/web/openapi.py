"""The OpenAPI document, with an example of everything that goes in and comes out."""

from collections.abc import Iterator, Mapping
from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi

from api.web.reference import example_of

#: What stands for what in addresses: description and example.
_PARAMETERS: Mapping[str, tuple[str, Any]] = {
    "log_id": ("Id of a log.", "5f0c1d3e9a7b4c2d8e6f0a1b2c3d4e5f"),
    "analysis_id": ("Id of an analysis.", "0a1b2c3d4e5f5f0c1d3e9a7b4c2d8e6f"),
    "name": ("A name in `files` of the analysis.", "tables/imu.parquet"),
    "secret": ("The last part of a shared link.", "bT3nJ0cO0WjS5mJX1m3Zt0pB8xq2w4u6y8A0C2E4G6I"),
    "craft_id": ("Id of a craft.", "7a1b2c3d4e5f5f0c1d3e9a7b4c2d8e6f"),
    "note_id": ("Id of a note.", "1a1b2c3d4e5f5f0c1d3e9a7b4c2d8e6f"),
    "hook_id": ("Id of a webhook.", "3a1b2c3d4e5f5f0c1d3e9a7b4c2d8e6f"),
    "trust": ("", "yes"),
    "flight": ("", "00000012"),
    "craft": ("", "ArduCopter octa plus"),
    "text": ("", "0012"),
    "before": ("", "00000012"),
    "after_flight": ("", "00000013"),
    "message": ("Name of a message.", "IMU"),
    "signal": ("", ["ATT.Roll", "ATT.Roll - ATT.DesRoll"]),
    "start": ("", 40.0),
    "stop": ("", 60.0),
    "points": ("", 2000),
    "q": ("", "octa"),
    "include": ("", ["report"]),
    "analyze": ("", True),
    "limit": ("", 50),
    "after": ("", "5f0c1d3e9a7b4c2d8e6f0a1b2c3d4e5f"),
    "state": ("", "done"),
    "log": ("", "5f0c1d3e9a7b4c2d8e6f0a1b2c3d4e5f"),
    "days": ("", 30),
    "delete-token": ("", "bT3nJ0cO0WjS5mJX1m3Zt0pB8xq2w4u6y8A0C2E4G6I"),
}

#: What bodies look like that are no JSON.
_BODIES: Mapping[str, Any] = {
    "text/event-stream": 'event: progress\ndata: {"id": "0a1b2c3d4e5f5f0c1d3e9a7b4c2d8e6f", "state": "running"}\n\n',
    "text/plain": 'rotorid_analyses{state="done"} 12.0\n',
    "multipart/form-data": {"file": ["FLIGHT.bin"]},
    "application/octet-stream": "flight,part,model,rmse_x_m\n00000012,held-out,motors,0.41\n",
}

_PROBLEM = {
    "type": "urn:rotorid:problem:log-too-large",
    "title": "The log is too large",
    "status": 413,
    "detail": "The upload is larger than the 1 GB that this service takes.",
}


def install(app: FastAPI) -> None:
    """Add examples to an application's description."""

    def describe() -> dict[str, Any]:
        if app.openapi_schema is None:
            document = get_openapi(title=app.title, version=app.version, description=app.description, routes=app.routes)
            for operation in _operations(document):
                _add_examples(document, operation)
            app.openapi_schema = document
        return app.openapi_schema

    app.openapi = describe  # type: ignore[method-assign]


def _operations(document: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    for methods in document["paths"].values():
        yield from methods.values()


def _add_examples(document: Mapping[str, Any], operation: dict[str, Any]) -> None:
    for parameter in operation.get("parameters", []):
        description, example = _PARAMETERS[parameter["name"]]
        parameter.setdefault("description", description)
        # A name may mean something else in another place: a part of a log's name, in a query.
        parameter["example"] = "00000012" if (parameter["name"], parameter["in"]) == ("name", "query") else example
    answers = operation["responses"].values()
    for body in (operation.get("requestBody", {}), *answers):
        for kind, content in body.get("content", {}).items():
            if kind == "application/problem+json":
                content["example"] = _PROBLEM
            elif kind == "application/json":
                content["example"] = example_of(document, content["schema"])
            else:
                content["example"] = _BODIES[kind]
