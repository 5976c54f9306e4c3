"""Signals by name and arithmetic with them: values by closed form, units by dimension, and what cannot be is said."""

from types import SimpleNamespace

import numpy as np
import pytest

from logparse import read_log
from logparse.expressions import evaluate
from logparse.signals import SignalError, logged_signal
from logparse.tables import Tables
from tests.logparse.builders import Decoded
from tests.paths import SAMPLES
from tests.timed import timed


def frame(rate, seconds, units, **columns):
    t = np.arange(0.0, seconds, 1.0 / rate)
    return timed(t, units, **{name: np.asarray(of(t), dtype=float) for name, of in columns.items()})


@pytest.fixture
def log():
    attitude = frame(
        10, 20, {"Roll": "deg", "DesRoll": "deg", "Rate": "deg/s"},
        Roll=lambda t: 10.0 * np.sin(t), DesRoll=lambda t: 12.0 * np.sin(t), Rate=lambda t: 10.0 * np.cos(t),
    )  # fmt: skip
    accel = frame(
        50, 20, {"X": "m/s/s", "Y": "m/s/s", "G": "rad/s"}, X=lambda t: 3.0 + 0 * t, Y=lambda t: 4.0 + 0 * t, G=np.cos
    )
    imu = timed(np.arange(6.0), I=[0, 1] * 3, GyrX=np.arange(6.0))
    messages = Decoded({"ATT": attitude.assign(Name="a"), "ACC": accel, "IMU": imu})
    messages["ATT"].attrs["units"] = attitude.attrs["units"]
    tables = Tables(battery=timed(np.arange(6.0), voltage=12.0, current=np.nan))
    return SimpleNamespace(path=SimpleNamespace(name="a.bin"), messages=messages, tables=tables)


def test_a_name_alone_is_its_signal(log):
    signal = evaluate(log, " ATT.Roll ")
    assert signal.unit == "deg"
    np.testing.assert_array_equal(signal.y, log.messages["ATT"]["Roll"])
    assert list(evaluate(log, "IMU[1].GyrX").y) == [1.0, 3.0, 5.0]
    assert list(evaluate(log, "IMU.GyrX").t) == [0.0, 2.0, 4.0]
    assert evaluate(log, "battery.voltage").unit == "V"


def test_one_field_is_decoded_and_nothing_is_kept():
    sample = read_log(SAMPLES / "quad01_davos_esc.bin")
    signal = evaluate(sample, "IMU.AccZ")
    assert ("message", "IMU") not in sample._kept
    np.testing.assert_array_equal(signal.y, sample.messages["IMU"]["AccZ"])
    assert signal.unit == "m/s/s"


@pytest.mark.parametrize(
    ("text", "unit", "of"),
    [
        ("ATT.Roll - ATT.DesRoll", "deg", lambda t: -2.0 * np.sin(t)),
        ("2 * ATT.Roll + 1", "deg", lambda t: 20.0 * np.sin(t) + 1.0),
        ("-ATT.Roll / 2", "deg", lambda t: -5.0 * np.sin(t)),
        ("rad(ATT.Roll)", "rad", lambda t: np.radians(10.0 * np.sin(t))),
        ("sin(ATT.Roll)", "", lambda t: np.sin(np.radians(10.0 * np.sin(t)))),
        ("hypot(ACC.X, ACC.Y)", "m/s²", lambda t: 5.0 + 0 * t),
        ("sqrt(ACC.X**2 + ACC.Y**2)", "m/s²", lambda t: 5.0 + 0 * t),
        ("max(ACC.X, ACC.Y) * ACC.X", "m²/s^4", lambda t: 12.0 + 0 * t),
        ("ACC.X / ACC.Y", "", lambda t: 0.75 + 0 * t),
        ("deg(ACC.G)", "deg/s", lambda t: np.degrees(np.cos(t))),
    ],
)
def test_values_and_units(log, text, unit, of):
    signal = evaluate(log, text)
    assert signal.unit == unit
    np.testing.assert_allclose(signal.y, of(signal.t), atol=1e-9)


def test_a_derivative_is_by_time_and_its_unit_says_so(log):
    signal = evaluate(log, "rate(ATT.Roll) - ATT.Rate")
    assert signal.unit == "deg/s"
    assert np.abs(signal.y[1:-1]).max() < 0.02  # h^2/6 of the third derivative, 10 deg/s^3


def test_signals_of_different_rates_meet_at_the_faster_ones_times(log):
    signal = evaluate(log, "deg(ACC.G) - ATT.Rate * 57.29577951308232 / 10")
    assert len(signal.t) == 1000
    inside = signal.t < 19.0
    assert np.abs(signal.y[inside]).max() < 0.08  # linear interpolation at 10 Hz: h^2/8 of 57 deg/s^3
    assert np.isnan(signal.y[signal.t > 19.95]).all()  # nothing is known there


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("ATT.Roll + ACC.X", "deg and m/s² cannot be added"),
        ("ATT.Roll +", "cannot be read"),
        ("1 + 2", "holds no signal"),
        ("ATT.Rool - ATT.Roll", "has no Rool"),
        ("XYZ.Roll * 2", "has no XYZ; it has ACC, ATT, IMU"),
        ("Roll", "write ATT.Roll for a signal"),
        ("gps.lat", "has no gps"),
        ("ATT.Pitch", "has no Pitch; it has Roll"),
        ("ATT.Name", "holds no numbers"),
        ("battery.current", "holds no numbers"),
        ("IMU[2].GyrX", "no instance 2; it has 0, 1"),
        ("ATT[0].Roll", "no instances"),
        ("sin(ACC.X)", "is no angle"),
        ("deg(ACC.X)", "holds no angle"),
        ("ATT.Roll ** ATT.Roll", "exponent"),
        ("__import__('os').system('true')", "is no signal"),
        ("ATT.Roll.real", "is no signal"),
        ("open(ATT.Roll)", "is no signal"),
        ("(lambda: 1)()", "is no signal"),
        ("ATT.Roll if 1 else 2", "is no signal"),
        ("(" * 250 + "1" + ")" * 250, "longer than"),
        ("-" * 280 + "ATT.Roll", "more than"),
        ("+".join(["1"] * 140), "more than"),
    ],
)
def test_what_cannot_be_is_said(log, text, says):
    with pytest.raises(SignalError, match=says.replace("(", r"\(")):
        evaluate(log, text)


def test_a_name_with_more_behind_it_is_no_signal(log):
    with pytest.raises(SignalError, match=r"MESSAGE\.Field"):
        logged_signal(log, "ATT.Roll; import os")


def test_a_division_by_zero_is_a_gap_and_no_warning(log):
    with pytest.raises(SignalError, match="no numbers"):
        evaluate(log, "ATT.Roll / (ATT.Roll - ATT.Roll) * 0")
