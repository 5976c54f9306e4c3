"""Sag of a battery whose resistance is known: found with an honest sigma, and not stated where nothing shows it."""

from pathlib import Path

import numpy as np
import pytest

import logparse
from sysid.rotors.battery import sag_resistance

SAMPLES = Path(__file__).resolve().parents[2] / "sample_logs"
TRUTH = 0.021


def pack(seed: int, *, changes: float = 4.0, current_noise: float = 0.5, voltage_noise: float = 0.03):
    """Fly on a pack with a curved open-circuit voltage; sensors have white noise, gusts move the current."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 180.0, 0.1)
    keep = np.exp(-0.1 / 1.5)
    load = np.zeros(len(t))
    for k in range(1, len(t)):
        load[k] = keep * load[k - 1] + np.sqrt(1.0 - keep**2) * rng.normal(0.0, changes)
    current = 18.0 + load
    drawn = np.cumsum(current) * 0.1 / (18.0 * 180.0)
    voltage = 16.6 - 1.4 * drawn + 0.5 * np.exp(-drawn / 0.1) - TRUTH * current
    return t, voltage + rng.normal(0.0, voltage_noise, len(t)), current + rng.normal(0.0, current_noise, len(t))


def test_errors_are_as_large_as_sigma_says():
    found = [sag_resistance(*pack(seed)) for seed in range(40)]
    errors = np.array([(each.value - TRUTH) / each.sigma for each in found])
    assert 0.7 < np.sqrt(np.mean(errors**2)) < 1.4
    assert abs(np.mean(errors)) < 0.5
    assert np.median([each.sigma for each in found]) < 0.1 * TRUTH


def test_noise_of_the_current_sensor_does_not_make_it_small():
    found = [sag_resistance(*pack(seed, current_noise=4.0)).value for seed in range(10)]
    assert np.mean(found) == pytest.approx(TRUTH, rel=0.05)


def test_what_nothing_shows_is_not_stated():
    steady = sag_resistance(*pack(1, changes=0.02))
    assert steady.value is None
    assert "hardly changes" in steady.reason
    t, voltage, current = pack(1)
    assert "no sensor" in sag_resistance(t, voltage, np.zeros(len(t))).reason
    assert "not logged" in sag_resistance(t[:9], voltage[:9], current[:9]).reason


def test_a_simulated_flight_has_the_resistance_of_its_pack():
    log = logparse.read_log(SAMPLES / "quad01_davos_esc.bin")
    flown = log.tables.battery.loc[log.flight.start : log.flight.stop]
    found = sag_resistance(flown.index.to_numpy(), flown["voltage"].to_numpy(), flown["current"].to_numpy())
    assert found.value == pytest.approx(0.02, abs=max(4.0 * found.sigma, 0.004))
