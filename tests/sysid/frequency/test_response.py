"""Frequency responses and limits of attitude where the truth is a formula."""

from dataclasses import dataclass, replace
from typing import cast

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from core.parameter import Parameter
from sysid.frequency.axes import AXES, FrequencyError
from sysid.frequency.closed_loop import crossing_of, peak_of, possible_bandwidth
from sysid.frequency.estimate import response_of_records
from sysid.frequency.fit import fit
from sysid.frequency.fitted import FrequencyFit
from sysid.frequency.records import AxisRecord, on_uniform_clock

DT = 0.01


def noise_driven(seed: int, *, duration: float = 60.0, noise: float = 0.0) -> AxisRecord:
    """Return an open-loop record of an integrator with damping 2 1/s and gain 300, exact for a held input."""
    rng = np.random.default_rng(seed)
    n = round(duration / DT)
    u = lfilter([0.2], [1.0, -0.8], rng.normal(0.0, 0.05, n))
    pole = np.exp(-2.0 * DT)
    y = lfilter([0.0, 300.0 * (1.0 - pole) / 2.0], [1.0, -pole], u) + rng.normal(0.0, noise, n)
    everywhere = np.ones(n, dtype=bool)
    return AxisRecord("made", 0.0, DT, u[:, None], y, u[:, None], everywhere, (0.3, 30.0), "")


def truth(hz: np.ndarray) -> np.ndarray:
    z, pole = np.exp(2j * np.pi * hz * DT), np.exp(-2.0 * DT)
    return 150.0 * (1.0 - pole) / (z - pole)


def test_a_known_response_is_found_without_noise() -> None:
    frf = response_of_records([noise_driven(1)], AXES["roll"])
    error = np.log(frf.response / truth(frf.hz))
    # What windows leave of the transients at their ends; without the difference of the output it is ten times as much.
    assert np.max(np.abs(error[frf.hz > 0.6])) < 0.03
    assert np.all(frf.coherence[frf.hz > 0.6] > 0.99)


@pytest.mark.slow
def test_stated_errors_of_gain_and_phase_are_the_real_ones() -> None:
    scores = []
    for seed in range(12):
        frf = response_of_records([noise_driven(seed, noise=0.3)], AXES["roll"])
        error = np.log(frf.response / truth(frf.hz))
        good = frf.usable & (frf.hz > 0.6)
        scores.append(np.concatenate([error.real[good] / frf.sigma[good], error.imag[good] / frf.sigma_phase[good]]))
    spread = float(np.sqrt(np.mean(np.concatenate(scores) ** 2)))
    assert 0.75 < spread < 1.25  # 12 records; composites average errors of window lengths as if they were the same


def test_records_add_up() -> None:
    one = response_of_records([noise_driven(1, noise=0.3)], AXES["roll"])
    four = response_of_records([noise_driven(seed, noise=0.3) for seed in range(4)], AXES["roll"])
    ratio = np.median(one.sigma / four.sigma)
    assert ratio == pytest.approx(2.0, rel=0.2)  # four times the data, half the error
    assert np.median(four.averages / one.averages) == pytest.approx(4.0, rel=0.4)
    assert four.duration == pytest.approx(4.0 * one.duration)


def test_a_record_of_nearly_nothing_but_a_hole_is_refused() -> None:
    """A time stamp years away would ask for a clock of thousands of millions of samples."""
    t = np.concatenate([np.arange(0.0, 20.0, 0.0025), 1.6e8 + np.arange(0.0, 20.0, 0.0025)])
    with pytest.raises(FrequencyError, match="nearly all holes"):
        on_uniform_clock(t, [np.sin(t)])


def test_signals_in_single_precision_have_the_same_response() -> None:
    record = noise_driven(1, noise=0.3)
    single = replace(
        record,
        inputs=record.inputs.astype(np.float32),
        output=record.output.astype(np.float32),
        instruments=record.instruments.astype(np.float32),
    )
    one, other = (response_of_records([part], AXES["roll"]) for part in (record, single))
    good = one.usable
    assert np.max(np.abs(np.log(other.response / one.response))[good] / one.sigma[good]) < 0.01


def kicked(at: list[float], seed: int = 3) -> AxisRecord:
    """Make a record in which only short kicks, at these times [s], moved the axis, in wind all the while."""
    record = noise_driven(seed, noise=0.05)
    t = record.dt * np.arange(len(record.output))
    x = np.sum([np.exp(-0.5 * ((t - moment) / 0.15) ** 2) for moment in at], axis=0)
    y = record.output - noise_driven(seed).output + lfilter([0.0, record.dt], [1.0, -1.0], x)
    return replace(record, inputs=x[:, None], instruments=x[:, None], output=y)


