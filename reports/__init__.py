"""Reports: results as pages, tables and files.

Names are imported when they are first used, so that a report's numbers can be read without the packages that made them.
"""

from pathlib import Path
from typing import TYPE_CHECKING

from core.lazy import exports, lazy

if TYPE_CHECKING:
    from pipeline.results.craft import GroupResult
    from pipeline.results.flight import FlightResult
    from reports.files import folder as reports_folder
    from reports.files.fleet import write_fleet
    from reports.files.folder import write
    from reports.files.plot_images import ImageFormat
    from reports.files.replay import write_replay
else:
    reports_folder = lazy("reports.files.folder")

#: Plotly's script where the pages of flights share it, at the root of a folder of flights and crafts.
SHARED_SCRIPT = "plotly.min.js"

#: What the process that workers are forked from imports once for all: each starts at once and shares its memory.
PRELOAD = (
    "pipeline.execution.compiling",
    "pipeline.fleet.job",
    "pipeline.fleet.crafts",
    "reports.files.folder",
    "reports.files.fleet",
)

__all__ = ["publish", "write", "write_fleet", "write_replay"]

__getattr__, __dir__ = exports(__name__, __file__)


def publish(
    result: "FlightResult | GroupResult | None", folder: str | Path, plots: "ImageFormat | None" = None
) -> Path:
    """Write the same as `write` for a folder ``flights/NAME`` or ``crafts/NAME`` that `write_fleet` composes from.

    With `plots` also those of flights as files. It is named in `pipeline.analyze_fleet` also where nothing is new, and
    so must not wait for the packages behind it.

    Parameters
    ----------
    result : FlightResult or GroupResult, optional
        What to write; without it pages are drawn anew of what this wrote before.
    folder : path-like
        Where to.
    plots : {"png", "svg"}, optional
        Format in which to write plots as files too.

    Returns
    -------
    Path
        The page.
    """
    return reports_folder.write_for_fleet(result, Path(folder), plots)
