"""Power-ups of the autopilot within one file, as the kernels that follow the boot clock leave them."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from logparse.dataflash import _decode
from logparse.source import Boot

#: A last row on its own is of this boot when it is at most so much later than the one before, us.
_LAST_PAUSE_US = 60_000_000


@dataclass(frozen=True, slots=True)
class Span:
    """Messages of one boot: ``first`` to ``last - 1``, the first of them at byte (or line) `position`."""

    first: int
    last: int
    position: int


def boot_spans(
    rows: npt.NDArray[np.int64], state: npt.NDArray[np.int64], messages: int, size: int
) -> dict[Boot, Span]:  # fmt: skip
    """Return the boots and their messages."""
    n = int(state[_decode.BOOTS])
    rows = rows[: n + 1].copy()
    rows[n, 2:] = state[_decode.BOOT_START], state[_decode.TIME]
    ahead = int(state[_decode.PENDING_TIME] - state[_decode.TIME])
    if 0 < ahead <= (_decode.PAUSE_US if state[_decode.PENDING] > 1 else _LAST_PAUSE_US) and state[_decode.PENDING] > 0:
        # The last rows came after a pause and were too few to be sure of; nothing speaks against them.
        rows[n, 3] = state[_decode.PENDING_TIME]
    lasts = [*rows[1:, 0].tolist(), messages]
    stops = [*rows[1:, 1].tolist(), size]
    return {
        Boot(position, stop, start * 1e-6, end * 1e-6): Span(first, last, position)
        for (first, position, start, end), last, stop in zip(rows.tolist(), lasts, stops, strict=True)
    }
