"""Memory that is free, given back, and how often it is looked for."""

import ctypes
import gc
from collections.abc import Callable
from functools import cache


def collect_seldom() -> None:
    """Search for unused cycles of objects in a hundredth of the usual number of times.

    Modules and results are millions of objects that stay and few cycles: searching took a twelfth of an analysis.
    """
    gc.set_threshold(100_000, 20, 20)


def trim_heap() -> None:
    """Return memory that was freed back to the system.

    The C library keeps what large arrays have left, in pieces between what lives on: after the trajectory of a long
    log, twice of what is in use. Where it cannot be told to give that back, nothing is done.
    """
    _trim()(0)


@cache
def _trim() -> Callable[[int], object]:
    try:
        trim: Callable[[int], object] = ctypes.CDLL(None).malloc_trim
    except (OSError, AttributeError, TypeError):  # only the GNU C library has it
        return lambda _: None
    return trim
