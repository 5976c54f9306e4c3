"""What readers of all formats find in a file: damage, what follows the last message, clocks, several power-ups."""

from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from core.findings import Finding, info, warning

COPY_AGAIN = "Copy the log again; when it comes out the same, what wrote it failed: the card, the link or the disk."
#: Names that are listed, and bytes of the longest message of any format, a signed frame of MAVLink 2 with its time.
_NAMED, _LONGEST = 8, 288


def listed(names: Iterable[object]) -> str:
    """Write the first of some names, and three points for the others."""
    texts = [str(name) for name in names]
    return ", ".join(texts[:_NAMED]) + (" ..." if len(texts) > _NAMED else "")


def behind_the_end(data: npt.NDArray[Any], start: int, whole: str, *, cut_short: bool) -> Finding:
    """Distinguish what follows the last message: erased storage, a message that the end cuts short, or other bytes."""
    size = len(data)
    # A look at both ends does, without reading a tail of any length.
    ends = np.concatenate((data[start : start + 4096], data[max(start, size - 4096) :]))
    if size - start >= 16 and (np.all(ends == 0xFF) or np.all(ends == 0)):
        text = f"The last {size - start} bytes were never written (all {int(ends[0]):#04x})."
    elif cut_short:
        text = f"The log ends inside a {whole} at byte {start}, which is lost: power was cut or the file is cut short."
    else:
        text = f"The last {size - start} bytes, from byte {start}, are not intact {whole}s."
        if size - start > _LONGEST:
            return warning("file-end", text, COPY_AGAIN, first_byte=start, bytes=size - start)
    return info("file-end", text, first_byte=start, bytes=size - start)


def several_boots(boots: Collection[object]) -> Iterator[Finding]:
    """Report several power-ups in a file."""
    if (n := len(boots)) > 1:
        yield info(
            "several-in-file",
            f"The file holds {n} power-ups of the autopilot; they have different clocks and are read one at a time.",
            boots=n,
        )


def mended_times(mended: Mapping[str, int]) -> Iterator[Finding]:
    """Report the messages of which rows had a time that cannot be."""
    for name, count in mended.items():
        yield warning(
            "clock-doubtful",
            f"{count} rows of {name} carry a time outside the boot or far from their neighbours; their time was "
            "interpolated.",
            message=name,
            rows=count,
        )
