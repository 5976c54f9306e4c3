"""Models in other tools' hands: what was written is what comes back, and it answers inputs alike."""

import sys

import numpy as np
import pytest
from scipy.io import loadmat

from core.serialization import as_json, from_json
from sysid import TransferFunctionModel, fit_transfer_functions
from sysid.transfer_functions.export import ExportError, to_control, write_mat
from sysid.transfer_functions.model_record import TransferFunctionsRecord
from tests.sysid.simulated import simulated_record


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
    function, again = (each.transfer_functions["y2"]["u1"] for each in (model, read))
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
