"""``rotorid craft``: every method on a flight of the simulated octocopter, whose truth is known, and the files."""

import json

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from logparse import read_log
from pipeline.config import ConfigError
from rotorid.cli.main import app

RUN = CliRunner()
LOG = "sample_logs/octa05_nairobi_turns.bin"


@pytest.mark.slow
def test_all_methods_and_files(tmp_path):
    """Thrust k w_max^2 of Elhesasy 2024 at the flight's median voltage, by every method.

    The air's temperature, which the log does not tell, moves all of them together by the 3.5 % of another day.
    """
    done = RUN.invoke(app, ["craft", LOG, "--mass", "4.3", "--arm", "0.35", "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    numbers = json.loads((tmp_path / "craft.json").read_text())["craft"]
    expected = 1.105e-5 * 1050.0**2 * (numbers["reference_voltage"] / 16.8) ** 2
    table = pd.read_csv(tmp_path / "parameters.csv").set_index(["parameter", "method"])
    rows = table.loc["thrust over mass"]
    found = rows["si_value"]
    assert len(found) == 6  # five methods, and the headline that is taken from them
    sigma = rows["si_sigma"].dropna()  # methods whose errors are not known state none
    another_day = (found * rows["transfer"] / rows["value"])[sigma.index]
    assert {"headline", "mean thrust", "rigid body"} <= set(sigma.index)
    assert np.all(np.abs(found[sigma.index] - expected) < 2.0 * np.hypot(sigma, another_day))
    assert found.median() == pytest.approx(expected, rel=0.03)
    # The log has the rate controller at 10 Hz, where rotation folds.
    assert "logged too slowly" in table.loc[("roll inertia over mass and arm", "Kim 2017"), "note"]
    assert json.loads((tmp_path / "sitl_frame.json").read_text())["mass"] == 4.3
    assert "no linear hover model" in done.output
    assert "not determined" in done.output
    assert "(1) " in done.output
    page = (tmp_path / "craft.html").read_text("utf-8")
    assert page.count('<div class="line good"') >= 1, "thrust is known"
    assert "Physical parameters by every method" in page
    assert "4.3 kg" in page


def test_a_stand_needs_the_mass(tmp_path):
    stand = tmp_path / "stand.csv"
    stand.write_text("PWM (us),Thrust (N)\n")
    done = RUN.invoke(app, ["craft", LOG, "--bench", str(stand), "--out", str(tmp_path / "o")])
    assert isinstance(done.exception, ConfigError)
    assert "give --mass with --bench" in str(done.exception)


def test_the_estimate_knows_the_date_of_the_log(tmp_path, monkeypatch):
    """Without it the magnetic declination is that of another year than `analyze` takes."""
    dates = []

    def estimate(tables, *, date=None):
        dates.append(date)
        raise ConfigError("far enough")

    monkeypatch.setattr("estimation.estimate", estimate)
    RUN.invoke(app, ["craft", LOG, "--out", str(tmp_path)])
    assert dates == [read_log(LOG).start_utc]
    assert dates[0] is not None


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("3kg", "'3kg' is not a number: leave 'kg' out (3)"),
        ("2,5", "'2,5' is not a number: write it with a point (2.5)"),
        ("heavy", "'heavy' is not a number."),
        ("-1", "-1 is too small: choose 0 or more."),
        ("0", "0 is of no craft: it must be above 0"),
    ],
)
def test_a_mass_that_is_none_is_refused_in_plain_words(value, words):
    done = RUN.invoke(app, ["craft", LOG, f"--mass={value}"])
    assert done.exit_code == 2
    assert words in " ".join(done.output.split())
    assert "Input should" not in done.output
