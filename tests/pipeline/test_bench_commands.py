"""``rotorid bench`` and ``rotorid bifilar`` as a person uses them: files, numbers, sentences."""

import json

import pytest
from typer.testing import CliRunner

from rotorid.cli.main import app
from sysid.bench.table import BenchError

RUN = CliRunner()


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
    done = RUN.invoke(app, ["bench", str(stand), "--weight", "20", "--voltage", "15", "--out", str(out)])
    assert done.exit_code == 0, done.output
    assert "m1 at 15 V carries 5.00 N at" in done.output
    numbers = json.loads((out / "bench.json").read_text())
    at = next(row for row in numbers["coefficients"] if row["voltage"] == 15.0)
    assert at["thrust"]["value"] == pytest.approx(2e-5, rel=0.01)
    assert at["torque"]["value"] == pytest.approx(3e-7, rel=0.01)
    page = (out / "bench.html").read_text(encoding="utf-8")
    assert "k ω² and τ" in page
    assert (out / "coefficients.csv").read_text().startswith("coefficient,k,b")


def test_bench_says_what_a_motor_cannot_lift(stand, tmp_path):
    done = RUN.invoke(app, ["bench", str(stand), "--weight", "900", "--out", str(tmp_path / "o"), "--json"])
    assert done.exit_code == 3
    reasons = [row["reason"] for row in json.loads(done.stdout)["trim"]]
    assert "its share of the weight is 225.00 N" in reasons[0]


@pytest.mark.parametrize("weight", ["0", "-1", "nan", "inf"])
def test_a_weight_that_is_none_is_wrong_usage(stand, tmp_path, weight):
    done = RUN.invoke(app, ["bench", str(stand), "--weight", weight, "--out", str(tmp_path / "o")])
    assert done.exit_code == 2, done.output
    assert not (tmp_path / "o").exists()


def test_unusable_table_is_refused_in_a_sentence(tmp_path):
    path = tmp_path / "notes.txt"
    path.write_text("nothing of use\n")
    done = RUN.invoke(app, ["bench", str(path), "--out", str(tmp_path / "o")])
    assert isinstance(done.exception, BenchError)
    assert "needs a header such as" in str(done.exception)


def test_bifilar_prints_inertia_and_checks_the_thread():
    arguments = ["30.1", "30.0", "29.9", "30.0", "--mass", "2.6", "--length", "1.96", "--distance", "0.2"]
    done = RUN.invoke(app, ["bifilar", *arguments, "--pendulum", "27.55", "--axis", "z"])
    assert done.exit_code == 0, done.output
    assert done.output.startswith("Iz = 0.1")
    assert "g = 10.195 m/s^2" in done.output
    assert "warning: the simple pendulum gives g" in done.output
    numbers = json.loads(RUN.invoke(app, ["bifilar", *arguments, "--json"]).stdout)
    assert numbers["inertia"] == pytest.approx(2.6 * 9.80665 * 9.0 * 0.04 / (39.4784 * 1.96), rel=1e-4)


def test_bifilar_writes_no_zero_for_what_is_not_determined():
    hung = ["10.0", "10.0", "--mass", "1", "--length", "1", "--distance", "0.2"]
    done = RUN.invoke(app, ["bifilar", *hung, "--mass-sigma", "5"])
    assert done.output.startswith("I is not determined: about 0.01 kg m^2 with a standard uncertainty of 0.05 kg m^2")
    assert "inertias of the single repetitions: 0 kg m^2" in done.output


def test_nan_is_called_no_number():
    done = RUN.invoke(app, ["bifilar", "10", "10", "--mass", "nan", "--length", "1", "--distance", "0.2"])
    assert done.exit_code == 2
    assert "nan is not a number" in done.output
