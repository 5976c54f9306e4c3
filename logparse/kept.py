"""What is kept of a log: tables of messages, those made of them, and what is derived, as long as there is room."""

from collections.abc import Callable, Hashable
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar

import numpy as np
import pandas as pd

#: Bytes that are kept for each message of a log, which has about 60 in the file; and those that always are.
_OF_EACH, _ALWAYS = 12, 16_000_000

Made = TypeVar("Made")


class Kept:
    """What was made of a log of so many messages. Where there is no room for more, the largest others are let go.

    They are made again when they are asked for again: then as much room is made before, as they took.
    """

    def __init__(self, messages: int = 0):
        self._room = max(_ALWAYS, _OF_EACH * messages)
        self._made: dict[Hashable, Any] = {}
        self._sizes: dict[Hashable, int] = {}  # Of these, and of those that were let go.

    def __contains__(self, key: Hashable) -> bool:
        return key in self._made

    def clear(self) -> None:
        """Drop everything, because its sources changed."""
        self._made.clear()
        self._sizes.clear()

    def get(self, key: Hashable, make: Callable[[], Made]) -> Made:
        """Return what is kept by a key, made where it is not."""
        if key not in self._made:
            self._make_room(self._sizes.get(key, 0))
            made = make()
            self._sizes[key] = _bytes(made)
            self._make_room(self._sizes[key])
            self._made[key] = made
        kept: Made = self._made[key]
        return kept

    def _make_room(self, size: int) -> None:
        room = self._room - size - sum(self._sizes[key] for key in self._made)
        for other in sorted(self._made, key=lambda key: -self._sizes[key]):
            if room >= 0:
                return
            room += self._sizes[other]
            del self._made[other]


def _bytes(made: object) -> int:
    """Bytes of tables with their index and of arrays, those within tuples and dataclasses included."""
    if isinstance(made, pd.DataFrame):  # of a text two pointers
        return len(made) * (8 + sum(getattr(dtype, "itemsize", 16) for dtype in made.dtypes))
    if isinstance(made, np.ndarray):
        return made.nbytes
    if isinstance(made, tuple):
        return sum(map(_bytes, made))
    if is_dataclass(made):
        return sum(_bytes(getattr(made, field.name)) for field in fields(made))
    return 0
