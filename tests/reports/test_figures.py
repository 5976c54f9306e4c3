"""Plots: what Plotly accepts, what they must not pretend, and the files that the browser draws of them."""

import dataclasses
import shutil

import numpy as np
import pandas as pd
import pytest

from pipeline.results.failure import Failure
from reports.figures.figure import MOST_POINTS
from reports.figures.flight import flight_figures, motors
from reports.figures.models import prediction
from reports.files.plot_images import NoBrowserError, write_images
from tests.reports.builders import accepted


def test_plotly_accepts_every_figure(flight):
    figures = flight_figures(flight)
    assert accepted(figures) == ["track", "altitude", "motors"]
    ranges = {tuple(figure.layout["xaxis"]["range"]) for figure in figures if figure.time}
    assert len(ranges) == 1, "every plot over time has the flight's axis"


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


def test_a_missing_table_costs_only_its_own_plot(flight):
    for missing in ("trajectory", "gps", "motors", "modes", "flight"):
        changed = {missing: GROUNDED if missing in ("trajectory", "flight") else None}
        assert len(flight_figures(dataclasses.replace(flight, **changed))) >= 2


@pytest.mark.slow
def test_every_figure_becomes_a_file(flight, tmp_path):
    if shutil.which("chromium") is None:
        pytest.skip("Chromium is not installed (Debian: apt-get install chromium)")
    figures = flight_figures(flight)
    files = write_images(figures, tmp_path, "svg")
    assert [file.name for file in files] == [f"{figure.id}.svg" for figure in figures]
    assert "north (m)" in files[0].read_text("utf-8")
    (drawn,) = write_images(figures[:1], tmp_path, "png")
    assert drawn.read_bytes().startswith(b"\x89PNG")


def test_without_a_browser_a_sentence_says_so(flight, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", "")
    with pytest.raises(NoBrowserError, match="none is installed"):
        write_images(flight_figures(flight), tmp_path, "png")
