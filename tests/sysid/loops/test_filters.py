"""The autopilot's filters against closed forms and scipy's designs."""

import numpy as np
import pytest
from scipy.signal import butter, freqz, lfilter

from sysid.loops.filters import cascade, first_order, harmonic_notches, low_pass_alpha, notch, second_order


def test_gyro_low_pass_is_the_bilinear_butterworth_of_scipy():
    hz = np.geomspace(0.5, 400.0, 40)
    b, a = butter(2, 20.0, fs=1000.0)
    _, expected = freqz(b, a, worN=hz, fs=1000.0)
    np.testing.assert_allclose(second_order(1000.0, 20.0).response(hz), expected, rtol=1e-12)


def test_no_cutoff_is_no_filter():
    hz = np.array([1.0, 50.0])
    assert low_pass_alpha(400.0, 0.0) == 1.0
    np.testing.assert_allclose(first_order(400.0, 0.0).response(hz), 1.0)
    np.testing.assert_allclose(second_order(1000.0, 0.0).response(hz), 1.0)


def test_first_order_alpha_is_ardupilots_not_the_exact_exponential():
    """Dt / (dt + 1 / (2 pi f)): 0.2391 at 20 Hz and 400 Hz, where 1 - exp(-2 pi f dt) would be 0.2696."""
    assert low_pass_alpha(400.0, 20.0) == pytest.approx(0.0025 / (0.0025 + 1.0 / (40.0 * np.pi)))
    assert low_pass_alpha(400.0, 20.0) == pytest.approx(0.2391, abs=1e-4)


def test_running_a_filter_agrees_with_its_response():
    one = first_order(400.0, 10.0)
    t = np.arange(4000) / 400.0
    y = lfilter(one.b, one.a, np.exp(2j * np.pi * 7.0 * t).real)
    expected = (one.response(np.array([7.0])) * np.exp(2j * np.pi * 7.0 * t)).real
    np.testing.assert_allclose(y[2000:], expected[2000:], atol=1e-9)


def test_notch_attenuates_by_what_its_parameter_says():
    """The gain at the centre is the attenuation of INS_HNTCH_ATT; half an octave away it is nearly one."""
    (one,) = harmonic_notches(2000.0, 80.0, nominal=80.0, bandwidth=40.0, attenuation_db=40.0, harmonics=1)
    assert 20.0 * np.log10(abs(one.response(np.array([80.0]))[0])) == pytest.approx(-40.0, abs=0.1)
    assert abs(one.response(np.array([8.0]))[0]) == pytest.approx(1.0, abs=0.01)


def test_harmonics_share_quality_and_stop_below_nyquist():
    notches = harmonic_notches(1000.0, 200.0, nominal=200.0, bandwidth=100.0, attenuation_db=30.0, harmonics=0b111)
    assert len(notches) == 2  # 600 Hz is beyond 0.48 of 1000 Hz
    depth = np.abs(cascade(notches, np.array([200.0, 400.0])))
    assert np.all(20.0 * np.log10(depth) < -29.0)


def test_notch_phase_lag_below_its_centre():
    """A notch costs phase below its centre: for small f, 2 alpha-like lag of (1 - A^2) / Q f / f0."""
    one = notch(8000.0, 100.0, 0.1, 2.0)
    lag = -np.angle(one.response(np.array([10.0]))[0])
    assert lag == pytest.approx((1.0 - 0.01) / 2.0 * 0.1, rel=0.03)
