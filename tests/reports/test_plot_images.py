"""Plots as files: the browser draws the page's own figures, or a sentence says that there is none."""

import pytest

from reports.figures.flight import flight_figures
from reports.files.plot_images import NoBrowserError, write_images


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
