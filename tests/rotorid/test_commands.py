"""Single commands as their users meet them: what they print, which files they write, how they end."""

import io
import json
import re

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from logparse import MissingDataError, read_log
from pipeline.config import ConfigError
from rotorid.cli.main import app
from rotorid.cli.output import Guarded
from simulation import CASES, ArrivalError
from sysid.loops.proof import AS_PREDICTED, WORSE, Proof
from tests.reports.builders import unpack
from tests.sysid.axis_flights import flown


def run(*arguments: object):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_list_names_every_case_with_its_settings():
    for listing in (run("simulate", "--list"), run("simulate", "list"), run("simulate")):
        assert all(case.name in listing.stdout for case in CASES.values())
        assert "target=48,35,81 wind=-0.5,0,0" in listing.stdout


def test_a_case_writes_page_text_history_log_and_truth(tmp_path):
    """Characteristics and the names of the files on stdout; the page opens offline and holds its figures."""
    shown = " ".join(run("simulate", "--help").stdout.split())
    case, *settings = re.findall(r"Example: rotorid simulate (.*?) --out", shown)[0].split()
    done = run("simulate", case, *settings, "--out", tmp_path)
    assert done.exit_code == 0, done.output
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {f"{case}.{ending}" for ending in ("html", "txt", "csv", "bin", "json")}
    assert "time of arrival" in done.stdout
    assert all(name in done.stdout for name in names)
    page = (tmp_path / f"{case}.html").read_text(encoding="utf-8")
    assert "time of arrival" in page
    travelling = re.search(r'id="figures">(.*?)</script>', page, re.DOTALL)
    figures = [unpack(figure["packed"]) for figure in json.loads(travelling.group(1))]
    assert "rotor acceleration (rad/s²)" in [figure["layout"]["yaxis"]["title"]["text"] for figure in figures]
    assert page.count('class="plot waiting') == 4
    assert "http" not in page.split("<body>")[1].split('id="figures"')[0]


def test_a_table_of_feasibility_is_on_the_page(tmp_path):
    assert run("simulate", "guntur-profile", "--out", tmp_path, "--set", "voltage=14.8").exit_code == 0
    page = (tmp_path / "guntur-profile.html").read_text(encoding="utf-8")
    assert page.count("MT-4006-13 740KV") >= 5
    assert "at 14.8 V" in page


def test_options_come_on_top_of_the_file(tmp_path):
    config = tmp_path / "flight.yaml"
    config.write_text("mass: 1.2\ntarget: [8, 20, 16]\n")
    done = run("simulate", "motion-spatial", "--config", config, "--set", "target=9,6,18", "--out", tmp_path / "out")
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
    done = run("simulate", *arguments, "--out", tmp_path)
    assert isinstance(done.exception, ConfigError)
    assert message in str(done.exception)


def test_a_target_out_of_reach_is_no_wrong_usage(tmp_path):
    done = run("simulate", "motion-wind", "--set", "time_limit=2", "--out", tmp_path)
    assert isinstance(done.exception, ArrivalError)


# ``rotorid plot`` and ``rotorid report``: pages of what is there, sentences about what is not.


GUSTY = "sample_logs/quad01_davos_esc.bin"


def test_fields_are_plotted_to_a_page_that_opens_offline(tmp_path):
    page = tmp_path / "new" / "plot.html"
    result = run("plot", GUSTY, "ATT.Roll", "ATT.DesRoll", "motors.m1", "--out", page, "--start", 40, "--end", 50)
    assert result.exit_code == 0, result.output
    assert str(page) in result.output.replace("\n", "")
    text = page.read_text("utf-8")
    assert "ATT.Roll, ATT.DesRoll, motors.m1" in text
    assert "https://" not in text.split("<script", 1)[0]


def test_wrong_names_and_times_are_told(tmp_path):
    assert isinstance(run("plot", GUSTY, "ATT.Rool").exception, MissingDataError)  # status 3: there is no answer
    assert run("plot", GUSTY, "ATT.Roll", "--start", 5, "--end", 4).exit_code == 2
    assert run("plot", GUSTY, "ATT.Roll", "--start", 5000).exit_code == 2
    assert not list(tmp_path.iterdir())


def test_json_of_a_report_comes_back_as_it_is_and_a_folder_without_one_is_told(tmp_path):
    assert isinstance(run("report", tmp_path).exception, ConfigError)
    for text, same in ((json.dumps({"kind": "flight"}) + "\n", True), ("{not json", False)):
        (tmp_path / "report.json").write_text(text)
        done = run("report", tmp_path, *["--json"] * same)
        assert done.output == text if same else isinstance(done.exception, ConfigError)


