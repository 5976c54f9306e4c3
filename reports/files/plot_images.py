"""The plots of a page as PNG or SVG files, for documents and mails: drawn by the browser from the same figures."""

from __future__ import annotations

import base64
import re
import shutil
import subprocess
from collections.abc import Sequence
from html import unescape
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal
from urllib.parse import unquote

from core.errors import RotoridError
from reports.figures.figure import Figure
from reports.pages.html import plotly_script, render_text, script_json

ImageFormat = Literal["png", "svg"]

#: Browsers that draw without a window, as they are called on Linux, macOS and Windows.
_BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome", "msedge", "microsoft-edge")


class NoBrowserError(RotoridError):
    """No browser that draws plots as files, or one that fails."""


def write_images(figures: Sequence[Figure], folder: Path, image_format: ImageFormat) -> tuple[Path, ...]:
    """Write each figure as ``plots/NAME.png`` or ``.svg``, in the order of the page."""
    browser = next((path for name in _BROWSERS if (path := shutil.which(name))), None)
    if browser is None:
        raise NoBrowserError(
            "plots as files are drawn by Chromium, Chrome or Edge, and none is installed (Debian: apt-get install "
            "chromium); report.html shows the same plots in any browser"
        )
    drawn = [figure.light() for figure in figures]
    # Two pixels of a PNG for each of a page's column of 900.
    scale = 2 if image_format == "png" else 1
    page = render_text("plot_images.html", figures=script_json(drawn), format=image_format, width=900, scale=scale)
    target = folder / "plots"
    target.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory() as scratch:
        (Path(scratch) / "plotly.min.js").write_bytes(plotly_script())
        (Path(scratch) / "plots.html").write_text(page, encoding="utf-8")
        options = ["--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=600000", "--dump-dom"]
        place = [f"--user-data-dir={scratch}/profile", (Path(scratch) / "plots.html").as_uri()]
        try:
            # Longest time for all plots of a flight, s.
            ran = subprocess.run([browser, *options, *place], capture_output=True, timeout=120.0, check=True)
        except (OSError, subprocess.SubprocessError) as error:
            raise NoBrowserError(f"{browser} could not draw the plots: {error}") from error
    images = re.findall(r"data:image/[a-z+]+(;base64)?,(\S+)", ran.stdout.decode("utf-8"))
    if len(images) != len(figures):
        raise NoBrowserError(f"{browser} drew {len(images)} of {len(figures)} plots")
    written = []
    for figure, (encoded, content) in zip(figures, images, strict=True):
        file = target / f"{figure.id}.{image_format}"
        file.write_bytes(base64.b64decode(content) if encoded else unescaped(content).encode("utf-8"))
        written.append(file)
    return tuple(written)


def unescaped(content: str) -> str:
    """Return the text of a data address that the browser wrote into a page."""
    return unquote(unescape(content))
