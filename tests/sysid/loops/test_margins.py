"""Margins, filters and criteria against closed forms and scipy's designs."""

import numpy as np
import pytest
from scipy import signal
from scipy.signal import butter, freqz

from simulation.axis_loop import AxisPlant, LoopGains, settings_of
from sysid.loops.criteria import identified, sheet, step_numbers
from sysid.loops.filters import harmonic_notches, low_pass_alpha, second_order
from sysid.loops.margins import margins_of
from tests.sysid.axis_flights import flown_loop

HZ = np.geomspace(0.05, 60.0, 4000)
S = 2j * np.pi * HZ


@pytest.mark.parametrize(("k", "stable"), [(20.0, True), (60.0, False)])
def test_integrator_with_delay(k, stable):
    """L = k e^(-s T) / s: crossover k / 2 pi, phase margin 90 deg - k T, gain margin pi / (2 k T), or below zero."""
    delay = 0.03
    m = margins_of(HZ, k * np.exp(-S * delay) / S).row(0)
    assert m["crossover_hz"] == pytest.approx(k / (2.0 * np.pi), rel=1e-4)
    assert m["phase_deg"] == pytest.approx(90.0 - np.degrees(k * delay), abs=0.05)
    assert m["gain_db"] == pytest.approx(20.0 * np.log10(np.pi / (2.0 * k * delay)), abs=0.01)
    assert m["stable"] == stable == (m["gain_db"] > 0.0)


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


def test_gyro_low_pass_is_the_bilinear_butterworth_of_scipy():
    hz = np.geomspace(0.5, 400.0, 40)
    b, a = butter(2, 20.0, fs=1000.0)
    _, expected = freqz(b, a, worN=hz, fs=1000.0)
    np.testing.assert_allclose(second_order(1000.0, 20.0).response(hz), expected, rtol=1e-12)
    # No cut-off is no filter.
    np.testing.assert_allclose(second_order(1000.0, 0.0).response(hz), 1.0)


def test_first_order_alpha_is_ardupilots_not_the_exact_exponential():
    """Dt / (dt + 1 / (2 pi f)): 0.2391 at 20 Hz and 400 Hz, where 1 - exp(-2 pi f dt) would be 0.2696."""
    assert low_pass_alpha(400.0, 20.0) == pytest.approx(0.0025 / (0.0025 + 1.0 / (40.0 * np.pi)))
    assert low_pass_alpha(400.0, 20.0) == pytest.approx(0.2391, abs=1e-4)


def test_notches_attenuate_by_what_their_parameter_says_with_one_quality_below_nyquist():
    """The gain at their centres is the attenuation of INS_HNTCH_ATT."""
    notches = harmonic_notches(1000.0, 200.0, nominal=200.0, bandwidth=100.0, attenuation_db=30.0, harmonics=0b111)
    assert len(notches) == 2  # 600 Hz is beyond 0.48 of 1000 Hz
    for one, centre in zip(notches, (200.0, 400.0), strict=True):
        assert 20.0 * np.log10(abs(one.response(np.array([centre]))[0])) == pytest.approx(-30.0, abs=0.1)
        assert abs(one.response(np.array([0.1 * centre]))[0]) == pytest.approx(1.0, abs=0.01)
    # Half of the power is left half of INS_HNTCH_BW below the centre.
    (one,) = harmonic_notches(8000.0, 100.0, nominal=100.0, bandwidth=40.0, attenuation_db=40.0, harmonics=1)
    assert abs(one.response(np.array([80.0]))[0]) == pytest.approx(np.sqrt(0.5), rel=0.01)


CRAFT = AxisPlant(gain=300.0, damping=1.0, lag=0.015, delay=0.002, filter_hz=40.0)
GAINS = LoopGains(P=0.06, I=0.06, D=0.0015)


