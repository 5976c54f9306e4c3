"""Bode bands and ellipses against repetition: what estimates scatter, the delta method must foretell."""

import numpy as np
import pytest

from sysid import TransferFunction, frequency_response, poles, zeros

OMEGA = np.logspace(-1.5, 1.0, 40)


def scattered(seed=0, runs=4000):
    """Return a transfer function with a covariance, and draws from it."""
    rng = np.random.default_rng(seed)
    num, den = np.array([0.4, 2.0]), np.array([1.0, 1.6, 4.0, 1.2])
    size = 0.01 * np.concatenate([num, den[1:]])
    mix = rng.standard_normal((5, 5)) / np.sqrt(5.0)
    covariance = (mix @ mix.T) * size * size[:, None]
    draws = rng.multivariate_normal(np.concatenate([num, den[1:]]), covariance, runs)
    return TransferFunction(num, den, covariance), draws


def test_the_bands_are_what_draws_scatter():
    function, draws = scattered()
    result = frequency_response(function, OMEGA)
    s = 1j * OMEGA
    g = np.array([np.polyval(d[:2], s) / np.polyval([1.0, *d[2:]], s) for d in draws])
    ratio = np.log(g / result.response)
    assert result.sigma_gain == pytest.approx(ratio.real.std(axis=0), rel=0.06)
    assert result.sigma_phase == pytest.approx(ratio.imag.std(axis=0), rel=0.06)
    assert result.determined.all()
    low, high = result.band(0.95)
    inside = np.mean((np.abs(g) > low) & (np.abs(g) < high), axis=0)
    assert np.all(np.abs(inside - 0.95) < 0.015)


def test_ellipses_hold_the_roots_of_draws():
    function, draws = scattered(1)
    pole = next(root for root in poles(function) if root.value.imag > 0)
    near = np.array([min(np.roots([1.0, *d[2:]]), key=lambda r: abs(r - pole.value)) for d in draws])
    away = np.array([(near - pole.value).real, (near - pole.value).imag])
    distance = np.einsum("ik,ij,jk->k", away, np.linalg.inv(pole.covariance), away)
    assert np.mean(distance < 5.991) == pytest.approx(0.95, abs=0.015)
    line = pole.ellipse(0.95) - pole.value
    border = np.array([line.real, line.imag])
    assert np.einsum("ik,ij,jk->k", border, np.linalg.inv(pole.covariance), border) == pytest.approx(5.991, rel=1e-3)
    (zero,) = zeros(function)
    values = -draws[:, 1] / draws[:, 0]
    assert zero.value.real == pytest.approx(-5.0)
    assert zero.sigma == pytest.approx(values.std(), rel=0.05)
    assert zero.determined
