"""report.json of flights, crafts and folders is what its schema says: nothing less, and nothing undocumented."""

import json

import pytest

import reports
from tests.reports.builders import validator_of


@pytest.mark.parametrize("path", ["report.json", "crafts/craft0/report.json", "flights/flight01/report.json"])
def test_reports_are_as_their_schema_says(fleet, path):
    numbers = json.loads((fleet / path).read_text("utf-8"))
    validator = validator_of(numbers["kind"])
    validator.validate(numbers)
    assert not validator.is_valid(numbers | {"undocumented": 1})


def test_a_flight_without_models_is_as_the_schema_says(other, tmp_path):
    reports.write(other, tmp_path)
    validator_of("flight").validate(json.loads((tmp_path / "report.json").read_text("utf-8")))
