"""Structures of an axis: the slopes that a fit climbs by are those of the response."""

import numpy as np
import pytest

from sysid.frequency.structures import STRUCTURES, Structure

EVERY = {structure.name: structure for group in STRUCTURES.values() for structure in group}


@pytest.mark.parametrize("structure", EVERY.values(), ids=list(EVERY))
def test_slopes_are_those_of_the_logarithm_of_the_response(structure: Structure) -> None:
    hz = np.geomspace(0.3, 20.0, 30)
    values = np.random.default_rng(5).uniform(0.5, 2.0, len(structure.specs))
    values[-1] = 0.02  # the delay
    slopes = structure.slopes(values, hz)
    for j in range(len(values)):
        step = np.zeros(len(values))
        step[j] = 1e-5 * values[j]
        apart = np.log(structure.response(values + step, hz) / structure.response(values - step, hz))
        np.testing.assert_allclose(slopes[:, j], apart / (2.0 * step[j]), rtol=1e-6, atol=1e-8)
