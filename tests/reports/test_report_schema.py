"""report.json of flights, crafts and folders is what its schema says: nothing less, and nothing undocumented."""

import json

import jsonschema
import pytest

import reports
from tests.reports.builders import schema_of


@pytest.mark.parametrize("path", ["report.json", "crafts/craft0/report.json", "flights/flight01/report.json"])
def test_reports_are_as_their_schema_says(fleet, path):
    numbers = json.loads((fleet / path).read_text("utf-8"))
    jsonschema.validate(numbers, schema_of(numbers["kind"]))
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(numbers | {"undocumented": 1}, schema_of(numbers["kind"]))


def test_a_flight_without_models_is_as_the_schema_says(other, tmp_path):
    reports.write(other, tmp_path)
    jsonschema.validate(json.loads((tmp_path / "report.json").read_text("utf-8")), schema_of("flight"))
