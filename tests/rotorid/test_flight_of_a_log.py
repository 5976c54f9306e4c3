"""LOG#2 on the command line: the second flight of a log, for commands that look at one flight."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from logparse import LogError
from rotorid.cli.main import app
from rotorid.cli.options import open_log

TWO = Path(__file__).parents[3] / "shared" / "logs" / "sitl" / "octa15_two_flights_logdisarmed.BIN"
SAMPLE = Path(__file__).parents[2] / "sample_logs" / "octa01_zurich_calm.bin"


@pytest.mark.skipif(not TWO.exists(), reason="needs the logs beside the repository")
def test_a_flight_is_chosen_by_its_number(capsys):
    first, second = (open_log(Path(f"{TWO}#{k}")) for k in (1, 2))
    assert first.flight.stop <= second.flight.start
    assert second.name == f"{TWO.name}#2"
    assert capsys.readouterr().err == ""
    longest = max(first.flight, second.flight, key=lambda flight: flight.duration)
    assert open_log(TWO).flight == longest
    assert "holds 2 flights" in capsys.readouterr().err
    with pytest.raises(LogError, match="holds 2 flights, not 3"):
        open_log(Path(f"{TWO}#3"))


@pytest.mark.skipif(not TWO.exists(), reason="needs the logs beside the repository")
def test_commands_take_the_flight(tmp_path):
    done = CliRunner().invoke(app, ["frequency", f"{TWO}#2", "--axis", "roll", "--json", "--out", str(tmp_path)])
    assert json.loads(done.stdout)["logs"] == [f"{TWO.name}#2"]
    done = CliRunner().invoke(app, ["inspect", f"{TWO}#2", "--json"])
    seen = json.loads(done.stdout)
    assert len(seen["flights"]) == 1
    assert all(table["start"] >= seen["flights"][0]["start"] for table in seen["tables"])
    done = CliRunner().invoke(app, ["analyze", f"{TWO}#3", "--out", str(tmp_path)])
    assert isinstance(done.exception, LogError)
    done = CliRunner().invoke(app, ["tune", f"{TWO}#1"])
    assert done.exit_code == 3
    assert "SYSTEMID" in done.output


def test_a_file_that_is_not_there_is_wrong_usage():
    for name in ("nowhere.bin", "nowhere.bin#1"):
        done = CliRunner().invoke(app, ["tune", name])
        assert done.exit_code == 2
        assert "does not exist" in done.output


def test_a_file_may_be_called_so(tmp_path):
    odd = tmp_path / "flight#7"
    odd.write_bytes(SAMPLE.read_bytes())
    assert open_log(odd).path == odd
