"""Poles that matter can be told apart in the pole map, however fast others are."""

import numpy as np
import pytest

from reports.figures.frequency import pole_map
from sysid import TransferFunction


def function(*poles: complex) -> TransferFunction:
    den = np.real(np.poly(poles))
    return TransferFunction(num=np.array([1.0]), den=den, covariance=1e-12 * np.eye(len(den)))


def marks(figure) -> dict[str, complex]:
    found = {}
    for trace in figure.data:
        if trace["mode"] == "markers":
            found |= {text: complex(x, y) for text, x, y in zip(trace["text"], trace["x"], trace["y"], strict=True)}
    return found


def test_one_fast_pole_does_not_squeeze_the_slow_ones_together():
    figure = pole_map({"m1": function(-250.0, -1.0 + 2.0j, -1.0 - 2.0j, -0.4)}, "x")
    places = marks(figure)
    slow, swing, fast = (places[f"{each} i rad/s"] for each in ("-0.4 + 0", "-1 + 2", "-250 + 0"))
    (left, right), (low, high) = (figure.layout[axis]["range"] for axis in ("xaxis", "yaxis"))
    assert all(left < each.real < right and low < each.imag < high for each in places.values())
    # Parted by more than a twentieth of the frame (a hundredth and less on a linear scale), damping kept.
    assert abs(slow - swing) > 0.05 * (right - left)
    assert np.angle(swing) == pytest.approx(np.angle(-1.0 + 2.0j), abs=1e-3)
    assert abs(fast) > 2.0 * abs(swing)
    assert {note["text"] for note in figure.layout["annotations"]} >= {"1", "10", "100"}
    assert "logarithmic" in figure.caption


def test_poles_of_one_size_stand_on_a_linear_scale():
    figure = pole_map({"m1": function(-5.0, -1.0 + 2.0j, -1.0 - 2.0j)}, "x")
    assert marks(figure)["-5 + 0 i rad/s"] == pytest.approx(-5.0)
    assert "logarithmic" not in figure.caption


def test_an_unstable_pole_is_within_the_frame():
    figure = pole_map({"m1": function(2.0, -3.0)}, "x")
    assert figure.layout["xaxis"]["range"][1] > 2.0
