"""What the OpenAPI document promises holds for whatever requests can be made of it."""

import importlib
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from http import HTTPStatus
from pathlib import Path
from typing import Any

import httpx
import pytest
from hypothesis import HealthCheck, Phase, given, settings

from api import Settings
from tests.api import flights
from tests.api.conftest import Upload, served
from tests.api.programs import PATIENCE
from tests.api.visits import fly


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


def test_the_document_is_valid(document: dict[str, Any]) -> None:
    pytest.importorskip("openapi_spec_validator").validate(document)


def test_a_generated_client_asks_a_running_service(
    service: httpx.Client, document: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As docs/service.md has it; two types of one name once cost the client an answer."""
    beside = str(Path(sys.prefix) / "client" / "bin")
    program = shutil.which("openapi-python-client", path=f"{beside}:{os.environ['PATH']}")
    if program is None:
        pytest.skip("openapi-python-client is not installed")
    (tmp_path / "openapi.json").write_text(json.dumps(document))
    (tmp_path / "config.json").write_text('{"post_hooks": []}')
    order = [program, "generate", "--path", "openapi.json", "--config", "config.json", "--output-path", "client"]
    said = subprocess.run(order, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert "WARNING" not in said.stdout + said.stderr
    fly(service, "client.bin", flights.log(0, craft="client"))
    monkeypatch.syspath_prepend(str(tmp_path / "client"))
    generated = importlib.import_module("rotorid_client")
    list_crafts = importlib.import_module("rotorid_client.api.craft.list_crafts_api_v1_crafts_get")
    show_flights = importlib.import_module("rotorid_client.api.craft.list_flights_api_v1_crafts_craft_id_flights_get")
    with generated.Client(base_url=str(service.base_url), raise_on_unexpected_status=True) as client:
        crafts = list_crafts.sync(client=client).items
        craft_of = {flight.name: craft for craft in crafts for flight in show_flights.sync(craft.id, client=client)}
        assert craft_of["client"].health == "yes"
        assert show_flights.sync_detailed("0" * 32, client=client).status_code == HTTPStatus.NOT_FOUND


@pytest.mark.slow
def test_nothing_breaks_and_everything_is_as_documented(
    service: httpx.Client, document: dict[str, Any], upload: Upload
) -> None:
    """Requests made of the document, valid and not, by hypothesis; the same ones each time."""
    import schemathesis  # here, for every worker reads this file and one of them runs this test
    from schemathesis.specs.openapi.checks import positive_data_acceptance

    before = {craft["id"] for craft in service.get("/api/v1/crafts").json()["items"]}  # what another test flew
    done = upload(service, flights.log(0, trust="yes")).json()
    (craft,) = [craft for craft in service.get("/api/v1/crafts").json()["items"] if craft["id"] not in before]
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
