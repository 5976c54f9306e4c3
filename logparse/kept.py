"""What is kept of a log: tables of messages and those made of them while there is room, and small results."""

from collections.abc import Callable, Hashable
from typing import Any, TypeVar

import pandas as pd

#: Bytes that are kept for each message of a log, which has about 60 in the file; and those that always are.
_OF_EACH, _ALWAYS = 24, 16_000_000

Frames = TypeVar("Frames", pd.DataFrame, tuple[pd.DataFrame | None, tuple[pd.DataFrame, ...]])
Result = TypeVar("Result")


class Kept:
    """Frames of a log of so many messages. Where there is no room for one more, the largest others are let go.

    They are made again when they are asked for again: then as much room is made before, as they took.
    """

    def __init__(self, messages: int = 0):
        self._room = max(_ALWAYS, _OF_EACH * messages)
        self._frames: dict[Hashable, Any] = {}
        self._sizes: dict[Hashable, int] = {}  # Of these, and of those that were let go.
        self._results: dict[Hashable, Any] = {}

    def __contains__(self, key: Hashable) -> bool:
        return key in self._frames

    def clear(self) -> None:
        """Let everything go: what it was made of has changed."""
        self._frames.clear()
        self._sizes.clear()
        self._results.clear()

    def get(self, key: Hashable, make: Callable[[], Frames]) -> Frames:
        """Return the frames of a key, made where they are not kept."""
        if key not in self._frames:
            self._make_room(self._sizes.get(key, 0))
            made = make()
            self._sizes[key] = _bytes(made)
            self._make_room(self._sizes[key])
            self._frames[key] = made
        frames: Frames = self._frames[key]
        return frames

    def result(self, key: Hashable, make: Callable[[], Result]) -> Result:
        """Return the result of a key, made once: one so small beside the log that it never needs to go."""
        if key not in self._results:
            self._results[key] = make()
        found: Result = self._results[key]
        return found

    def _make_room(self, size: int) -> None:
        room = self._room - size - sum(self._sizes[key] for key in self._frames)
        for other in sorted(self._frames, key=lambda key: -self._sizes[key]):
            if room >= 0:
                return
            room += self._sizes[other]
            del self._frames[other]


def _bytes(frames: pd.DataFrame | tuple[Any, ...] | None) -> int:
    """Bytes of a frame or several, those of the index included; of a text two pointers."""
    if isinstance(frames, tuple):
        return sum(map(_bytes, frames))
    if frames is None:
        return 0
    return len(frames) * (8 + sum(getattr(dtype, "itemsize", 16) for dtype in frames.dtypes))
