"""What is said of inputs before anything is fitted, and coherence against its definition."""

import numpy as np
import pytest
from scipy.signal import lfilter

from logparse import Vehicle
from sysid import Experiment
from sysid.records.excitation import coherence, examine
from tests.sysid.simulated import motion

DT = 0.1


def record(u, y=None, vehicle=None, units=None, seed=0, name="a"):
    u = np.asarray(u, dtype=float)
    y = np.random.default_rng(seed).standard_normal(len(u)) if y is None else y
    return Experiment.from_arrays(
        np.arange(len(u)) * DT,
        u,
        y,
        name=name,
        input_names=[f"m{k + 1}" for k in range(u.shape[1])],
        vehicle=vehicle,
        units=units,
    )


def answered(seed, noise, samples=3000, inputs=2):
    """Two inputs and an output that the first drives through a resonance, with noise of a given size."""
    rng = np.random.default_rng(seed)
    u = motion(rng, samples, inputs)
    y = lfilter([1.0, 0.5], [1.0, -1.4, 0.6], u[:, 0])
    return record(u, y / y.std() + noise * rng.standard_normal(samples), name=f"record {seed}")


def test_a_motor_at_its_idle_spin_is_saturated():
    """The mixer keeps motors between MOT_SPIN_MIN and MOT_SPIN_MAX: 1150 and 1950 us here, not 1000 and 2000."""
    vehicle = Vehicle(pwm_min=1000.0, pwm_max=2000.0, spin_min=0.15, spin_max=0.95)
    u = 1500.0 + 100.0 * motion(np.random.default_rng(1), 1000, 3)
    u[:300, 1], u[600:, 2] = 1150.0, 1950.0
    found = examine([record(u, vehicle=vehicle, units={f"m{k}": "us" for k in (1, 2, 3)})]).findings
    told = {
        finding.evidence["input"]: finding.evidence["limit"] for finding in found if finding.id == "motors-at-limits"
    }
    assert told == {"m2": "lower", "m3": "upper"}


def test_a_dead_motor_and_twins_are_named():
    u = motion(np.random.default_rng(2), 1000, 4)
    u[:, 1], u[:, 3] = 1100.0, u[:, 2]
    excitation = examine([record(u)])
    assert excitation.active == (0, 2, 3)
    assert {finding.id for finding in excitation.findings} == {"constant-input", "inputs-alike"}
    assert excitation.independent == 2
    assert excitation.condition == np.inf


def test_eight_motors_driven_by_four_commands_are_four_signals():
    rng = np.random.default_rng(3)
    angle = 2.0 * np.pi * np.arange(8) / 8.0
    mixer = np.column_stack([np.ones(8), np.sin(angle), np.cos(angle), (-1.0) ** np.arange(8)])
    u = motion(rng, 2000, 4) @ mixer.T + 1e-3 * rng.standard_normal((2000, 8))
    excitation = examine([record(u)])
    assert excitation.independent == 4
    assert excitation.findings[0].id == "inputs-alike"
    assert "like 4 independent signals" in excitation.findings[0].reason


def test_coherence_is_the_part_of_the_power_that_the_input_explains():
    """White noise of a known size on a known answer: coherence is S / (S + N) at every frequency."""
    found = coherence([answered(seed, noise=0.3, inputs=1) for seed in range(6)])
    z = np.exp(-1j * found.frequency * DT)
    drive = 1.0 / np.abs(1.0 - 0.8 * z) ** 2 * (1.0 - 0.8**2)
    answer = np.abs((1.0 + 0.5 * z) / (1.0 - 1.4 * z + 0.6 * z**2)) ** 2 * drive
    power = answer / np.mean(answer)
    expected = power / (power + 0.3**2)
    assert np.mean(np.abs(found.multiple[:, 0] - expected)) < 0.05
    np.testing.assert_allclose(found.ordinary[:, 0, 0], found.multiple[:, 0], atol=1e-9)


def test_the_input_that_drives_is_the_one_that_coheres():
    found = coherence([answered(seed, noise=0.1) for seed in range(3)])
    slow = found.frequency < 5.0
    assert np.median(found.ordinary[slow, 0, 0]) > 0.9
    assert np.median(found.ordinary[slow, 1, 0]) < 0.1
    assert (found.multiple[:, 0] >= found.ordinary[:, 0, 0] - 1e-9).all()
    assert not found.findings


@pytest.mark.parametrize("inputs", [1, 4, 8])
def test_unrelated_signals_exceed_the_threshold_as_seldom_as_it_says(inputs):
    rng = np.random.default_rng(4)
    shares, told = [], []
    for k in range(30):
        found = coherence([record(motion(rng, 1500, inputs), seed=k)])
        shares.append(np.mean(found.multiple > found.threshold))
        told += [finding.id for finding in found.findings if finding.notable]
    assert np.mean(shares) < 0.02
    assert told.count("output-unexplained") > 20


def test_an_input_that_rests_beside_its_trim_is_an_input() -> None:
    rng = np.random.default_rng(5)
    t = np.arange(200) / 10.0
    u = np.column_stack([np.full(200, 1500.0), 1500.0 + 50.0 * rng.standard_normal(200)])
    record = Experiment.from_arrays(t, u, t, input_trim=[1450.0, 1500.0])
    found = examine([record])
    assert found.active == (0, 1)
    assert np.isfinite(found.condition)
