"""`rotorid frequency`: table, sentences, files and page of a chirp; a sentence for an axis that tells nothing."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from rotorid.cli.main import app
from tests.sysid.rate_logs import flown


@pytest.fixture(scope="module")
def chirped(tmp_path_factory):
    return flown(tmp_path_factory.mktemp("chirp")).path


def test_a_chirp_becomes_files_a_table_and_a_page(chirped, tmp_path):
    out = tmp_path / "out"
    done = CliRunner().invoke(app, ["frequency", str(chirped), "--axis", "roll", "--out", str(out)])
    assert done.exit_code == 0, done.output
    assert "roll" in done.output.lower()
    assert {"frequency.html", "frequency.json", "frequency.mat", "frequency_roll.csv"} <= {
        p.name for p in out.iterdir()
    }
    (roll,) = json.loads((out / "frequency.json").read_text())["axes"]
    gain = roll["fit"]["parameters"]["gain"]
    assert abs(gain["value"] - 300.0) < 4.0 * gain["sigma"]
    rows = np.genfromtxt(out / "frequency_roll.csv", delimiter=",", names=True)
    assert rows["hz"][0] < 1.0 < rows["hz"][-1]
    page = (out / "frequency.html").read_text()
    assert "Bode" in page or "bode-roll" in page
    assert "nan" not in page.split("<script")[0].lower().split()


def test_json_alone_on_stdout(chirped, tmp_path):
    done = CliRunner().invoke(
        app, ["frequency", str(chirped), "--axis", "roll", "--json", "--out", str(tmp_path / "out")]
    )
    assert json.loads(done.stdout)["axes"][0]["axis"] == "roll"


def test_an_axis_that_nobody_moved_is_a_sentence_and_status_3(chirped, tmp_path):
    done = CliRunner().invoke(app, ["frequency", str(chirped), "--axis", "pitch", "--out", str(tmp_path / "out")])
    assert done.exit_code == 3
    assert "pitch" in done.output.lower()
    assert "Traceback" not in done.output


def test_an_unknown_axis_is_refused(chirped, tmp_path):
    done = CliRunner().invoke(app, ["frequency", str(chirped), "--axis", "sideways", "--out", str(tmp_path / "out")])
    assert done.exit_code != 0
    assert not (tmp_path / "out").exists()
