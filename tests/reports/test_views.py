"""What pages say of parameters, of how a craft turns and of its loops: numbers with reasons, nothing flattering."""

import dataclasses
import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import reports
import sysid
from core.serialization import as_json, from_json
from pipeline.flight.identification import coherence_report
from pipeline.flight.summary import flight_report, models_file
from pipeline.results.model import ParameterRow
from reports.pages.loops import loops_page
from reports.views.parameters import EMPTY, parameters
from reports.views.rotation import rotation_view
from sysid.loops.report import TuningReport, tuning_report
from sysid.loops.safety import Aim
from sysid.loops.search import AxisTuning
from sysid.loops.tuning import Tuning
from tests.pipeline.builders import margins, turning
from tests.reports.builders import validator_of

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
    statements = sysid.PhysicalParameters(table, None, None, None, None, None)
    spectra = sysid.records.excitation.coherence([flight.experiments["motors"]])
    own = flight.models[0]
    models = (
        dataclasses.replace(own, report=dataclasses.replace(own.report, coherence=coherence_report(spectra))),
        *flight.models[1:],
    )
    result = dataclasses.replace(flight, parameters=statements, models=models)
    reports.write(result, tmp_path)
    page = (tmp_path / "models.html").read_text("utf-8")
    assert "2.61 ± 0.02" in page
    assert "Logs are too slow." in page
    assert "How much the inputs can tell" in page
    numbers = flight_report(result)
    assert [parameter.value for parameter in numbers.parameters] == [2.6136, None]
    band = (spectra.frequency >= 0.5) & (spectra.frequency <= 5.0)
    coherence = numbers.models[0].coherence
    assert coherence.outputs["x"].multiple_median == pytest.approx(np.median(spectra.multiple[band, 0]))
    assert models_file(numbers, models).flights[0].parameters == numbers.parameters


def test_the_view_has_margins_and_reasons():
    view = rotation_view(turning(margins(5.0, None)), "flight.bin")
    rows = {row.label: row.cells for row in view.loops.rows}
    assert rows["State"] == ["thin"]
    assert rows["Gain margin, dB"] == ["5.00 ± 0.10"]
    assert rows["Phase margin, deg"] == ["–"]
    assert view.reasons == [("Pitch and yaw", "No chirp.")]
    assert [figure.id for figure in view.figures] == ["bode-roll"]
    assert any("nothing moved" in sentence for sentence in view.sentences)
    assert rotation_view(None, "flight.bin") is None


def test_page_and_numbers_hold_it(other, tmp_path):
    flight = replace(other, rotation=turning(margins(9.0, 60.0)))
    reports.write(flight, tmp_path)
    page = (tmp_path / "models.html").read_text("utf-8")
    assert page.count('id="turns"') == page.count('id="loops"') == 1
    assert 'id="plot-bode-roll"' in page
    numbers = json.loads((tmp_path / "report.json").read_text("utf-8"))
    validator_of("flight").validate(numbers)
    assert numbers["rotation"]["axes"][0]["loop"]["state"] == "good"


def test_a_refusal_is_written_and_escaped():
    tuning = Tuning(
        logs=("<b>.bin",),
        aim=Aim(),
        proposed={},
        rollback={},
        flown={},
        refused="no chirps </script>",
        axes=(AxisTuning("roll", "no chirps"),),
        remarks=(),
        made="2026-03-14",
    )
    written = tuning_report(tuning)
    report = from_json(as_json(written), TuningReport)
    assert report.axes[0].refused == "no chirps"
    assert report.axes[0].flown is None
    page = loops_page(written)
    assert "<h1>Loops of &lt;b&gt;.bin</h1>" in page
    assert "no chirps </script>" not in page
