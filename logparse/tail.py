"""What lies behind the last message of a log."""

from typing import Any

import numpy as np
import numpy.typing as npt

from core.findings import Finding, Severity


def erased_tail(data: npt.NDArray[Any], start: int) -> Finding | None:
    """Distinguish storage that was never written from a tail of other bytes."""
    size = len(data)
    # A look at both ends does, without reading a tail of any length.
    ends = np.concatenate((data[start : start + 4096], data[max(start, size - 4096) :]))
    if size - start < 16 or not (np.all(ends == 0xFF) or np.all(ends == 0)):
        return None
    return Finding(
        "file-end",
        Severity.INFO,
        f"The last {size - start} bytes were never written (all {int(ends[0]):#04x}).",
        evidence={"first_byte": start, "bytes": size - start},
    )
