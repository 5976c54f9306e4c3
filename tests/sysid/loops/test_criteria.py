"""The sheet of criteria: steps of known loops, and a craft whose attitude loop has a formula."""

import numpy as np
import pytest
from scipy import signal

from simulation.axis_loop import AxisPlant, LoopGains, settings_of
from sysid.loops.criteria import identified, sheet, step_numbers
from tests.sysid.loops.flown import flown_loop

CRAFT = AxisPlant(gain=300.0, damping=1.0, lag=0.015, delay=0.002, filter_hz=40.0)
GAINS = LoopGains(P=0.06, I=0.06, D=0.0015)


@pytest.mark.parametrize("ratio", [0.4, 0.7, 1.2])
def test_numbers_of_a_step_are_those_of_its_closed_form(ratio):
    """A second-order system of 2 Hz: overshoot exp(-pi z / sqrt(1 - z^2)), the rest from its simulated step."""
    hz, omega = np.geomspace(0.1, 40.0, 600), 4.0 * np.pi
    s = 2j * np.pi * hz
    transfer = omega**2 / (s**2 + 2.0 * ratio * omega * s + omega**2)
    rise, overshoot, settling = (float(each[0]) for each in step_numbers(hz, transfer[None]))
    t, y = signal.step(signal.lti([omega**2], [1.0, 2.0 * ratio * omega, omega**2]), T=np.linspace(0.0, 5.0, 20001))
    known = 100.0 * np.exp(-np.pi * ratio / np.sqrt(1.0 - ratio**2)) if ratio < 1.0 else 0.0
    assert overshoot == pytest.approx(known, abs=0.5)
    assert rise == pytest.approx(t[np.argmax(y >= 0.9)] - t[np.argmax(y >= 0.1)], abs=0.006)
    assert settling == pytest.approx(t[np.flatnonzero(np.abs(y - 1.0) > 0.05)[-1]], abs=0.02)


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
