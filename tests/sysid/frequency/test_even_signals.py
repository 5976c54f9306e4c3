"""Signals on one clock for all that is cut from a flight."""

import numpy as np
import pytest

from sysid.frequency.even_signals import EvenSignals, brought_evenly
from sysid.frequency.rate_signals import RateSignals

RATE = 50.0


@pytest.fixture
def signals() -> RateSignals:
    random = np.random.default_rng(6)
    t = 10.0 + np.arange(1000) / RATE + random.uniform(-1e-3, 1e-3, 1000)
    holed = np.sin(t)
    holed[500] = np.nan
    columns = {"out_roll": np.sin(3.0 * t), "w_x": np.cos(2.0 * t), "out_yaw": holed}
    return RateSignals(t, {name: column.astype(np.float32) for name, column in columns.items()}, with_chirp=True)


def test_they_are_those_of_a_clock_of_their_own(signals: RateSignals) -> None:
    names, further = ["out_roll", "w_x"], {"target": np.tan}
    span = float(signals.t[0]), float(signals.t[-1])
    kept = EvenSignals(signals, *span).between(names, further, *span)
    assert kept is not None
    for one, other in zip(kept, brought_evenly(signals, names, further, *span), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-6)
    assert kept[1].dtype == np.float32


def test_parts_are_cut_from_the_same_clock(signals: RateSignals) -> None:
    even = EvenSignals(signals, 10.0, 30.0)
    whole, part = even.between(["w_x"], {}, 10.0, 30.0), even.between(["w_x"], {}, 15.0, 20.0)
    assert whole is not None
    assert part is not None
    inside = (whole[0] >= 15.0) & (whole[0] <= 20.0)
    np.testing.assert_array_equal(part[0], whole[0][inside])
    np.testing.assert_array_equal(part[1], whole[1][inside])


def test_what_is_not_there_is_not_made_up(signals: RateSignals) -> None:
    even = EvenSignals(signals, 12.0, 20.0)
    assert even.between(["w_x"], {}, 10.0, 20.0) is None  # before the stretch
    later = EvenSignals(signals, 12.0, 25.0)
    assert later.between(["out_roll", "out_yaw"], {}, 12.0, 25.0) is None  # a row is no number
