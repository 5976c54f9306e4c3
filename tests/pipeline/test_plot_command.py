"""``rotorid plot`` and ``rotorid report``: pages of what is there, sentences about what is not."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from logparse import RotoridError
from pipeline.config import ConfigError
from rotorid.cli.main import app

SAMPLE = Path(__file__).resolve().parents[2] / "sample_logs" / "quad01_davos_esc.bin"


def run(*arguments: object):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_fields_are_plotted_to_a_page_that_opens_offline(tmp_path):
    page = tmp_path / "new" / "plot.html"
    result = run("plot", SAMPLE, "ATT.Roll", "ATT.DesRoll", "motors.m1", "--out", page, "--start", 40, "--end", 50)
    assert result.exit_code == 0, result.output
    assert str(page) in result.output.replace("\n", "")
    text = page.read_text("utf-8")
    assert "ATT.Roll, ATT.DesRoll, motors.m1" in text
    assert "https://" not in text.split("<script", 1)[0]


def test_wrong_names_and_times_are_told(tmp_path):
    assert isinstance(run("plot", SAMPLE, "ATT.Rool").exception, RotoridError)
    assert run("plot", SAMPLE, "ATT.Roll", "--start", 5, "--end", 4).exit_code == 2
    assert run("plot", SAMPLE, "ATT.Roll", "--start", 5000).exit_code == 2
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("content", [None, "{not json"])
def test_a_folder_without_a_report_is_told(tmp_path, content):
    if content is not None:
        (tmp_path / "report.json").write_text(content)
    assert isinstance(run("report", tmp_path).exception, ConfigError)


def test_json_of_a_report_comes_back_as_it_is(tmp_path):
    text = json.dumps({"kind": "flight"}) + "\n"
    (tmp_path / "report.json").write_text(text)
    assert run("report", tmp_path, "--json").output == text
