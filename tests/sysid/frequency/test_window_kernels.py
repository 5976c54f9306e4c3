"""Compiled loops over windows against what they say in numpy."""

import numpy as np
import pytest

from sysid.frequency._window_kernels import halved, products
from sysid.records.filtering import low_pass_taps


def test_products_of_windows_and_their_neighbours() -> None:
    random = np.random.default_rng(3)
    left, right = random.normal(size=(7, 2, 2, 5)), random.normal(size=(7, 3, 2, 5))
    places = np.array([0, 1, 2, 4, 5, 9, 10])
    one, two = left[:, :, 0] + 1j * left[:, :, 1], right[:, :, 0] + 1j * right[:, :, 1]
    own = np.einsum("kif,kjf->ijf", one.conj(), two)
    assert products(left, right, places, np.empty((0, 2, 5))) == pytest.approx(np.stack([own.real, own.imag], axis=2))
    parts = random.normal(size=(3, 2, 5))
    turns = parts[:, 0] + 1j * parts[:, 1]
    between = np.zeros((2, 3, 5), dtype=np.complex128)
    for k, first in enumerate(places):
        for other, second in enumerate(places):
            if 0 < second - first <= 3:
                between += one[other].conj()[:, None] * turns[second - first - 1] * two[k]
    expected = np.stack([between.real, between.imag], axis=2)
    assert products(left, right, places, parts) == pytest.approx(expected)
    # As far as the interpreter goes, no index leaves its array.
    assert products.__wrapped__(left, right, places, parts) == pytest.approx(expected)


@pytest.mark.parametrize("size", [41, 42, 43, 100])
def test_every_second_sample_of_what_is_filtered(size: int) -> None:
    signals, taps = np.random.default_rng(4).normal(size=(2, size)), low_pass_taps(41, 0.25)
    expected = np.array([np.convolve(each, taps, "valid")[::2] for each in signals]).T
    assert halved(signals, taps) == pytest.approx(expected)
    assert halved.__wrapped__(signals, taps) == pytest.approx(expected)
