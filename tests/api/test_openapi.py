"""What the OpenAPI document promises holds for whatever requests can be made of it."""

from collections.abc import Callable, Iterator
from typing import Any

import httpx
import pytest
import schemathesis
from hypothesis import HealthCheck, Phase, given, settings
from schemathesis.specs.openapi.checks import positive_data_acceptance

from api import Settings, create_app
from tests.api import flights
from tests.api.conftest import running
from tests.api.programs import PATIENCE

Upload = Callable[..., httpx.Response]


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    """Run a service in which there is a craft with a flight, whose analysis is done and shared."""
    chosen = Settings(data=tmp_path_factory.mktemp("data"), upload_rate="", workers=1)
    with running(create_app(chosen, flights.analyze, preload=flights.PRELOAD)) as client:
        yield client


@pytest.fixture(scope="module")
def document(service: httpx.Client) -> dict[str, Any]:
    found: dict[str, Any] = service.get("/openapi.json").json()
    return found


def test_the_document_is_valid(document: dict[str, Any]) -> None:
    pytest.importorskip("openapi_spec_validator").validate(document)


def test_every_operation_has_a_summary_and_examples(document: dict[str, Any]) -> None:
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            assert operation["summary"], path
            assert operation["description"], path
            for parameter in operation.get("parameters", []):
                assert "description" in parameter, (path, parameter["name"])
                assert "example" in parameter or "examples" in parameter or parameter["schema"].get("examples"), (
                    path,
                    parameter["name"],
                )
            if "requestBody" in operation:
                for content in operation["requestBody"]["content"].values():
                    assert "example" in content or "examples" in content, (method, path)
            for status, answer in operation["responses"].items():
                for kind, content in answer.get("content", {}).items():
                    assert "example" in content or "examples" in content, (method, path, status, kind)


@pytest.mark.slow
def test_nothing_breaks_and_everything_is_as_documented(
    service: httpx.Client, document: dict[str, Any], upload: Upload
) -> None:
    """Requests made of the document, valid and not, by hypothesis; the same ones each time."""
    done = upload(service, flights.log(0, trust="yes")).json()
    (craft,) = service.get("/api/v1/crafts").json()["items"]
    note = service.post(f"{craft['links']['self']}/notes", json={"text": "new ESC"}).json()
    hook = service.post("/api/v1/hooks", json={"url": "https://ops.example.org/"}).json()
    shared = service.post(f"/api/v1/analyses/{done['id']}/shares").json()["api"].rpartition("/")[2]
    known = {
        "log_id": done["log"]["id"],
        "analysis_id": done["id"],
        "secret": shared,
        "name": "report.json",
        "message": "IMU",
        "craft_id": craft["id"],
        "note_id": note["id"],
        "hook_id": hook["id"],
    }
    schema = schemathesis.openapi.from_dict(document)
    schema.config.update(base_url=str(service.base_url))
    for result in schema.get_all_operations():
        operation = result.ok()

        @settings(
            max_examples=8,
            derandomize=True,
            database=None,
            deadline=None,
            phases=[Phase.explicit, Phase.generate],
            suppress_health_check=list(HealthCheck),
        )
        @given(case=operation.as_strategy())
        def check(case: schemathesis.Case) -> None:
            case.call_and_validate(timeout=PATIENCE, excluded_checks=[positive_data_acceptance])
            if case.path_parameters:  # once more for something that exists, if it is still there
                case.path_parameters = {name: known[name] for name in case.path_parameters}
                if case.method != "DELETE":
                    case.call_and_validate(timeout=PATIENCE, excluded_checks=[positive_data_acceptance])

        check()
