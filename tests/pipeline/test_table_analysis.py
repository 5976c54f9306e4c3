"""Tables from the command line's side: fitted, judged on what was not seen, and a page that says so."""

import json

import jsonschema
import numpy as np
import pytest
import yaml

from core.serialization import as_json
from pipeline.config import AnalysisConfig, ConfigError
from pipeline.flight.table_analysis import analyze_tables
from reports.numbers.schema import schema
from reports.pages.tables import tables_page
from tests.sysid.six_dof import flown

COLUMNS = {
    "time": "t",
    "position": ["pn", "pe", "pd"],
    "velocity": ["vn", "ve", "vd"],
    "attitude": {"columns": ["qw", "qx", "qy", "qz"], "order": "wxyz"},
    "rates": ["p", "q", "r"],
    "motors": {"columns": ["m1", "m2", "m3", "m4"], "quantity": "rad/s", "frame": "quad/x"},
    "mass": flown.MASS,
    "indoors": True,
}


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    folder = tmp_path_factory.mktemp("table")
    flight = flown.fly(16.0, 4)
    record = flown.experiment(flight, "flight", 4)
    frame = record.context.reset_index(names="t")
    frame.columns = ["t", "vn", "ve", "vd", "p", "q", "r", "qw", "qx", "qy", "qz"]
    frame[["pn", "pe", "pd"]] = record.y * [1.0, 1.0, -1.0]
    frame[["m1", "m2", "m3", "m4"]] = record.u
    path = folder / "flight.parquet"
    frame.to_parquet(path)
    columns = folder / "columns.yaml"
    columns.write_text(yaml.safe_dump(COLUMNS), encoding="utf-8")
    return path, columns


@pytest.fixture(scope="module")
def result(table):
    path, columns = table
    return analyze_tables([path], columns, AnalysisConfig())


@pytest.mark.slow
def test_a_table_is_fitted_on_its_first_part_and_judged_on_the_rest(result):
    assert result.report.judged[0].startswith("flight.parquet [")
    half = {each.state: each for each in result.report.errors if each.horizon == 0.5}
    assert all(each.model < 0.2 * each.held for each in half.values()), half
    numbers = json.loads(as_json(result.report))
    jsonschema.validate(numbers, schema("report"))
    assert numbers["model"]["charges"] == result.model.shape.charges
    assert numbers["model"]["parameters"]["thrust"]["si_value"] == pytest.approx(flown.THRUST, rel=0.02)
    page = tables_page(result)
    assert "roll gain" in page
    assert "Position of flight.parquet" in page
    answers = {line.purpose: line for line in result.report.answer.lines}
    assert answers["Predict position"].word == "2 s ahead"
    assert answers["Thrust"].value == pytest.approx(flown.THRUST, rel=0.02)
    assert answers["Tables"].word == "consistent"


@pytest.mark.slow
def test_what_the_model_misses_is_noise_where_nothing_is_missing(result):
    """The simulated record's velocities have noise of 5 mm/s: 0.7 m/s^2 from sample to sample, and nothing else."""
    missed = {each.name: each for each in result.report.missed}
    assert missed["force forward"].rms == pytest.approx(np.sqrt(2.0) * 5e-3 * 100.0, rel=0.1)
    assert missed["torque in yaw"].rms < 1.1 * missed["torque in yaw"].whole
    # The prediction one second ahead that is drawn is the one that was judged.
    error = np.linalg.norm((result.prediction.predicted - result.prediction.measured)[:, :3], axis=1)
    ahead = pytest.approx(1.0)
    judged = next(each for each in result.report.errors if (each.state, each.horizon) == ("position", ahead))
    assert np.sqrt(np.mean(error**2)) == pytest.approx(judged.model, rel=0.2)


@pytest.mark.slow
def test_tables_of_which_none_is_chosen_are_refused(table):
    path, columns = table
    with pytest.raises(ConfigError, match="nothing to fit"):
        analyze_tables([path, path], columns, AnalysisConfig(training=("march*",)))
