"""Signals by name: instances, units, canonical tables, and errors that say what the log has."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from logparse import read_log
from logparse.expressions import evaluate
from logparse.signals import SignalError, logged_signal
from logparse.tables import Tables
from tests.logparse.builders import Decoded

SAMPLES = Path(__file__).resolve().parents[2] / "sample_logs"


class FakeLog:
    """A log of two messages and one table."""

    def __init__(self):
        t = pd.Index(np.arange(6.0), name="t")
        attitude = pd.DataFrame({"Roll": np.arange(6.0), "Name": ["a"] * 6}, index=t)
        attitude.attrs["units"] = {"Roll": "deg"}
        imu = pd.DataFrame({"I": [0, 1] * 3, "GyrX": np.arange(6.0)}, index=t)
        self.messages = Decoded({"ATT": attitude, "IMU": imu})
        self.tables = Tables(battery=pd.DataFrame({"voltage": np.full(6, 12.0), "current": np.nan}, index=t))
        self.path = type("P", (), {"name": "flight.bin"})


def test_fields_come_with_their_unit_and_instances_apart():
    log = FakeLog()
    roll = logged_signal(log, "ATT.Roll")
    assert (roll.unit, list(roll.y)) == ("deg", [0.0, 1.0, 2.0, 3.0, 4.0, 5.0])
    assert list(logged_signal(log, "IMU[1].GyrX").y) == [1.0, 3.0, 5.0]
    assert list(logged_signal(log, "IMU.GyrX").t) == [0.0, 2.0, 4.0]
    assert logged_signal(log, "battery.voltage").unit == "V"


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("Roll", "MESSAGE.Field"),
        ("ATT.Roll; import os", "MESSAGE.Field"),
        ("XYZ.A", "has no XYZ; it has ATT, IMU"),
        ("gps.lat", "has no gps"),
        ("ATT.Pitch", "has no Pitch; it has Roll"),
        ("ATT.Name", "holds no numbers"),
        ("battery.current", "holds no numbers"),
        ("IMU[2].GyrX", "no instance 2; it has 0, 1"),
        ("ATT[0].Roll", "no instances"),
    ],
)
def test_what_is_not_there_is_said_with_what_is(name, says):
    with pytest.raises(SignalError, match=says.replace("[", r"\[")):
        logged_signal(FakeLog(), name)


@pytest.fixture(scope="module")
def sample():
    return read_log(SAMPLES / "quad01_davos_esc.bin")


def test_one_field_is_decoded_and_nothing_is_kept(sample):
    signal = evaluate(sample, "IMU.AccZ")
    assert "IMU" not in sample.messages.decoded
    np.testing.assert_array_equal(signal.y, sample.messages["IMU"]["AccZ"])
    assert signal.unit == "m/s/s"