# ``rotorid bench`` and ``rotorid bifilar`` as a person uses them: files, numbers, sentences.


@pytest.fixture
def stand(tmp_path):
    """Write the test of a motor at two voltages, thrust in grams, with speeds."""
    lines = ["ESC signal (µs),Thrust (gf),Torque (N·m),Voltage (V),Motor Electrical Speed (RPM),Current (A)"]
    for voltage in (16.0, 14.0):
        for pwm in range(1000, 2001, 100):
            w = voltage / 16.0 * 0.9 * (pwm - 1000)
            newton, torque = 2e-5 * w * w, 3e-7 * w * w
            rpm = w * 9.549297
            lines.append(f"{pwm},{newton / 0.00980665:.3f},{torque:.6f},{voltage},{rpm:.1f},{torque * w / 10.0:.3f}")
    path = tmp_path / "stand.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def test_bench_writes_page_and_numbers(stand, tmp_path):
    out = tmp_path / "out"
    done = run("bench", stand, "--weight", "20", "--voltage", "15", "--out", out)
    assert done.exit_code == 0, done.output
    assert "m1 at 15 V carries 5.00 N at" in done.output
    numbers = json.loads((out / "bench.json").read_text())
    at = next(row for row in numbers["coefficients"] if row["voltage"] == 15.0)
    assert at["thrust"]["value"] == pytest.approx(2e-5, rel=0.01)
    assert at["torque"]["value"] == pytest.approx(3e-7, rel=0.01)
    assert "k ω² and τ" in (out / "bench.html").read_text(encoding="utf-8")
    assert (out / "coefficients.csv").read_text().startswith("coefficient,k,b")
    heavy = run("bench", stand, "--weight", "900", "--out", out, "--json")
    assert heavy.exit_code == 3
    assert "its share of the weight is 225.00 N" in json.loads(heavy.stdout)["trim"][0]["reason"]


@pytest.mark.parametrize("weight", ["0", "-1", "nan"])
def test_a_weight_that_is_none_is_wrong_usage(stand, tmp_path, weight):
    done = run("bench", stand, "--weight", weight, "--out", tmp_path / "o")
    assert done.exit_code == 2, done.output
    assert not (tmp_path / "o").exists()


def test_bifilar_prints_inertia_and_checks_the_thread():
    arguments = ["30.1", "30.0", "29.9", "30.0", "--mass", "2.6", "--length", "1.96", "--distance", "0.2"]
    done = run("bifilar", *arguments, "--pendulum", "27.55", "--axis", "z")
    assert done.exit_code == 0, done.output
    assert done.output.startswith("Iz = 0.1")
    assert "g = 10.195 m/s^2" in done.output
    assert "warning: the simple pendulum gives g" in done.output
    numbers = json.loads(run("bifilar", *arguments, "--json").stdout)
    assert numbers["inertia"] == pytest.approx(2.6 * 9.80665 * 9.0 * 0.04 / (39.4784 * 1.96), rel=1e-4)
    vague = run("bifilar", "10.0", "10.0", "--mass", "1", "--length", "1", "--distance", "0.2", "--mass-sigma", "5")
    assert vague.output.startswith("I is not determined: about 0.01 kg m^2 with a standard uncertainty of 0.05 kg m^2")
    assert run("bifilar", "10", "10", "--mass", "nan", "--length", "1", "--distance", "0.2").exit_code == 2


# ``rotorid craft``: every method on a flight of the simulated octocopter, whose truth is known, and the files.


LOG = "sample_logs/octa05_nairobi_turns.bin"


@pytest.mark.slow
def test_all_methods_and_files(tmp_path):
    """Thrust k w_max^2 of Elhesasy 2024 at the flight's median voltage, by every method.

    The air's temperature, which the log does not tell, moves all of them together by the 3.5 % of another day.
    """
    done = run("craft", LOG, "--mass", "4.3", "--arm", "0.35", "--out", tmp_path)
    assert done.exit_code == 0, done.output
    numbers = json.loads((tmp_path / "craft.json").read_text())["craft"]
    expected = 1.105e-5 * 1050.0**2 * (numbers["reference_voltage"] / 16.8) ** 2
    table = pd.read_csv(tmp_path / "parameters.csv").set_index(["parameter", "method"])
    rows = table.loc["thrust over mass"]
    row = rows["si_value"]
    assert len(row) == 6  # five methods, and the headline that is taken from them
    sigma = rows["si_sigma"].dropna()  # methods whose errors are not known state none
    another_day = (row * rows["transfer"] / rows["value"])[sigma.index]
    assert {"headline", "mean thrust", "rigid body"} <= set(sigma.index)
    assert np.all(np.abs(row[sigma.index] - expected) < 2.0 * np.hypot(sigma, another_day))
    assert row.median() == pytest.approx(expected, rel=0.03)
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
    done = run("craft", LOG, "--bench", stand, "--out", tmp_path / "o")
    assert isinstance(done.exception, ConfigError)
    assert "give --mass with --bench" in str(done.exception)


