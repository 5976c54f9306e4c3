"""Where commands write: the terminal and the folder given with ``--out``."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console


def console() -> "Console":
    """Give stdout as Rich writes to it; where it is no terminal, wide enough that tables need no folding."""
    from rich.console import Console

    return Console(highlight=False, width=None if sys.stdout.isatty() else 120)


def prepare(folder: Path) -> None:
    """Make the folder for the results and try to write there: before the work, not after it."""
    from tempfile import TemporaryFile

    from pipeline.errors import ConfigError

    try:
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=folder):
            pass
    except FileExistsError as error:
        raise ConfigError(f"--out {folder} is a file; choose a folder") from error
    except OSError as error:
        raise ConfigError(f"--out {folder}: nothing can be written there: {error.strerror or error}") from error
