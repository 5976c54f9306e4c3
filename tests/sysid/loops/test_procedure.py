"""ArduPilot's published procedure: chirps from 0.1 to 10 Hz, one log for each axis, its I at 0 in the air."""

import numpy as np
import pytest

from logparse import read_log
from sysid.loops import LoopError, rate_loop, read_settings, tune

HZ = np.geomspace(0.1, 120.0, 4000)
AXES = {"roll": "RLL", "pitch": "PIT", "yaw": "YAW"}


@pytest.fixture(scope="module")
def flights(unpacked):
    return [read_log(unpacked(f"autopilot/methodic_quad15_{axis}")) for axis in AXES]


def test_one_log_for_each_axis_gives_one_set_of_gains(flights):
    """I flew at 0 and is proposed as the firmware's part of P; the way back is to what was before the procedure."""
    result = tune(flights)
    assert result.refused is None
    for log, (axis, letters) in zip(flights, AXES.items(), strict=True):
        p, i, d = (f"ATC_RAT_{letters}_{term}" for term in "PID")
        assert {p, i, d} <= set(result.proposed)
        assert result.proposed[i] == pytest.approx((0.1 if axis == "yaw" else 1.0) * result.proposed[p], rel=1e-3)
        assert result.flown[i] == 0.0 == read_settings(log, axis).controller.I
        assert result.rollback[i] > 0.0
        assert any(axis in remark.split(": I was 0")[0] for remark in result.remarks if ": I was 0" in remark)
    for axis in result.axes:
        assert axis.worst["gain_db"] >= 5.9
        assert axis.worst["phase_deg"] >= 45.0
        assert axis.worst["peak_db"] <= 6.7


def test_part_of_i_as_asked(flights):
    proposed = tune(flights[0], i_term=0.5).proposed
    assert proposed["ATC_RAT_RLL_I"] == pytest.approx(0.5 * proposed["ATC_RAT_RLL_P"], rel=1e-3)
    with pytest.raises(LoopError, match="part"):
        tune(flights[0], i_term=-1.0)


def test_chirps_to_10_hz_foretell_what_chirps_to_40_measure(flights, unpacked):
    """The same craft with its chirp to 40 Hz: margins of the flown gains and of half of them; the edge is at 1.337."""
    low = rate_loop(flights[0], "roll")
    high = rate_loop(read_log(unpacked("autopilot/methodic_quad15_roll40")), "roll")
    for factor in (1.0, 0.5):
        gains = {name: factor * getattr(low.flown.controller, name) for name in ("P", "D")}
        foretold, measured = (loop.with_gains(**gains).margins for loop in (low, high))
        for name, most in (("gain_db", 0.3), ("phase_deg", 2.0), ("peak_db", 1.0)):
            a, b = getattr(foretold, name), getattr(measured, name)
            assert abs(a.value - b.value) < max(most, 0.1 * a.value)
            assert a.sigma > b.sigma
    assert 10.0 ** (low.margins.gain_db.value / 20.0) == pytest.approx(1.337, rel=0.03)
