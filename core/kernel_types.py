"""Types of the arguments of compiled functions: what a reader may pass, and what they are compiled for.

An alias names the number of dimensions as well, by an empty array beside the type. A function all of whose arguments
have such types (or are numbers, or named tuples of such) can be compiled before it is called.
"""

from collections.abc import Callable
from typing import Annotated, Any, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray

Vector = Annotated[NDArray[np.float64], np.empty(0)]
Matrix = Annotated[NDArray[np.float64], np.empty((0, 0))]
Stack = Annotated[NDArray[np.float64], np.empty((0, 0, 0))]  #: Matrices, one behind the other.
Blocks = Annotated[NDArray[np.float64], np.empty((0, 0, 0, 0))]  #: Several matrices of each row.

Flags = Annotated[NDArray[np.bool_], np.empty(0, np.bool_)]
Bytes = Annotated[NDArray[np.uint8], np.empty(0, np.uint8)]
ByteRows = Annotated[NDArray[np.uint8], np.empty((0, 0), np.uint8)]
Uint16s = Annotated[NDArray[np.uint16], np.empty(0, np.uint16)]
Uint32s = Annotated[NDArray[np.uint32], np.empty(0, np.uint32)]
Uint64s = Annotated[NDArray[np.uint64], np.empty(0, np.uint64)]
Int32s = Annotated[NDArray[np.int32], np.empty(0, np.int32)]
Int32Rows = Annotated[NDArray[np.int32], np.empty((0, 0), np.int32)]
Int64s = Annotated[NDArray[np.int64], np.empty(0, np.int64)]
Int64Rows = Annotated[NDArray[np.int64], np.empty((0, 0), np.int64)]

#: A file's, which nothing writes to.
FileBytes = Annotated[NDArray[np.uint8], np.frombuffer(b"", np.uint8)]


def examples(function: Callable[..., Any]) -> tuple[Any, ...]:
    """Return an argument of each type that a function takes.

    Raises
    ------
    TypeError
        An argument is annotated otherwise.
    """
    hints = get_type_hints(function, include_extras=True)
    return tuple(_example(hint) for name, hint in hints.items() if name != "return")


def _example(hint: Any) -> Any:
    if hint in (int, float, bool):
        return hint()
    if hasattr(hint, "_fields"):
        return hint(*map(_example, get_type_hints(hint, include_extras=True).values()))
    try:
        return get_args(hint)[1]
    except IndexError:
        raise TypeError(f"{hint} does not tell the number of dimensions") from None
