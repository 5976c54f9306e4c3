"""Plots: what Plotly accepts, what they must not pretend, and the files that the browser draws of them."""

import dataclasses

import numpy as np
import pandas as pd
import plotly.graph_objects as go
import pytest

from pipeline.results.failure import Failure
from reports.figures.figure import MOST_POINTS
from reports.figures.flight import flight_figures, motors
from reports.figures.models import prediction
from reports.files.plot_images import NoBrowserError, write_images
from tests.reports.builders import themed


def test_plotly_accepts_every_figure(flight):
    figures = flight_figures(flight)
    assert [figure.id for figure in figures] == ["track", "altitude", "motors"]
    for figure in figures:
        go.Figure(data=themed(figure.data), layout=themed(figure.layout))  # raises on unknown attributes
        assert figure.caption


def test_every_time_plot_shares_the_flights_time_axis(flight):
    ranges = {tuple(figure.layout["xaxis"]["range"]) for figure in flight_figures(flight) if figure.time}
    assert len(ranges) == 1


def test_lines_break_where_nothing_was_logged(flight):
    """A line across a gap would show commands that nobody recorded."""
    with_gap = flight.motors.drop(flight.motors.loc[60.0:70.0].index)
    line = motors(dataclasses.replace(flight, motors=with_gap)).data[0]
    assert None in line["y"]
    assert line["x"][line["y"].index(None) - 1] == pytest.approx(59.9, abs=0.2)


GROUNDED = Failure("flight", "the log shows no flight")


def test_long_logs_are_thinned(flight):
    t = np.arange(0.0, 3600.0, 0.02)
    fast = pd.DataFrame({"m1": np.full(len(t), 1500.0)}, index=t)
    line = motors(dataclasses.replace(flight, motors=fast, flight=GROUNDED)).data[0]
    assert len(line["x"]) <= MOST_POINTS


def test_held_out_part_is_marked(flight):
    layout = prediction(flight).layout
    band = layout["shapes"][0]
    assert (band["x0"], band["x1"]) == pytest.approx((82.0, 99.9), abs=0.2)
    assert layout["annotations"][0]["text"] == "held out"


@pytest.mark.parametrize("missing", ["trajectory", "gps", "motors", "modes", "flight"])
def test_a_missing_table_costs_only_its_own_plot(flight, missing):
    changed = {missing: GROUNDED if missing in ("trajectory", "flight") else None}
    figures = flight_figures(dataclasses.replace(flight, **changed))
    assert len(figures) >= 2


@pytest.mark.parametrize("image_format", ["png", "svg"])
def test_every_figure_becomes_a_file(flight, tmp_path, image_format, browser):
    figures = flight_figures(flight)
    files = write_images(figures, tmp_path, image_format)
    assert [file.name for file in files] == [f"{figure.id}.{image_format}" for figure in figures]
    first = files[0].read_bytes()
    assert first.startswith(b"\x89PNG" if image_format == "png" else b"<svg")
    assert image_format == "png" or "north (m)" in first.decode()


def test_without_a_browser_a_sentence_says_so(flight, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", "")
    with pytest.raises(NoBrowserError, match="none is installed"):
        write_images(flight_figures(flight), tmp_path, "png")