@pytest.mark.parametrize("ratio", [0.4, 1.2])
def test_numbers_of_a_step_are_those_of_its_closed_form(ratio):
    """A second-order system of 2 Hz: overshoot exp(-pi z / sqrt(1 - z^2)), the rest from its simulated step."""
    hz, omega = np.geomspace(0.1, 40.0, 600), 4.0 * np.pi
    s = 2j * np.pi * hz
    transfer = omega**2 / (s**2 + 2.0 * ratio * omega * s + omega**2)
    rise, overshoot, settling = (float(number[0]) for number in step_numbers(hz, transfer[None]))
    t, y = signal.step(signal.lti([omega**2], [1.0, 2.0 * ratio * omega, omega**2]), T=np.linspace(0.0, 5.0, 20001))
    known = 100.0 * np.exp(-np.pi * ratio / np.sqrt(1.0 - ratio**2)) if ratio < 1.0 else 0.0
    assert overshoot == pytest.approx(known, abs=0.5)
    assert rise == pytest.approx(t[np.argmax(y >= 0.9)] - t[np.argmax(y >= 0.1)], abs=0.006)
    assert settling == pytest.approx(t[np.flatnonzero(np.abs(y - 1.0) > 0.05)[-1]], abs=0.02)


@pytest.mark.parametrize("final", [0.5, 2.0, np.nan])
def test_a_step_that_ends_elsewhere_never_settles(final):
    """One that stays outside was said to settle with the end of the window; damaged chirps gave one of no numbers."""
    hz = np.geomspace(0.1, 40.0, 600)
    _, _, settling = step_numbers(hz, final / (1.0 + 2j * np.pi * hz[None] / 5.0))
    assert np.isnan(settling).all()


def test_sheet_of_a_known_craft():
    """Every criterion with its value, limit and source; the attitude ones against the formula of the craft."""
    loop = flown_loop(CRAFT, GAINS, 1)
    rows = {one.name: one for one in (*sheet(loop), *identified(loop))}
    assert all(one.source for one in rows.values() if one.limit is not None)
    assert rows["coherence around the crossover"].kept
    assert rows["cost J"].kept
    hz = np.geomspace(0.1, 60.0, 6000)
    settings = settings_of(CRAFT, GAINS)
    s, plant, gyro = 2j * np.pi * hz, CRAFT.response(hz), settings.gyro.response(hz)
    rate = plant / gyro * settings.controller.target_response(hz)
    rate /= 1.0 + plant * settings.controller.error_response(hz)
    broken = settings.angle.P * settings.angle.delay_response(hz) * rate / s
    rejected = np.abs(1.0 / (1.0 + broken))
    edge = 2.0 * np.pi * hz[np.argmax(rejected > 10.0 ** (-3.0 / 20.0))]
    for name, known in (
        ("disturbance rejection bandwidth at the attitude", edge),
        ("disturbance rejection peak at the attitude", 20.0 * np.log10(rejected.max())),
        (
            "attitude bandwidth",
            2.0 * np.pi * hz[np.argmax(np.unwrap(np.angle(broken / (1.0 + broken))) < -0.75 * np.pi)],
        ),
    ):
        assert rows[name].value.value == pytest.approx(known, rel=0.03, abs=3.0 * rows[name].value.sigma), name
    lazy = loop.with_gains(angle_P=0.4)
    assert not {one.name: one for one in sheet(lazy)}["disturbance rejection bandwidth at the attitude"].kept


def test_limits_of_helicopters_are_scaled_to_the_craft():
    """Of 0.6 m a craft is 27 times smaller than a UH-60, and is asked for 5.2 times its frequencies."""
    loop = flown_loop(CRAFT, GAINS, 1)
    whole, small = ({one.name: one for one in sheet(loop, size)} for size in (None, 0.6))
    for name in ("attitude bandwidth", "disturbance rejection bandwidth at the attitude"):
        assert small[name].limit == pytest.approx(np.sqrt(16.36 / 0.6) * whole[name].limit)
        assert "Froude" in small[name].source
        assert "unscaled" in whole[name].source
    assert small["gain margin at the mixer"] == whole["gain margin at the mixer"]
