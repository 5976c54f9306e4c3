"""The sections on how a craft turns say what is known, in what state its loops are, and what to fly for the rest."""

import json
from dataclasses import replace

import reports
from reports.views.rotation import rotation_view
from tests.pipeline.builders import margins, turning
from tests.reports.builders import validator_of
from tests.reports.conftest import made_flight


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


def test_page_and_numbers_hold_it(tmp_path):
    flight = replace(made_flight("a", seed=1, fit=False), rotation=turning(margins(9.0, 60.0)))
    reports.write(flight, tmp_path)
    page = (tmp_path / "models.html").read_text("utf-8")
    assert page.count('id="turns"') == page.count('id="loops"') == 1
    assert 'id="plot-bode-roll"' in page
    numbers = json.loads((tmp_path / "report.json").read_text("utf-8"))
    validator_of("flight").validate(numbers)
    assert numbers["rotation"]["axes"][0]["loop"]["state"] == "good"
