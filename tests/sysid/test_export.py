"""Models and records in other tools' hands: what was written is what comes back."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.io import loadmat
from typer.testing import CliRunner

from core.serialization import as_json, from_json
from logparse import MissingDataError
from rotorid.cli.main import app
from sysid import Experiment, TransferFunctionModel, fit_transfer_functions, write_table
from sysid.transfer_functions.export import ExportError, to_control, write_mat
from sysid.transfer_functions.model_record import TransferFunctionsRecord
from tests.sysid.simulated import simulated_record
from tests.sysid.six_dof import flown


@pytest.fixture(scope="module")
def record():
    return simulated_record(70, samples=700)


@pytest.fixture(scope="module")
def model(record):
    return fit_transfer_functions([record], poles=3, zeros=1)


def test_a_model_read_back_predicts_the_same(model):
    unseen = simulated_record(71, samples=500)
    read = TransferFunctionModel.from_record(from_json(as_json(model.record()), TransferFunctionsRecord))
    assert np.array_equal(read.simulate(unseen), model.simulate(unseen))
    assert np.array_equal(read.predict(unseen, 1.0), model.predict(unseen, 1.0))
    function, again = (version.transfer_functions["y2"]["u1"] for version in (model, read))
    assert np.array_equal(again.covariance, function.covariance)
    assert read.training == model.training
    assert read.reports == model.reports


def test_mat_opens_as_cells_of_num_and_den(model, tmp_path):
    path = tmp_path / "models.mat"
    write_mat({"motors": model}, path)
    motors = loadmat(path, struct_as_record=False)["motors"][0, 0]
    assert motors.num.shape == motors.den.shape == (2, 2)
    for row, output in enumerate(model.output_names):
        for column, source in enumerate(model.input_names):
            function = model.transfer_functions[output][source]
            assert motors.num[row, column].tolist() == [function.num.tolist()]
            assert motors.den[row, column].tolist() == [function.den.tolist()]
            assert motors.den_std[row, column][0, 0] == 0.0
            assert motors.num_std[row, column][0] == pytest.approx(function.standard_deviation[:2])
    assert [str(name[0]) for name in motors.inputs[0]] == ["u1", "u2"]
    assert [str(name[0]) for name in motors.outputs[0]] == ["y1", "y2"]


def test_python_control_has_the_same_frequency_response(model):
    system = to_control(model)
    assert (system.input_labels, system.output_labels) == (["u1", "u2"], ["y1", "y2"])
    omega = np.array([0.1, 1.0, 5.0])
    for row, output in enumerate(model.output_names):
        for column, source in enumerate(model.input_names):
            ours = model.transfer_functions[output][source].response(omega)
            assert system(1j * omega)[row, column] == pytest.approx(ours, rel=1e-9)


def test_without_python_control_the_message_says_what_to_install(model, monkeypatch):
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(ExportError, match=r"pip install 'rotorid\[control\]'"):
        to_control(model)


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