def test_one_kick_tells_no_response() -> None:
    """A real flight whose throttle moved once said a gain of 12.5 ± 0.9 m/s^2, its other half 24.9 ± 0.8."""
    often = response_of_records([kicked([4.0 + 7.0 * k for k in range(8)])], AXES["roll"])
    assert np.count_nonzero(often.counts) > 5
    assert not response_of_records([kicked([31.0])], AXES["roll"]).counts.any()


def test_a_parameter_that_no_frequency_shows_is_not_determined() -> None:
    """A pure delay by a closed loop of first order: a corner of 1e17 rad/s stood as determined, without an error."""
    record = noise_driven(5, noise=0.02)
    late = replace(
        record, output=np.roll(record.inputs[:, 0], 5) + 0.02 * np.random.default_rng(1).normal(size=len(record.output))
    )
    axis = replace(AXES["roll"], unit="rad/rad", attitude="")
    fitted = fit(response_of_records([late], axis), "closed loop, first order")
    assert fitted.parameters["corner"].value is None
    assert fitted.parameters["gain"].value == pytest.approx(1.0, rel=0.05)


def following(seed: int, frequency: float, damping: float, lead: float, late: float) -> AxisRecord:
    """Return a record of a second-order loop with a zero and a delay that follows targets steered at random."""
    rng = np.random.default_rng(seed)
    target = lfilter([0.05], [1.0, -0.95], rng.normal(0.0, 0.3, 4500))
    continuous = [frequency**2 * lead, frequency**2], [1.0, 2.0 * damping * frequency, frequency**2]
    num, den, _ = cont2discrete(continuous, 2.0 * DT, "foh")
    t = 2.0 * DT * np.arange(len(target))
    answer = np.interp(t - late, t, lfilter(num.ravel(), den, target)) + rng.normal(0.0, 0.01, len(t))
    everywhere = np.ones(len(t), dtype=bool)
    return AxisRecord("made", 0.0, 2.0 * DT, target[:, None], answer, target[:, None], everywhere, (0.1, 20.0), "")


@pytest.mark.filterwarnings("ignore:Badly conditioned")
def test_how_late_a_loop_follows_is_told_where_its_damping_lead_and_delay_are_not() -> None:
    """A loop with a lead is fitted by one without, whose delay, less by the lead, was 10 sigma off."""
    axis = replace(AXES["roll"], unit="rad/rad", attitude="")
    scores: dict[str, list[float]] = {"effective_delay": [], "delay": []}
    for seed in range(24):
        rng = np.random.default_rng(1000 + seed)
        frequency, damping, late = rng.uniform(5.0, 18.0), rng.uniform(0.5, 1.0), rng.uniform(0.01, 0.06)
        lead = rng.uniform(0.02, 0.08) if seed % 2 else 0.0
        fitted = fit(response_of_records([following(seed, frequency, damping, lead, late)], axis))
        truth = {"delay": late, "effective_delay": late + 2.0 * damping / frequency - lead}
        for name, known in scores.items():
            stated = fitted.parameters[name]
            if stated.value is not None and stated.sigma:
                known.append((stated.value - truth[name]) / stated.sigma)
    assert len(scores["effective_delay"]) == 24
    assert 0.5 < np.sqrt(np.mean(np.square(scores["effective_delay"]))) < 1.3
    assert len(scores["delay"]) < 12
    assert np.max(np.abs(scores["delay"])) < 4.0


def test_a_yaw_that_follows_its_own_heading_has_no_bandwidth():
    """On a real flight the halves said 24 and 89 rad/s: the target of yaw was the heading while nobody turned."""
    bandwidth = possible_bandwidth(Parameter(89.0, 8.6, "rad/s"), "yaw")
    assert bandwidth.value is None
    assert "follows the heading" in bandwidth.reason
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
    lag = cast("FrequencyFit", _Lag(corner=5.0, delay=0.1 * np.pi))
    assert crossing_of(lag, -0.75 * np.pi) == pytest.approx(5.0, rel=1e-5)
    # One that is beyond a phase from the start never passes it: a garbled log gave one, and an error of the solver.
    for delay in (0.0, 40.0):
        assert np.isnan(crossing_of(cast("FrequencyFit", _Lag(corner=1e-4, delay=delay)), -0.75 * np.pi))
    # What only falls has no peak; rounding made one of 2e-15 +- 3e-14 dB.
    assert peak_of(cast("FrequencyFit", _Lag(corner=1e9, delay=0.1))) == 0.0
