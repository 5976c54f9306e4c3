"""Physical parameters and coherence as pages show them: numbers with their reasons, nothing flattering."""

import dataclasses

import numpy as np
import pandas as pd
import pytest

import reports
import sysid
from pipeline.results.model_report import ModelReport, ParameterRow
from reports.numbers.flight import flight_report
from reports.views.parameters import EMPTY, coherence, parameters
from tests.reports.made import made

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


@pytest.mark.parametrize(
    ("above", "says"),
    [
        ({"x": 0.9, "z": 1.0}, "Motor PWM: x and z answer to them at most frequencies."),
        ({"x": 0.1, "z": 1.0}, "z answers to them at most frequencies, x hardly more than by chance."),
        ({"x": 0.1, "z": 0.0}, "no answer that chance would not give"),
    ],
)
def test_one_sentence_says_what_the_coherence_says(above, says):
    told = {
        "band_rad_s": (0.5, 5.0),
        "inputs": ["m1"],
        "averages": 30.0,
        "chance": 0.4,
        "outputs": {name: {"multiple_median": 0.5, "above_chance": part} for name, part in above.items()},
    }
    view = coherence([made(ModelReport, title="motor PWM → position", coherence=told)])
    assert says in view.sentences[0]
    assert view.table.heads == ["x", "z", "chance"]


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
    models = (dataclasses.replace(flight.models[0], coherence=spectra), *flight.models[1:])
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
    assert reports.numbers.flight.models_file(result).flights[0].parameters == numbers.parameters
