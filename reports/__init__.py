"""Reports: results as pages, tables and files.

Names are imported when they are first used, so that a report's numbers can be read without the packages that made them.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from pipeline.results.fleet import GroupResult
    from pipeline.results.flight import FlightResult
    from reports.fleet import write_fleet
    from reports.folder import write
    from reports.plot_images import ImageFormat
    from reports.replay import write_replay

__all__ = ["publish", "write", "write_fleet", "write_replay"]

_HOME = {
    "write": "reports.folder",
    "write_fleet": "reports.fleet",
    "write_replay": "reports.replay",
}


def __getattr__(name: str) -> object:
    if name not in __all__:
        raise AttributeError(f"module 'reports' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def publish(result: "FlightResult | GroupResult", folder: "str | Path", plots: "ImageFormat | None" = None) -> "Path":
    """Write the same as `write` for a folder ``flights/NAME`` or ``crafts/NAME`` that `write_fleet` composes from.

    With `plots` also those of flights as files. It is named in `pipeline.analyze_fleet` also where nothing is new, and
    so must not wait for the packages behind it.
    """
    from reports.folder import write_for_fleet

    report = write_for_fleet(result, folder)
    if plots is not None:
        from reports.plot_images import write_plots

        write_plots(result, report.parent, plots)
    return report
