"""Interface between the file formats and `FlightLog`: what every format reader offers."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import pandas as pd

from core.findings import Finding

#: Messages with more rows than this are large in memory: they are not kept unless somebody asked for them by name.
LONG = 100_000


@dataclass(frozen=True, slots=True)
class Boot:
    """One power-up of the autopilot inside a file: a span of the file with one monotonic boot clock.

    `start` and `stop` are byte offsets (line numbers in text logs) into the file, `t_start` and `t_end` seconds
    on this boot's clock.
    """

    start: int
    stop: int
    t_start: float
    t_end: float


class MessageSource(Protocol):
    """An opened log file of one format, scanned but not yet decoded."""

    @property
    def format(self) -> str:
        """``"dataflash"``, ``"dataflash-text"``, ``"tlog"``, ``"mavlink-raw"`` or ``"ulog"``."""

    @property
    def boots(self) -> tuple[Boot, ...]:
        """At least one."""

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What the scan and the decoding so far had to say."""

    def counts(self, boot: Boot) -> Mapping[str, int]:
        """Messages of each type in this boot, by name as logged."""

    def decode(self, name: str, boot: Boot) -> pd.DataFrame:
        """All fields of one message type, rows in file order.

        The index `t` is in seconds on the boot clock (raw messages may step slightly backwards); columns are named as
        logged and scaled to the units in ``frame.attrs["units"]`` (column name -> unit as logged, such as ``"deg"``).
        ``frame.attrs["multipliers"]`` says what each scaled column was multiplied by, ``frame.attrs["instance"]`` which
        column tells the instances of a sensor apart; both only where the format knows them.
        """

    def units(self, name: str) -> Mapping[str, str]:
        """Return the unit of each field as the file or the protocol declares it; absent where it does not."""
