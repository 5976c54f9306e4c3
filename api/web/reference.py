"""The OpenAPI document as our reference page shows it: operations by kind, each with its fields and an example."""

import json
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi

Schema = Mapping[str, Any]

#: Kinds of operations in the order in which one needs them.
_KINDS = ("logs", "analyses", "craft", "alerts", "questions", "sharing", "operation")

#: How deep an example goes into schemas within schemas.
_DEPTH = 6


class Field(NamedTuple):
    """Something that a request may hold."""

    name: str
    kind: str
    where: str
    required: bool
    what: str


class Answer(NamedTuple):
    """What an operation answers."""

    status: str
    media: str
    example: str


class Operation(NamedTuple):
    """One thing that the interface does."""

    anchor: str
    method: str
    path: str
    summary: str
    paragraphs: list[str]
    fields: list[Field]
    curl: str
    answers: list[Answer]


def operations_by_kind(document: Schema, base: str, *, tokens: bool = False) -> dict[str, list[Operation]]:
    """Turn a document into what the page shows."""
    kinds: dict[str, list[Operation]] = {kind: [] for kind in _KINDS}
    for path, methods in document["paths"].items():
        for method, operation in methods.items():
            shown = _operation(document, base, path, method, operation, tokens=tokens)
            kinds[operation["tags"][0]].append(shown)
    return kinds


def _operation(document: Schema, base: str, path: str, method: str, operation: Schema, *, tokens: bool) -> Operation:
    body = operation.get("requestBody", {}).get("content", {})
    return Operation(
        anchor=f"{method}{path}".replace("/", "-").replace("{", "").replace("}", ""),
        method=method.upper(),
        path=path,
        summary=operation["summary"],
        paragraphs=operation.get("description", "").split("\n\n"),
        fields=[*_parameters(document, operation), *_body_fields(document, body)],
        curl=_curl(document, base, path, method, body, tokens=tokens and path.startswith("/api/")),
        answers=list(_answers(document, operation)),
    )


def _parameters(document: Schema, operation: Schema) -> Iterator[Field]:
    for parameter in operation.get("parameters", []):
        schema = parameter["schema"]
        place = {"path": "part of the address", "query": "query", "header": "header"}[parameter["in"]]
        what = parameter.get("description", "")
        yield Field(parameter["name"], _kind(document, schema), place, parameter.get("required", False), what)


def _body_fields(document: Schema, body: Schema) -> Iterator[Field]:
    for media, content in body.items():
        place = "form field" if media.startswith("multipart") else "JSON field"
        yield from _properties(document, content["schema"], place)


def _properties(document: Schema, schema: Schema, place: str, within: str = "") -> Iterator[Field]:
    """List the fields of an object and of the objects in it."""
    schema = _resolved(document, schema)
    for name, field in schema.get("properties", {}).items():
        inner = _resolved(document, field)
        what = field.get("description", inner.get("description", ""))
        yield Field(within + name, _kind(document, field), place, name in schema.get("required", []), what)
        if "properties" in inner:
            yield from _properties(document, inner, place, f"{within}{name}.")


def _resolved(document: Schema, schema: Schema) -> Schema:
    """Follow a reference, and what may be null to what it is otherwise."""
    if "$ref" in schema:
        found: Schema = document["components"]["schemas"][schema["$ref"].rsplit("/", 1)[1]]
        return found
    if "anyOf" in schema:
        return _resolved(document, next(each for each in schema["anyOf"] if each.get("type") != "null"))
    return schema


def _kind(document: Schema, schema: Schema) -> str:
    """Report in a few words what a value may be."""
    schema = _resolved(document, schema)
    if "enum" in schema:
        return " or ".join(map(str, schema["enum"]))
    kind = str(schema.get("type", "any"))
    if kind == "array":
        return f"list of {_kind(document, schema.get('items', {}))}"
    if schema.get("format") == "binary":
        return "file"
    low, high = schema.get("minimum", schema.get("exclusiveMinimum")), schema.get("maximum")
    return f"{kind}, {low:g} to {high:g}" if low is not None and high is not None else kind


def example_of(document: Schema, schema: Schema, depth: int = 0) -> Any:
    """Make up a value of a schema, of the examples that it gives."""
    if schema.get("examples"):
        return schema["examples"][0]
    inner = _resolved(document, schema)
    if inner is not schema:
        return example_of(document, inner, depth)
    if "enum" in schema:
        return schema["enum"][0]
    match schema.get("type"):
        case "object" if depth < _DEPTH:
            return {
                name: example_of(document, field, depth + 1) for name, field in schema.get("properties", {}).items()
            }
        case "array":
            return [
                example_of(document, each, depth + 1) for each in schema.get("prefixItems", [schema.get("items", {})])
            ]
        case _ if "default" in schema:
            return schema["default"]
        case "integer" | "number":
            return schema.get("minimum", 0)
        case "boolean":
            return True
        case "string":
            return "..."
    return {}


def _curl(document: Schema, base: str, path: str, method: str, body: Schema, *, tokens: bool) -> str:
    """Write a call that a person can paste into a terminal."""
    parts = ["curl"]
    if method == "delete" or (method == "post" and not body):
        parts.append(f"-X {method.upper()}")
    if tokens and "/shared/" not in path:
        parts.append("-H 'Authorization: Bearer TOKEN'")
    for media, content in body.items():
        if media.startswith("multipart"):
            parts.append("-F file=@FLIGHT.bin")
        else:
            parts.append(f"--json '{json.dumps(example_of(document, content['schema']))}'")
    address = base + path.replace("{name}", "report.html").replace("{secret}", "SECRET")
    while "{" in address:
        address = address[: address.index("{")] + "ID" + address[address.index("}") + 1 :]
    return " ".join([*parts, address])


def _answers(document: Schema, operation: Schema) -> Iterator[Answer]:
    for status, answer in operation["responses"].items():
        if status == "default":
            continue
        content = answer.get("content", {})
        if not content:
            yield Answer(status, "nothing" if status == "204" else "the file", "")
        for media, body in content.items():
            example = ""
            if media == "application/json":
                example = json.dumps(example_of(document, body["schema"]), indent=2, ensure_ascii=False)
            yield Answer(status, media, example)


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
