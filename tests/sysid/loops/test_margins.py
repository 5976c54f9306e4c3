"""Margins against closed forms."""

import numpy as np
import pytest

from sysid.loops.margins import margins_of

HZ = np.geomspace(0.05, 60.0, 4000)
S = 2j * np.pi * HZ


def test_integrator_with_delay():
    """L = k e^(-s T) / s: crossover k / 2 pi, phase margin 90 deg - k T, gain margin pi / (2 k T)."""
    k, delay = 20.0, 0.03
    m = margins_of(HZ, k * np.exp(-S * delay) / S).row(0)
    assert m["crossover_hz"] == pytest.approx(k / (2.0 * np.pi), rel=1e-4)
    assert m["phase_deg"] == pytest.approx(90.0 - np.degrees(k * delay), abs=0.01)
    assert m["gain_db"] == pytest.approx(20.0 * np.log10(np.pi / (2.0 * k * delay)), abs=0.01)
    assert m["stable"]


def test_beyond_the_limit_margins_are_negative_and_the_loop_unstable():
    k, delay = 60.0, 0.03
    m = margins_of(HZ, k * np.exp(-S * delay) / S).row(0)
    assert not m["stable"]
    assert m["gain_db"] == pytest.approx(20.0 * np.log10(np.pi / (2.0 * k * delay)), abs=0.01)
    assert m["phase_deg"] == pytest.approx(90.0 - np.degrees(k * delay), abs=0.05)


def test_peak_and_rejection_of_a_second_order_loop():
    """L = w^2 / (s (s + 2 z w)): S = s (s + 2 z w) / (s^2 + 2 z w s + w^2), whose peak and -3 dB point are computed."""
    w, z = 2.0 * np.pi * 3.0, 0.4
    loop = w**2 / (S * (S + 2.0 * z * w))
    m = margins_of(HZ, loop).row(0)
    sensitivity = np.abs(S * (S + 2.0 * z * w) / (S**2 + 2.0 * z * w * S + w**2))
    assert m["peak_db"] == pytest.approx(20.0 * np.log10(sensitivity.max()), abs=1e-3)
    assert m["rejection_hz"] == pytest.approx(HZ[np.argmax(sensitivity > 10.0**-0.15)], rel=2e-3)
    assert np.isnan(m["gain_db"])  # the phase never reaches -180 deg


def test_three_integrations_and_a_lead_are_conditionally_stable():
    """Lowering the gain destabilises too; that crossing is no gain margin and the loop counts as stable."""
    k = 2.0 * np.pi * 5.0
    loop = k * (1.0 + 2.0 / S) ** 2 / S * np.exp(-S * 0.01)
    m = margins_of(HZ, loop).row(0)
    assert m["stable"]
    assert m["gain_db"] == pytest.approx(20.0 * np.log10(np.pi / (2.0 * k * 0.01)), abs=1.5)
    assert not margins_of(HZ, 0.02 * loop).row(0)["stable"]


def test_a_flexible_mode_beyond_crossover_sets_the_gain_margin():
    """Of a gyro on the far side of the bend, where the mode turns against the craft (share -0.15)."""
    k, w = 2.0 * np.pi * 3.0, 2.0 * np.pi * 20.0
    mode = 1.0 - 0.15 * S**2 / (S**2 + 2.0 * 0.02 * w * S + w**2)
    loop = k / S * np.exp(-S * 0.008) * mode
    without = margins_of(HZ, k / S * np.exp(-S * 0.008)).row(0)
    assert margins_of(HZ, loop).row(0)["gain_db"] < without["gain_db"] - 5.0


def test_many_loops_at_once_are_each_as_alone():
    loops = np.stack([k * np.exp(-S * 0.03) / S for k in (5.0, 20.0, 60.0)])
    together = margins_of(HZ, loops)
    for k in range(3):
        assert together.row(k) == pytest.approx(margins_of(HZ, loops[k]).row(0), nan_ok=True)
