"""The vertical axis from throttle at 10 Hz and the accelerometer, as logs without RATE have them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

import logparse
from logparse import FlightLog
from logparse.dataflash.writer import write_dataflash
from logparse.tables import COLUMNS
from sysid import frequency

GAIN, LAG = 22.0, 0.06


def _rows(name: str, units: str, t: np.ndarray, columns: dict[str, object]) -> tuple:
    times = np.rint(t * 1e6).astype(np.uint64)
    form, plain = "Q" + "f" * len(columns), "F" + "-" * len(columns)
    return name, form, units.ljust(len(form), "-"), plain, pd.DataFrame({"TimeUS": times, **columns})


def _flown(folder: Path, *, stick: float, seed: int = 1, seconds: float = 90.0) -> logparse.FlightLog:
    """Fly a throttle that is moved every second or so, in gusts, with motors that lag and shake the accelerometer."""
    rng = np.random.default_rng(seed)
    dt = 1e-3
    n = int(seconds / dt)
    t = 5.0 + dt * np.arange(n)
    held = np.repeat(rng.normal(0.0, stick, int(seconds) * 2), n // (int(seconds) * 2))
    smooth = np.exp(-dt / 0.15)
    pilot = 0.5 + lfilter([(1.0 - smooth) ** 2], [1.0, -2.0 * smooth, smooth**2], held)
    pole, gust = np.exp(-dt / LAG), np.exp(-dt / 0.2)
    thrust = lfilter([1.0 - pole], [1.0, -pole], pilot - 0.5)
    wind = lfilter([np.sqrt(1.0 - gust**2)], [1.0, -gust], rng.normal(0.0, 0.2, n))
    felt = -9.81 - GAIN * thrust + wind + 2.0 * np.sin(2.0 * np.pi * 93.0 * t)
    slow, fast = slice(None, None, 100), slice(7, None, 20)
    zero = np.zeros(len(t[fast]))
    gyro = {"GyrX": zero, "GyrY": zero, "GyrZ": zero}
    path = folder / "throttle.BIN"
    write_dataflash(
        path,
        [
            ("MSG", "QZ", "s-", "F-", pd.DataFrame({"TimeUS": [1], "Message": ["ArduCopter V3.3"]})),
            _rows("IMU", "sEEEooo", t[fast], {**gyro, "AccX": zero, "AccY": zero, "AccZ": felt[fast]}),
            _rows("CTUN", "s", t[slow], {"ThrIn": 1e3 * pilot[slow], "ThrOut": 1e3 * pilot[slow]}),
        ],
    )
    return logparse.read_log(path)


def test_throttle_and_accelerometer_tell_the_thrust_per_throttle(tmp_path: Path) -> None:
    frf = frequency.response(_flown(tmp_path, stick=0.1), "vertical")
    found = frequency.fit(frf).parameters
    assert frf.instrument == "pilot's throttle"
    assert found["gain"].value == pytest.approx(GAIN, rel=0.05)
    late = found["effective_delay"]
    assert late.value == pytest.approx(LAG, abs=0.02)


def test_flights_scatter_as_their_errors_say(tmp_path: Path) -> None:
    scores = []
    for seed in range(6):
        gain = frequency.fit(frequency.response(_flown(tmp_path, stick=0.05, seed=seed), "vertical")).parameters["gain"]
        scores.append((gain.value - GAIN) / gain.sigma)
    assert np.sqrt(np.mean(np.square(scores))) < 1.5


def test_a_throttle_that_hardly_moved_is_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(frequency.FrequencyError, match="hardly moved"):
        frequency.response(_flown(tmp_path, stick=1e-4), "vertical")


def test_what_the_height_controller_puts_out_is_no_instrument(tmp_path: Path) -> None:
    """CTUN.ThI of firmware since 3.4 answers the wind."""
    log = _flown(tmp_path, stick=0.1)
    log.messages.replace("CTUN", log.messages["CTUN"].rename(columns={"ThrIn": "ThI"}))
    with pytest.raises(frequency.FrequencyError, match="hardly moved, nor did the target of the height"):
        frequency.response(log, "vertical")


def test_the_thrust_of_another_autopilot_is_a_throttle_as_well(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """PX4 says its thrust command among the rates, and the climb asked for; it has no message of a throttle."""
    log = _flown(tmp_path, stick=0.1)
    rows = log.messages["CTUN"]["ThrOut"] / 1e3
    columns = {"rates": ("out_thrust", rows), "setpoints": ("v_d_ref", 2.0 * (0.5 - rows))}
    told = {
        name: pd.DataFrame({column: values}).reindex(columns=list(COLUMNS[name]))
        for name, (column, values) in columns.items()
    }
    monkeypatch.setattr(FlightLog, "tables", replace(log.tables, **told))
    log.messages.replace("CTUN", rows.iloc[:0].to_frame())
    frf = frequency.response(log, "vertical")
    assert frf.instrument == "height target"
    assert frequency.fit(frf).parameters["gain"].value == pytest.approx(GAIN, rel=0.05)
