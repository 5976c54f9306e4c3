"""What a log cannot tell about a loop, as an error with a sentence for the pilot."""

from __future__ import annotations

from logparse import RotoridError


class LoopError(RotoridError):
    """The log does not describe the loop: unknown firmware, missing parameters or signals, another craft."""
