"""`rotorid simulate` as a user meets it."""

import json
import re

import pytest
from typer.testing import CliRunner

from pipeline.config import ConfigError
from rotorid.cli.main import app
from simulation import CASES, ArrivalError
from tests.reports.builders import unpack

RUNNER = CliRunner()


def run(*arguments):
    return RUNNER.invoke(app, ["simulate", *map(str, arguments)])


def test_list_names_every_case_with_its_settings():
    for listing in (run("--list"), run("list"), run()):
        assert listing.exit_code == 0
        for case in CASES.values():
            assert case.name in listing.stdout
        assert "target=48,35,81 wind=-0.5,0,0" in listing.stdout
        assert "elhesasy" in listing.stdout


def test_the_help_s_own_example_runs(tmp_path):
    example, *_ = re.findall(r"Example: rotorid simulate (.*?) --out", " ".join(run("--help").stdout.split()))
    done = run(*example.split(), "--out", tmp_path)
    assert done.exit_code == 0, done.output
    assert "time of arrival" in done.stdout


def test_a_case_writes_page_text_history_log_and_truth(tmp_path):
    """Characteristics and the names of the files on stdout; the page opens offline and holds its figures."""
    done = run("motion-vertical", "--out", tmp_path)
    assert done.exit_code == 0
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {f"motion-vertical.{ending}" for ending in ("html", "txt", "csv", "bin", "json")}
    assert "time of arrival" in done.stdout
    assert all(name in done.stdout for name in names)
    page = (tmp_path / "motion-vertical.html").read_text(encoding="utf-8")
    assert "time of arrival" in page
    travelling = re.search(r'id="figures">(.*?)</script>', page, re.DOTALL)
    figures = [unpack(figure["packed"]) for figure in json.loads(travelling.group(1))]
    assert "rotor acceleration (rad/s²)" in [figure["layout"]["yaxis"]["title"]["text"] for figure in figures]
    assert page.count('class="plot waiting') == 4
    assert "http" not in page.split("<body>")[1].split('id="figures"')[0]


def test_a_table_of_feasibility_is_on_the_page(tmp_path):
    assert run("guntur-profile", "--out", tmp_path, "--set", "voltage=14.8").exit_code == 0
    page = (tmp_path / "guntur-profile.html").read_text(encoding="utf-8")
    assert page.count("MT-4006-13 740KV") >= 5
    assert "at 14.8 V" in page


def test_options_come_on_top_of_the_file(tmp_path):
    config = tmp_path / "flight.yaml"
    config.write_text("mass: 1.2\ntarget: [8, 20, 16]\n")
    done = run("motion-spatial", "--config", config, "--set", "target=9,6,18", "--out", tmp_path / "out")
    assert done.exit_code == 0
    assert "9, 6, 18 m" in done.stdout
    truth = json.loads((tmp_path / "out" / "motion-spatial.json").read_text())
    assert truth["vehicle"]["mass_kg"] == 1.2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["motion-winds"], "did you mean motion-wind"),
        (["motion-wind", "--set", "wnd=1"], "did you mean wind"),
        (["motion-wind", "--set", "wind"], "wants name=value"),
        (["octa01_zurich_calm", "--set", "mass=40"], "40 kg cannot be flown"),
        (["sample-logs", "--set", "mass=4"], "have no settings"),
    ],
)
def test_wrong_usage_is_told_in_a_sentence(arguments, message, tmp_path):
    done = run(*arguments, "--out", tmp_path)
    assert isinstance(done.exception, ConfigError)
    assert message in str(done.exception)


def test_a_target_out_of_reach_is_no_wrong_usage(tmp_path):
    done = run("motion-wind", "--set", "time_limit=2", "--out", tmp_path)
    assert isinstance(done.exception, ArrivalError)
