"""Records: what is accepted and refused; filters and spectra against those of scipy."""

import numpy as np
import pandas as pd
import pytest
import scipy

from sysid import Experiment, ExperimentError
from sysid.records.experiment import require_alike
from sysid.records.filtering import above, detrended, hann, lfilter, low_pass_taps, welch

T = np.arange(100) * 0.1


def record(**changes):
    arguments = {"t": T, "u": np.sin(T), "y": np.cos(T), "name": "a"} | changes
    return Experiment.from_arrays(**arguments)


def test_a_record_knows_its_rate_trims_and_names():
    made = record(u=np.column_stack([1500.0 + T, 1400.0 - T]))
    assert made.rate == pytest.approx(10.0)
    assert made.duration == pytest.approx(9.9)
    assert made.input_names == ("u1", "u2")
    np.testing.assert_allclose(made.input_trim, [1500.0 + 4.95, 1400.0 - 4.95])
    np.testing.assert_allclose(made.output_trim, [1.0])


def test_split_and_window_carry_everything_along():
    context = pd.DataFrame({"roll": T}, index=T)
    made = record(context=context, units={"y1": "m"})
    first, second = made.split(0.7)
    assert (len(first.t), len(second.t)) == (70, 30)
    assert second.t[0] == T[70]
    assert second.context["roll"].iloc[0] == T[70]
    np.testing.assert_allclose(second.output_trim, made.y[70])
    np.testing.assert_allclose(second.input_trim, made.u[70:].mean(axis=0))
    assert first.name != second.name
    assert first.units == {"y1": "m"}
    middle = made.window(2.0, 5.0)
    assert middle.t[0] == pytest.approx(2.0)
    assert middle.t[-1] == pytest.approx(4.9)
    with pytest.raises(ExperimentError, match="window of 1 samples"):
        made.split(0.99)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"y": np.where(T > 5.0, np.nan, T)}, "output y1 has 49 of 100 values that are not finite"),
        ({"u": np.where(T > 9.75, np.inf, T)}, "input u1 has 2 of 100 values"),
        ({"t": T**1.01}, "not uniform"),
        ({"t": np.where(T == 0.0, np.nan, T)}, "time has values that are not finite"),
        ({"t": T[:5], "u": T[:6], "y": T[:5]}, "t has 5 samples, u 6 and y 5; they must agree"),
        ({"t": T[:3], "u": T[:3], "y": T[:3]}, "at least"),
        ({"input_names": ["a", "b"]}, "2 input names for 1 inputs"),
        ({"y": np.zeros((100, 0))}, "shape"),
    ],
)
def test_bad_data_is_refused_with_the_reason(changes, words):
    with pytest.raises(ExperimentError, match=words):
        record(**changes)


def test_records_of_different_kinds_are_not_mixed():
    with pytest.raises(ExperimentError, match="no experiments"):
        require_alike([])
    with pytest.raises(ExperimentError, match="only records of one kind"):
        require_alike([record(), record(output_names=["z"], name="b")])
    with pytest.raises(ExperimentError, match="10 Hz"):
        require_alike([record(), record(t=np.arange(100) * 0.05, name="b")])


def test_selected_signals_keep_their_order_trims_and_units():
    made = record(
        u=np.column_stack([T, 2.0 * T, 3.0 * T]), y=np.column_stack([1.0 + T, -T]), units={"u3": "m", "y2": "m"}
    )
    part = made.select(inputs=["u3", "u1"], outputs=["y2"])
    np.testing.assert_allclose(part.u, np.column_stack([3.0 * T, T]))
    np.testing.assert_allclose(part.input_trim, [3.0 * 4.95, 4.95])
    assert (part.input_names, part.output_names) == (("u3", "u1"), ("y2",))
    assert made.select(outputs=["y1"]).input_names == ("u1", "u2", "u3")
    with pytest.raises(ExperimentError, match="a has no input m9; its inputs are u1, u2, u3"):
        made.select(inputs=["m9"])
    with pytest.raises(ExperimentError, match="no output is selected"):
        made.select(outputs=[])


