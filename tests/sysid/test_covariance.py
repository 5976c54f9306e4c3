"""What coloured residuals do to sums, against the sums written out."""

import numpy as np
import pytest

from sysid.statistics.covariance import coloured_information, lagged_information, wander


def spectrum_of(slope: float, rng: np.random.Generator) -> np.ndarray:
    """Make 240 values whose power goes with frequency to this slope."""
    hz = np.fft.rfftfreq(960)
    hz[0] = 1.0
    return np.fft.irfft(np.fft.rfft(rng.standard_normal(960)) * hz ** (0.5 * slope))[:240]


@pytest.mark.parametrize("slope", [0.0, -1.0, -2.0])
def test_halves_of_what_wanders_differ_by_what_each_states(slope: float) -> None:
    rng = np.random.default_rng(5)
    apart = []
    for _ in range(150):
        one, other = np.split(spectrum_of(slope, rng), 2)
        apart.append((one.mean() - other.mean()) / np.hypot(wander(one), wander(other)))
    assert 0.5 < np.sqrt(np.mean(np.square(apart))) < 1.3


def test_what_stands_still_does_not_wander() -> None:
    assert wander(np.zeros(40)) == pytest.approx(0.0, abs=1e-12)


def test_lagged_signals_need_not_stand_beside_each_other() -> None:
    rng = np.random.default_rng(7)
    lags, colour = 6, np.exp(-0.2 * np.arange(24)) * (1.0 - np.arange(24) / 24)
    signals = [np.cumsum(rng.normal(size=size)) for size in (25, 300)]  # the first is shorter than the colour
    beside = [np.column_stack([u[lags - lag : len(u) - lag] for lag in range(1, lags + 1)]) for u in signals]

    found = lagged_information(signals, lags, colour)

    np.testing.assert_allclose(found, coloured_information(beside, colour), rtol=1e-12)
