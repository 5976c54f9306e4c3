"""Filters and spectra of our own against those of scipy, which takes too long to import for an analysis."""

import numpy as np
import pytest
import scipy

from sysid.records.filtering import above, detrended, hann, lfilter, low_pass_taps, welch


@pytest.mark.parametrize(
    ("b", "a"),
    [((0.2, 0.3, 0.1), (1.0, -0.9, 0.3)), ((0.5, 0.25), (2.0, -1.0)), ((1.0, 2.0, 3.0), (1.0,)), ((2.0,), (4.0,))],
)
def test_filters_as_scipy_does(b: tuple[float, ...], a: tuple[float, ...]) -> None:
    signals = np.random.default_rng(1).normal(size=(200, 3))
    assert lfilter(b, a, signals) == pytest.approx(scipy.signal.lfilter(b, a, signals, axis=0), abs=1e-12)
    assert lfilter(b, a, signals[:, 0]) == pytest.approx(scipy.signal.lfilter(b, a, signals[:, 0]), abs=1e-12)
    zi = np.random.default_rng(2).normal(size=(max(len(a), len(b)) - 1, 3))
    expected, _ = scipy.signal.lfilter(b, a, signals, axis=0, zi=zi)
    assert lfilter(b, a, signals, zi) == pytest.approx(expected, abs=1e-12)
    assert lfilter(b, a, signals[:0]).shape == (0, 3)


@pytest.mark.parametrize("size", [8, 255, 256, 1001])
def test_spectra_as_scipy_makes_them(size: int) -> None:
    signal = 3.0 + np.random.default_rng(1).normal(size=1001)
    hz, density = welch(signal, 50.0, size)
    expected_hz, expected = scipy.signal.welch(signal, 50.0, nperseg=size)
    assert hz == pytest.approx(expected_hz)
    # The mean is subtracted: what is left of it is rounding.
    assert density == pytest.approx(expected, rel=1e-9, abs=1e-20)
    assert hann(size) == pytest.approx(scipy.signal.windows.hann(size, sym=False), abs=1e-15)


def test_windows_and_lines_as_scipy_makes_them() -> None:
    signals = np.random.default_rng(1).normal(size=(50, 3)).cumsum(axis=0)
    assert detrended(signals) == pytest.approx(scipy.signal.detrend(signals, axis=0), abs=1e-12)
    assert detrended(signals[:1]) == pytest.approx(np.zeros((1, 3)))
    assert low_pass_taps(21, 0.1) == pytest.approx(scipy.signal.firwin(21, 0.2), abs=1e-15)


@pytest.mark.parametrize("cutoff", [0.15 / 400.0, 0.01, 0.2])
def test_slow_movements_are_removed_as_scipy_does(cutoff: float) -> None:
    signals = np.random.default_rng(1).normal(size=(3000, 2)).cumsum(axis=0)
    section = scipy.signal.butter(2, cutoff, "high", fs=1.0, output="sos")
    # Poles near one cost digits, here as there.
    assert above(signals, cutoff) == pytest.approx(scipy.signal.sosfiltfilt(section, signals, axis=0), abs=1e-7)
    short = signals[:10]
    assert above(short, cutoff) == pytest.approx(scipy.signal.sosfiltfilt(section, short, axis=0), abs=1e-7)
