"""What every format reader offers to `FlightLog`, and what readers of all formats find: damage, ends, clocks, boots."""

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from core.findings import Finding, info, warning
from core.quantity import counted

#: Columns that hold the instance of a sensor, by age of the firmware.
INSTANCE_NAMES = ("I", "Instance", "Inst")


@dataclass(frozen=True, slots=True)
class Boot:
    """One power-up of the autopilot inside a file: a span of the file with one monotonic boot clock.

    `start` and `stop` are byte offsets into the file, or into the binary log that is made of a text log; `t_start` and
    `t_end` are seconds on this boot's clock.
    """

    start: int
    stop: int
    t_start: float
    t_end: float


class MessageSource:
    """An opened log file of one format, scanned but not yet decoded; base of the formats' readers."""

    #: ``"dataflash"``, ``"dataflash-text"``, ``"tlog"``, ``"mavlink-raw"`` or ``"ulog"``.
    format: str
    #: Lines before the first message.
    prelude: tuple[str, ...] = ()

    @property
    def boots(self) -> tuple[Boot, ...]:
        """At least one."""
        raise NotImplementedError

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What the scan and the decoding so far had to say."""
        raise NotImplementedError

    def counts(self, boot: Boot) -> Mapping[str, int]:
        """Return the messages of each type in this boot, by name as logged."""
        raise NotImplementedError

    def decode_many(
        self, names: Iterable[str], boot: Boot, fields: Collection[str] | None = None
    ) -> dict[str, pd.DataFrame]:
        """Return several message types, rows in file order; of `fields` only, where that spares memory.

        The index `t` is in seconds on the boot clock (raw messages may step slightly backwards); columns are named as
        logged and scaled to the units in ``frame.attrs["units"]`` (column name -> unit as logged, such as ``"deg"``).
        ``frame.attrs["multipliers"]`` says what each scaled column was multiplied by, ``frame.attrs["instance"]`` which
        column tells the instances of a sensor apart; both only where the format knows them.
        """
        raise NotImplementedError

    def decode(self, name: str, boot: Boot) -> pd.DataFrame:
        """Return all fields of one message type."""
        return self.decode_many((name,), boot)[name]

    def parameters(self, boot: Boot) -> Mapping[str, float] | None:
        """Return the autopilot's parameters where the format keeps them outside its messages."""
        return None


def clean_text(raw: bytes) -> str:
    """Text up to the first NUL; UTF-8, or Latin-1 where that fails."""
    raw = raw.partition(b"\0")[0]
    try:
        return raw.decode()
    except UnicodeDecodeError:
        return raw.decode("latin-1")


COPY_AGAIN = "Copy the log again; when it comes out the same, what wrote it failed: the card, the link or the disk."
#: Bytes of the longest message of any format, a signed frame of MAVLink 2 with its time.
_LONGEST = 288


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
            f"{counted(count, 'row')} of {name} had a time outside the boot or far from the neighbours'; it was "
            "interpolated.",
            message=name,
            rows=count,
        )


def misplaced_blocks() -> Finding:
    """Report a power-up whose blocks lie in the file in another order than they were written, or twice."""
    text = "Blocks of the file stand in another order than they were written, or twice; rows were put in order of time."
    return warning("file-damaged", text, COPY_AGAIN)


def in_order(frame: pd.DataFrame) -> pd.DataFrame:
    """Return rows in the order in which they were written, each once."""
    ordered = frame.sort_index(kind="stable")
    compared = [name for name in ordered if not isinstance(ordered[name].dtype, pd.ArrowDtype)]
    return ordered[~ordered[compared].reset_index().duplicated().to_numpy()]
