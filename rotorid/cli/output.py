"""Where commands write: the terminal and the folder given with ``--out``."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console


def console() -> "Console":
    """Return stdout as Rich writes to it; where it is no terminal, wide enough that tables need no folding."""
    from rich.console import Console

    return Console(highlight=False, width=None if sys.stdout.isatty() else 120)


def prepare(out: str | Path) -> None:
    """Make the folder for the results and try to write there: before the work, not after it."""
    from pipeline.errors import ConfigError
    from pipeline.storage.store import open_store

    try:
        open_store(out).prepare()
    except FileExistsError as error:
        raise ConfigError(f"--out {out} is a file; choose a folder") from error
    except (
        OSError,
        ValueError,
        ImportError,
    ) as error:  # the latter: fsspec knows no such protocol, or lacks its library
        reason = getattr(error, "strerror", None) or error
        raise ConfigError(f"--out {out}: nothing can be written there: {reason}") from error


def show_page(page: Path) -> None:
    """Open a page in the browser, or say where it is when there is none."""
    import webbrowser

    if not webbrowser.open(page.resolve().as_uri()):
        sys.stderr.write(f"rotorid: no browser found; open {page} yourself\n")
