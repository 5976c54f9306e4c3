"""Physical parameters and coherence as pages show them: numbers with their reasons, nothing flattering."""

import dataclasses

import numpy as np
import pandas as pd
import pytest

import reports
import sysid
from pipeline.flight.identification import coherence_report
from pipeline.flight.summary import flight_report, models_file
from pipeline.results.model import ParameterRow
from reports.views.parameters import EMPTY, parameters

UNIT = "m/s^2, one motor at full command in sea-level air"


def row(parameter, method, value, sigma, *, unit=UNIT, si=None, note=""):
    si_value, si_sigma, si_unit = si or (None, None, "")
    return ParameterRow(
        parameter=parameter,
        method=method,
        value=value,
        sigma=sigma,
        unit=unit,
        si_value=si_value,
        si_sigma=si_sigma,
        si_unit=si_unit,
        note=note,
    )


def test_a_line_for_each_parameter_and_a_column_for_each_method():
    view = parameters(
        [
            row("thrust over mass", "rotor", 2.6136, 0.02, si=(10.45, 0.08, "N at full command")),
            row("thrust over mass", "rigid body", None, None, note="the motors were not logged"),
            row("motor lag", "rigid body", 0.0381, 0.004, unit="s"),
        ]
    )
    assert view.table.heads == ["rotor", "rigid body"]
    assert [row.label.partition(" (")[0] for row in view.table.rows] == [
        "Thrust over mass, m/s²",
        "… in N at full command",
        "Motor lag, s",
    ]
    assert [row.cells for row in view.table.rows] == [
        ["2.61 ± 0.02", EMPTY],
        ["10.45 ± 0.08", EMPTY],
        [EMPTY, "0.038 ± 0.004"],
    ]
    assert view.notes == [("Thrust over mass: rigid body", "The motors were not logged.")]
    assert parameters(None) is None


def test_page_json_and_models_have_both(flight, tmp_path):
    (index := pd.MultiIndex.from_tuples([("thrust over mass", "rotor"), ("motor lag", "rotor")])).names = [
        "parameter",
        "method",
    ]
    table = pd.DataFrame(
        {
            "value": [2.6136, np.nan],
            "sigma": [0.02, np.nan],
            "unit": [UNIT, "s"],
            "si_value": np.nan,
            "si_sigma": np.nan,
            "si_unit": "",
            "note": ["", "logs are too slow"],
        },
        index=index,
    )
    found = sysid.PhysicalParameters(table, None, None, None, None, None)
    spectra = sysid.records.excitation.coherence([flight.experiments["motors"]])
    own = flight.models[0]
    models = (
        dataclasses.replace(own, report=dataclasses.replace(own.report, coherence=coherence_report(spectra))),
        *flight.models[1:],
    )
    result = dataclasses.replace(flight, parameters=found, models=models)
    reports.write(result, tmp_path)
    page = (tmp_path / "models.html").read_text("utf-8")
    assert "2.61 ± 0.02" in page
    assert "Logs are too slow." in page
    assert "How much the inputs can tell" in page
    numbers = flight_report(result)
    assert [each.value for each in numbers.parameters] == [2.6136, None]
    band = (spectra.frequency >= 0.5) & (spectra.frequency <= 5.0)
    told = numbers.models[0].coherence
    assert told.outputs["x"].multiple_median == pytest.approx(np.median(spectra.multiple[band, 0]))
    assert models_file(numbers, models).flights[0].parameters == numbers.parameters