def test_the_estimate_knows_the_date_of_the_log(tmp_path, monkeypatch):
    """Without it the magnetic declination is that of another year than `analyze` takes."""
    dates = []

    def estimate(tables, *, date=None):
        dates.append(date)
        raise ConfigError("far enough")

    monkeypatch.setattr("estimation.estimate", estimate)
    run("craft", LOG, "--out", tmp_path)
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
    done = run("craft", LOG, f"--mass={value}")
    assert done.exit_code == 2
    assert words in " ".join(done.output.split())
    assert "Input should" not in done.output


# `rotorid frequency`: table, sentences, files and page of a chirp; a sentence for an axis that tells nothing.


def test_a_chirp_becomes_files_a_table_and_a_page_and_an_axis_that_nobody_moved_a_sentence(tmp_path):
    chirped, out = flown(tmp_path).path, tmp_path / "out"
    done = run("frequency", chirped, "--axis", "roll", "--out", out)
    assert done.exit_code == 0, done.output
    assert "roll" in done.output.lower()
    files = {path.name for path in out.iterdir()}
    assert {"frequency.html", "frequency.json", "frequency.mat", "frequency_roll.csv"} <= files
    (roll,) = json.loads((out / "frequency.json").read_text())["axes"]
    gain = roll["fit"]["parameters"]["gain"]
    assert abs(gain["value"] - 300.0) < 4.0 * gain["sigma"]
    rows = np.genfromtxt(out / "frequency_roll.csv", delimiter=",", names=True)
    assert rows["hz"][0] < 1.0 < rows["hz"][-1]
    page = (out / "frequency.html").read_text()
    assert "bode-roll" in page
    assert "nan" not in page.split("<script")[0].lower().split()
    unmoved = run("frequency", chirped, "--axis", "pitch", "--out", tmp_path / "none")
    assert (unmoved.exit_code, "pitch" in unmoved.output.lower()) == (3, True)
    assert isinstance(run("frequency", chirped, "--axis", "sideways").exception, ConfigError)


# `rotorid prove` says thin margins first, and ends with 1 where the change of gains is not to be flown.


def proof(gain_db: float = 9.0, verdict: str = AS_PREDICTED, refused: str | None = None) -> Proof:
    index = pd.MultiIndex.from_tuples([("roll", "gain_db")], names=["axis", "quantity"])
    row = {"predicted": 9.0, "predicted_sigma": 0.3, "measured": gain_db, "measured_sigma": 0.2, "unit": "dB"}
    table = pd.DataFrame([row], index=index)
    return Proof(("a",), ("b",), table, verdict, refused, {"ATC_RAT_RLL_P": (0.1, 0.2)}, {}, {})


@pytest.mark.parametrize(
    ("proof", "status", "first"),
    [
        (proof(), 0, "ATC_RAT_RLL_P "),
        (proof(1.2), 1, "THIN: roll has 1.2 dB of gain margin"),
        (proof(verdict=WORSE), 1, "ATC_RAT_RLL_P "),
        (proof(refused="another frame"), 1, "not comparable: another frame"),
    ],
)
def test_the_status_says_whether_to_fly_on(
    monkeypatch: pytest.MonkeyPatch, proof: Proof, status: int, first: str
) -> None:
    monkeypatch.setattr("sysid.loops.proof.prove", lambda *_: proof)
    monkeypatch.setattr("rotorid.cli.tune.open_log", lambda name: name)
    done = run("prove", GUSTY, GUSTY)
    assert (done.exit_code, done.output.startswith(first)) == (status, True), done.output
    assert (proof.verdict in done.output) is (proof.refused is None)


class _Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_control_characters_are_shown_and_not_sent():
    """`rotorid inspect` printed the escapes of a log's name; texts and names of parameters may hold them too."""
    said = "log \x1b]0;title\x07\x1b[2J\x1b[31m \x9b2J é\ttab\r\n"
    piped, terminal = io.StringIO(), _Terminal()
    assert Guarded(piped).write(said) == Guarded(terminal).write(said) == len(said)
    assert piped.getvalue() == "log \\x1b]0;title\\x07\\x1b[2J\\x1b[31m \\x9b2J é\ttab\r\n"
    assert terminal.getvalue() == "log \\x1b]0;title\\x07\\x1b[2J\x1b[31m \\x9b2J é\ttab\r\n"
    assert Guarded(terminal).isatty()
