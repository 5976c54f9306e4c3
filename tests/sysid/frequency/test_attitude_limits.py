"""A bandwidth that no craft has is none."""

from dataclasses import dataclass
from typing import cast

import numpy as np
import pytest

from core.parameter import Parameter
from sysid.frequency.closed_loop import crossing_of, possible_bandwidth
from sysid.frequency.fitted import FrequencyFit


def test_a_yaw_that_follows_its_own_heading_has_no_bandwidth():
    """On a real flight the halves said 24 and 89 rad/s: the target of yaw was the heading while nobody turned."""
    found = possible_bandwidth(Parameter(89.0, 8.6, "rad/s"), "yaw")
    assert found.value is None
    assert "follows the heading" in found.reason
    assert possible_bandwidth(Parameter(8.0, 0.5, "rad/s"), "yaw").value == 8.0
    assert possible_bandwidth(Parameter(60.0, 3.0, "rad/s"), "roll").value == 60.0


@dataclass(frozen=True)
class _Lag:
    """A first-order lag with delay, as far as a crossing asks for it."""

    corner: float
    delay: float
    values: tuple[float, ...] = (1.0,)

    def response(self, hz):
        s = 2j * np.pi * hz
        return np.exp(-self.delay * s) / (1.0 + s / self.corner)


def test_the_crossing_of_a_phase_is_where_the_closed_form_has_it():
    """At 5 rad/s the lag turns by 45 degrees and the delay by 90: pi/2 over 5 s."""
    found = cast("FrequencyFit", _Lag(corner=5.0, delay=0.1 * np.pi))
    assert crossing_of(found, -0.75 * np.pi) == pytest.approx(5.0, rel=1e-5)


def test_a_model_that_is_beyond_a_phase_from_the_start_never_passes_it():
    """A garbled log gave one whose search for the bandwidth ended in an error of the solver."""
    assert np.isnan(crossing_of(cast("FrequencyFit", _Lag(corner=1e-4, delay=40.0)), -0.75 * np.pi))
    assert np.isnan(crossing_of(cast("FrequencyFit", _Lag(corner=1e-4, delay=0.0)), -0.75 * np.pi))
