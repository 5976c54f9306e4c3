"""Plots as files hold what the page's figures hold: titles, panels, every trace; drawn twice they are the same."""

import numpy as np
import pytest

from reports.figures.figure import Figure, layout_of, limit_line, line, time_axis
from reports.figures.flight import flight_figures
from reports.files.plot_images import draw, write_images


@pytest.fixture
def stacked() -> Figure:
    t = np.arange(0.0, 10.0, 0.1)
    upper = line(t, np.sin(t), "cost $5", "@own") | {"yaxis": "y"}
    lower = line(t, np.where(t > 5.0, np.nan, np.cos(t)), "flown", "@ink") | {"yaxis": "y2"}
    layout = layout_of(
        xaxis=time_axis(None) | {"anchor": "y2"},
        yaxis={"domain": [0.55, 1.0], "title": {"text": "roll &lt;°&gt;"}},
        yaxis2={"domain": [0.0, 0.45], "title": {"text": "pitch (°)"}, "range": [-2.0, 2.0]},
        shapes=[limit_line(0.5, "y2")],
    )
    return Figure("stacked", "caption", [upper, lower], layout, 400)


def test_panels_titles_and_lines_are_those_of_the_figure(stacked):
    upper, lower = draw(stacked).axes
    assert (upper.get_ylabel(), lower.get_ylabel()) == ("roll <°>", "pitch (°)")
    assert upper.get_position().y0 > lower.get_position().y1
    np.testing.assert_allclose(upper.lines[0].get_ydata(), np.sin(np.arange(0.0, 10.0, 0.1)), atol=1e-3)
    assert lower.get_ylim() == (-2.0, 2.0)
    assert len(lower.lines) == 2  # the limit is one


@pytest.mark.parametrize("image_format", ["png", "svg"])
def test_files_are_written_and_repeatable(stacked, flight, tmp_path, image_format):
    figures = [stacked, *flight_figures(flight)]
    files = write_images(figures, tmp_path, image_format)
    assert [file.name for file in files] == [f"{figure.id}.{image_format}" for figure in figures]
    first = [file.read_bytes() for file in files]
    assert first[0].startswith(b"\x89PNG" if image_format == "png" else b"<?xml")
    assert [file.read_bytes() for file in write_images(figures, tmp_path, image_format)] == first
    if image_format == "svg":
        assert b"cost $5" in first[0]
