"""The pole map shows every pole that it draws."""

from pathlib import Path

import numpy as np

import logparse
from reports.figures.frequency import pole_figure
from simulation.axis_loop import AxisPlant, Excitation, LoopGains, run_axis, write_rate_log
from sysid import frequency


def test_a_lightly_damped_mode_is_within_the_scale(tmp_path: Path) -> None:
    """Scaled by its distance along the real axis only, a mode at 115 rad/s lay outside of the figure."""
    plant = AxisPlant(gain=300.0, lag=0.03, flex_hz=18.0, flex_damping=0.04, flex_share=0.25, filter_hz=60.0)
    shaken = Excitation(duration=40.0, chirp=(0.4, 40.0, 0.08), chirp_seconds=39.0, gust=0.3, noise=0.005)
    run = run_axis(plant, LoopGains.crossing_at(plant, 3.0), shaken, 3)
    write_rate_log(tmp_path / "mode.BIN", {"roll": run}, rate=200.0, filter_hz=60.0)
    fit = frequency.fit(frequency.response(logparse.read_log(tmp_path / "mode.BIN"), "roll"))
    figure = pole_figure([("roll", fit)])
    assert figure is not None
    poles = fit.transfer_function().poles
    assert np.max(poles.imag) > 100.0
    (left, right), (low, high) = (figure.layout[axis]["range"] for axis in ("xaxis", "yaxis"))
    drawn = [trace for trace in figure.data if trace["mode"] == "markers"]
    marks = [place for trace in drawn for place in zip(trace["x"], trace["y"], strict=True)]
    assert len(marks) == len(poles)
    assert all(left < x < right and low < y < high for x, y in marks)
