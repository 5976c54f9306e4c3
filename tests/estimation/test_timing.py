"""Times of validity, integrals of the IMU and the noise that the log itself shows."""

import numpy as np
import pandas as pd
import pytest
from scipy.signal import butter, group_delay, lfilter

from estimation.timing import ACCEL, GYRO, InertialSignal, filter_delay, noise_density


def imu_table(t, gyro, accel):
    return pd.DataFrame(np.column_stack([gyro, accel]), index=pd.Index(t, name="t"), columns=GYRO + ACCEL)


def test_delay_is_the_group_delay_of_a_butterworth_filter():
    b, a = butter(2, 20.0, fs=10_000.0)
    _, samples = group_delay((b, a), w=[0.5], fs=10_000.0)
    assert filter_delay(20.0) == pytest.approx(samples[0] / 10_000.0, rel=1e-3)
    assert filter_delay(20.0) == pytest.approx(0.01125, rel=1e-3)
    assert filter_delay(0.0) == 0.0


def test_increments_are_integrals_at_the_time_of_movement():
    """A sine seen 11 ms late through the filter is integrated where it happened, between any two times."""
    t = np.arange(0.0, 10.0, 0.02)
    w = 2.0 * np.pi * 1.5
    delay = filter_delay(20.0)
    wave = np.sin(w * (t - delay))[:, None] * np.array([1.0, 2.0, 3.0])
    parameters = {"INS_GYRO_FILTER": 20.0, "INS_ACCEL_FILTER": 20.0}
    signal = InertialSignal.of(imu_table(t, wave, wave), parameters, (1e-4, 1e-3))
    at = np.array([2.0, 2.013, 2.5, 7.77])
    angle, velocity, _ = signal.increments(at)
    exact = (np.cos(w * at[:-1]) - np.cos(w * at[1:]))[:, None] / w * np.array([1.0, 2.0, 3.0])
    # Cubic splines at 13 samples a period: 1e-4 of the amplitude.
    np.testing.assert_allclose(angle, exact, atol=3e-5)
    np.testing.assert_allclose(velocity, exact, atol=3e-5)


@pytest.mark.parametrize("cutoff", [0.0, 20.0])
@pytest.mark.parametrize("rate", [50.0, 400.0])
def test_noise_density_is_that_of_the_noise(cutoff, rate):
    """White noise of known density, filtered and sampled as an autopilot does, is found again within a fifth."""
    rng = np.random.default_rng(1)
    fine = 4000.0 if cutoff else rate
    density = np.array([2e-3, 0.05])
    noise = rng.normal(size=(int(100 * fine), 6)) * np.repeat(density, 3) * np.sqrt(fine)
    if cutoff:
        b, a = butter(2, cutoff, fs=fine)
        noise = lfilter(b, a, noise, axis=0)
    values = noise[:: round(fine / rate)]
    t = np.arange(len(values)) / rate
    found = np.sqrt(noise_density(t, values, (cutoff, cutoff), (1e-6, 1e-6)))
    np.testing.assert_allclose(np.median(found, axis=0), density, rtol=0.2)


def test_movement_that_is_too_fast_for_the_sampling_does_not_count_as_lasting_noise():
    """Steps of the rate every five seconds, through the autopilot's filter: the noise between them stays what it is."""
    rng = np.random.default_rng(3)
    fine, rate = 4000.0, 50.0
    density = np.array([6e-4, 0.02])
    noise = rng.normal(size=(int(100 * fine), 6)) * np.repeat(density, 3) * np.sqrt(fine)
    steps = np.repeat(rng.uniform(-1.0, 1.0, (20, 6)) * np.repeat([1.0, 5.0], 3), int(5 * fine), axis=0)
    b, a = butter(2, 20.0, fs=fine)
    values = lfilter(b, a, noise + steps, axis=0)[:: round(fine / rate)]
    found = noise_density(np.arange(len(values)) / rate, values, (20.0, 20.0), (1e-6, 1e-6))
    np.testing.assert_allclose(np.median(found, axis=0), density**2, rtol=0.2)
    # What the steps alias to is added where they are; all of their misfit would be ten times as much.
    assert (found.mean(axis=0) < 2.5 * density**2).all()
