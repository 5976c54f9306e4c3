"""Interface between the file formats and `FlightLog`: what every format reader offers."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

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
