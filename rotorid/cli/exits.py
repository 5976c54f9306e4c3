"""How a command ends: its exit status, and the sentence that the user reads when it fails."""

import sys
from typing import NoReturn

#: All went well; some logs failed or none gave a model; the command was used in a wrong way.
OK, SOME_FAILED, WRONG_USAGE = 0, 1, 2

#: Ctrl-C, as shells have it.
INTERRUPTED = 130


def fail(message: str, status: int) -> NoReturn:
    """Report on stderr what is wrong, and end."""
    from pipeline.names import printable  # the pipeline takes a second to load, which only a failure has to spend

    sys.stderr.write(f"rotorid: {printable(message)}\n")
    sys.exit(status)
