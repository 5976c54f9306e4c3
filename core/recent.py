"""The last few results of a function that is asked for the same thing again and again while one flight is judged."""

from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class Recent(Generic[T]):
    """Results by what they were made of; the very same objects, as tables and arrays are slow to compare.

    Parameters
    ----------
    most : int
        Results that are kept, with what they were made of; as the objects are alive, no other can take their identity.
    """

    def __init__(self, most: int):
        self._kept: deque[tuple[tuple[object, ...], T]] = deque(maxlen=most)

    def of(self, *made_of: object, make: Callable[[], T]) -> T:
        """Return what was made of these objects, or make it."""
        for known, result in tuple(self._kept):
            if len(known) == len(made_of) and all(a is b for a, b in zip(known, made_of, strict=True)):
                return result
        made = make()
        self._kept.append((made_of, made))
        return made
