"""Results in the store come back as they were, and nothing else is read from what pretends to be one."""

import os
import pickle

import numpy as np
import pyarrow
import pytest

from pipeline.storage.kept import read_result, write_result
from pipeline.storage.store import RESULT, FolderStore
from tests.reports.conftest import made_flight


def test_a_flight_comes_back(tmp_path):
    flight = made_flight("a", seed=1, fit=True)
    write_result(flight, tmp_path)
    found = read_result(FolderStore(tmp_path.parent), tmp_path.name)
    assert found.name == "a"
    assert found.tables is None
    assert found.log == flight.log
    for here, there in zip(flight.models, found.models, strict=True):
        assert here.key == there.key
        for mine, theirs in zip(here.predictions, there.predictions, strict=True):
            np.testing.assert_array_equal(mine.y_hat, theirs.y_hat)
    assert found.trajectory.states.equals(flight.trajectory.states)


class Hostile:
    def __init__(self, call, *arguments):
        self.call, self.arguments = call, arguments

    def __reduce__(self):
        return self.call, self.arguments


@pytest.mark.parametrize("call", [os.system, eval, exec, __import__, pickle.loads, np.load, FolderStore.remove])
def test_what_is_no_result_runs_nothing(tmp_path, call):
    with pyarrow.CompressedOutputStream(str(tmp_path / RESULT), "zstd") as stream:
        pickle.dump(Hostile(call, "touch hostile"), stream)
    assert read_result(FolderStore(tmp_path.parent), tmp_path.name) is None


@pytest.mark.parametrize("content", [b"", b"nonsense", b"\x28\xb5\x2f\xfd\x00"])
def test_damage_is_no_result(tmp_path, content):
    (tmp_path / RESULT).write_bytes(content)
    assert read_result(FolderStore(tmp_path.parent), tmp_path.name) is None
    assert read_result(FolderStore(tmp_path.parent), "nowhere") is None
