"""An experiment written as a table is read again as the same experiment."""

from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from logparse import MissingDataError
from rotorid.cli.main import app
from sysid import Experiment, write_table
from tests.sysid.six_dof import flown


@pytest.mark.parametrize("suffix", [".parquet", ".csv"])
def test_a_record_comes_back_as_it_was(tmp_path, suffix):
    record = flown.experiment(flown.fly(12.0, 4), "flight", 4)
    angles = dict.fromkeys(("roll", "pitch", "yaw"))
    w, x, y, z = record.context[["q_w", "q_x", "q_y", "q_z"]].to_numpy().T
    angles["roll"] = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    angles["pitch"] = np.arcsin(2 * (w * y - z * x))
    angles["yaw"] = np.unwrap(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))
    record = replace(record, context=record.context.assign(**angles))
    path, description = write_table(record, tmp_path / f"flight{suffix}", mass=1.2)
    read = Experiment.from_table(path, description)
    assert read.input_names == record.input_names
    assert read.units["m1"] == "rad/s"
    for ours, truth in ((read.t, record.t), (read.u, record.u), (read.y, record.y - record.y[0])):
        assert np.allclose(ours, truth, atol=1e-9)
    for name in ("v_n", "v_d", "w_x", "w_z", "roll", "pitch"):
        assert np.allclose(read.context[name], record.context[name], atol=1e-9)
    assert [motor.spin for motor in read.vehicle.motors] == [motor.spin for motor in record.vehicle.motors]
    angles = [motor.angle for motor in record.vehicle.motors]
    assert np.allclose([motor.angle for motor in read.vehicle.motors], angles, atol=1e-5)


def test_motors_whose_places_are_unknown_are_refused(tmp_path):
    record = replace(flown.experiment(flown.fly(5.0, 4), "flight"), vehicle=None)
    with pytest.raises(MissingDataError, match="places"):
        write_table(record, tmp_path / "flight.csv")


def test_the_command_writes_a_log_in_the_form_that_analyze_reads(tmp_path):
    """The sample's truth: a coaxial pair has one place, and what is read is what the log had."""
    done = CliRunner().invoke(app, ["export", "sample_logs/octa01_zurich_calm.bin", "--table", "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    path, description = done.output.split()
    read = Experiment.from_table(path, description)
    # That of the motor outputs: at 50 Hz thrust was not determined in this flight, 9.8 ± 8.5.
    assert read.rate == pytest.approx(10.0)
    assert read.units["m1"] == "us"
    assert set(read.context.columns) >= {"v_n", "w_x", "roll"}
