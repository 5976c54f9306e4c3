"""Where commands write: the terminal and the folder given with ``--out``; and how they end."""

import atexit
import re
import sys
from contextlib import suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, NoReturn, cast

if TYPE_CHECKING:
    from rich.console import Console


#: Control characters but for tab and lines; what sets a colour is one where Rich may have written it.
_CONTROL = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f]")


_CONTROL_OR_COLOUR = re.compile(r"\x1b\[[0-9;]*m|" + _CONTROL.pattern)


class Guarded:
    r"""A stream that writes control characters as ``\x1b``: names and texts of logs must not command a terminal."""

    def __init__(self, stream: IO[str]) -> None:
        self._stream = stream
        self._pattern = _CONTROL_OR_COLOUR if stream.isatty() else _CONTROL

    def write(self, text: str) -> int:
        """Write a text."""
        self._stream.write(self._pattern.sub(_shown, text))
        return len(text)

    def __getattr__(self, name: str) -> Any:
        """Return whatever else the stream has."""
        return getattr(self._stream, name)


def _shown(match: re.Match[str]) -> str:
    return match[0] if len(match[0]) > 1 else f"\\x{ord(match[0]):02x}"


def guard_terminal() -> None:
    """Make stdout show control characters instead of sending them."""
    sys.stdout = cast("Any", Guarded(sys.stdout))


def console() -> "Console":
    """Return stdout as Rich writes to it; where it is no terminal, wide enough that tables need no folding."""
    from rich.console import Console

    return Console(highlight=False, width=None if sys.stdout.isatty() else 120)


def prepare(out: str | Path) -> None:
    """Make the folder for the results and try to write there: before the work, not after it.

    It goes again where nothing came of the work.
    """
    from pipeline.config import ConfigError
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
    atexit.register(_discard_empty, Path(out).absolute())


def _discard_empty(folder: Path) -> None:
    with suppress(OSError):  # it holds something
        folder.rmdir()


def show_page(page: Path) -> None:
    """Open a page in the browser, or say where it is when there is none."""
    import webbrowser

    if not webbrowser.open(page.resolve().as_uri()):
        sys.stderr.write(f"rotorid: no browser found; open {page} yourself\n")


#: Read and answered; something failed; used in a wrong way; read, but nothing could be identified or proposed.
OK, SOME_FAILED, WRONG_USAGE, NOT_POSSIBLE = 0, 1, 2, 3


#: Ctrl-C, as shells have it.
INTERRUPTED = 130


def fail(message: str, status: int) -> NoReturn:
    """Report on stderr what is wrong, and end."""
    from pipeline.names import printable  # the pipeline takes a second to load, which only a failure has to spend

    sys.stderr.write(f"rotorid: {printable(message)}\n")
    sys.exit(status)
