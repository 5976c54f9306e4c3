"""What coloured residuals do to sums, against the sums written out."""

import numpy as np

from sysid.statistics.covariance import coloured_information, lagged_information


def test_lagged_signals_need_not_stand_beside_each_other() -> None:
    rng = np.random.default_rng(7)
    lags, colour = 6, np.exp(-0.2 * np.arange(24)) * (1.0 - np.arange(24) / 24)
    signals = [np.cumsum(rng.normal(size=size)) for size in (25, 300)]  # the first is shorter than the colour
    beside = [np.column_stack([u[lags - lag : len(u) - lag] for lag in range(1, lags + 1)]) for u in signals]

    found = lagged_information(signals, lags, colour)

    np.testing.assert_allclose(found, coloured_information(beside, colour), rtol=1e-12)