def test_a_slower_copy_of_a_fast_record_keeps_the_delay_of_held_inputs():
    """Inputs are held over their intervals: of a model fitted at 250 Hz, rates at 1 kHz were off by a tenth."""
    t = np.arange(4000) / 1000.0
    fast = Experiment.from_arrays(t, 2.0 * t, 3.0 * t)
    slow = fast.at_most(250.0)
    inside = slice(20, -20)
    held = fast.u[:-3, 0] + 2.0 * 0.5 * 0.003
    assert slow.rate == pytest.approx(250.0)
    assert np.allclose(slow.u[inside, 0], held[::4][inside], atol=1e-6)
    assert np.allclose(slow.y[inside, 0], fast.y[::4, 0][inside], atol=1e-6)
    assert fast.at_most(800.0) is fast


@pytest.mark.parametrize(
    ("b", "a"),
    [((0.2, 0.3, 0.1), (1.0, -0.9, 0.3)), ((0.5, 0.25), (2.0, -1.0)), ((1.0, 2.0, 3.0), (1.0,)), ((2.0,), (4.0,))],
)
def test_filters_as_scipy_does(b: tuple[float, ...], a: tuple[float, ...]) -> None:
    signals = np.random.default_rng(1).normal(size=(200, 3))
    assert lfilter(b, a, signals) == pytest.approx(scipy.signal.lfilter(b, a, signals, axis=0), abs=1e-12)
    assert lfilter(b, a, signals[:, 0]) == pytest.approx(scipy.signal.lfilter(b, a, signals[:, 0]), abs=1e-12)
    zi = np.random.default_rng(2).normal(size=(max(len(a), len(b)) - 1, 3))
    expected, _ = scipy.signal.lfilter(b, a, signals, axis=0, zi=zi)
    assert lfilter(b, a, signals, zi) == pytest.approx(expected, abs=1e-12)
    assert lfilter(b, a, signals[:0]).shape == (0, 3)


@pytest.mark.parametrize("size", [255, 256])
def test_spectra_as_scipy_makes_them(size: int) -> None:
    signal = 3.0 + np.random.default_rng(1).normal(size=1001)
    hz, density = welch(signal, 50.0, size)
    expected_hz, expected = scipy.signal.welch(signal, 50.0, nperseg=size)
    assert hz == pytest.approx(expected_hz)
    # The mean is subtracted: what is left of it is rounding.
    assert density == pytest.approx(expected, rel=1e-9, abs=1e-20)
    assert hann(size) == pytest.approx(scipy.signal.windows.hann(size, sym=False), abs=1e-15)


def test_windows_and_lines_as_scipy_makes_them() -> None:
    signals = np.random.default_rng(1).normal(size=(50, 3)).cumsum(axis=0)
    assert detrended(signals) == pytest.approx(scipy.signal.detrend(signals, axis=0), abs=1e-12)
    assert detrended(signals[:1]) == pytest.approx(np.zeros((1, 3)))
    assert low_pass_taps(21, 0.1) == pytest.approx(scipy.signal.firwin(21, 0.2), abs=1e-15)


@pytest.mark.parametrize("cutoff", [0.15 / 400.0, 0.2])
def test_slow_movements_are_removed_as_scipy_does(cutoff: float) -> None:
    signals = np.random.default_rng(1).normal(size=(3000, 2)).cumsum(axis=0)
    section = scipy.signal.butter(2, cutoff, "high", fs=1.0, output="sos")
    # Poles near one cost digits, here as there.
    assert above(signals, cutoff) == pytest.approx(scipy.signal.sosfiltfilt(section, signals, axis=0), abs=1e-7)
    short = signals[:10]
    assert above(short, cutoff) == pytest.approx(scipy.signal.sosfiltfilt(section, short, axis=0), abs=1e-7)
