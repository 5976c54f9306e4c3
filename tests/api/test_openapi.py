"""What the OpenAPI document promises holds for whatever requests can be made of it."""

import re
from collections.abc import Iterator
from typing import Any

import httpx
import pytest
from hypothesis import HealthCheck, Phase, given, settings

from api import Settings
from tests.api import flights
from tests.api.conftest import Upload, served
from tests.api.programs import PATIENCE
from tests.paths import ROOT


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    """Run a service in which there is a craft with a flight, whose analysis is done and shared."""
    chosen = Settings(data=tmp_path_factory.mktemp("data"), upload_rate="", workers=1)
    with served(chosen, analyze=flights.analyze) as client:
        yield client


@pytest.fixture(scope="module")
def document(service: httpx.Client) -> dict[str, Any]:
    answer: dict[str, Any] = service.get("/openapi.json").json()
    return answer


def test_the_document_is_valid_and_no_two_types_have_one_name(document: dict[str, Any]) -> None:
    """Two types of one name, which FastAPI tells apart by their modules, once cost a generated client an answer."""
    pytest.importorskip("openapi_spec_validator").validate(document)
    assert not [name for name in document["components"]["schemas"] if "__" in name]
    asked = re.findall(r"rotorid_client\.api\.\w+ import (\w+)", (ROOT / "docs" / "service.md").read_text("utf-8"))
    names = {operation["operationId"] for path in document["paths"].values() for operation in path.values()}
    assert len(asked) == 1
    assert set(asked) <= names, "by this name the client of docs/service.md imports it"


@pytest.mark.slow
def test_nothing_breaks_and_everything_is_as_documented(
    service: httpx.Client, document: dict[str, Any], upload: Upload
) -> None:
    """Requests made of the document, valid and not, by hypothesis; the same ones each time."""
    import schemathesis  # here, for every worker reads this file and one of them runs this test
    from schemathesis.specs.openapi.checks import positive_data_acceptance

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
            max_examples=3,
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
