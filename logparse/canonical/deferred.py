"""Tables that are long where the fast loop is logged: built when they are asked for, and let go of when they are not.

An hour at 400 Hz is 1.4 million rows: kept beside each other, messages and tables are several times the log.
"""

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from core.findings import Finding
from logparse.canonical.remarks import Remarks
from logparse.source import LONG
from logparse.tables import COLUMNS, Tables

#: A table and those of the other instances of its sensor.
Built = tuple[pd.DataFrame | None, tuple[pd.DataFrame, ...]]
#: Gives wanted columns of a table one by one.
Columns = Callable[[Collection[str]], Iterator["pd.Series[float]"]]


class SomeFields(Mapping[str, pd.DataFrame]):
    """Messages with only some of their fields, where they are so long that the others would take memory for nothing."""

    def __init__(self, messages: Mapping[str, pd.DataFrame], fields: Collection[str]):
        self._messages, self._fields = messages, fields
        self._choose: Callable[[str, Collection[str]], pd.DataFrame] | None = getattr(messages, "choose", None)

    def __getitem__(self, name: str) -> pd.DataFrame:
        return self._messages[name] if self._choose is None else self._choose(name, self._fields)

    def __contains__(self, name: object) -> bool:
        return name in self._messages

    def __iter__(self) -> Iterator[str]:
        return iter(self._messages)

    def __len__(self) -> int:
        return len(self._messages)


class KeptFields:
    """Fields of one long message as they are logged, kept from one that asks for them to the next until released.

    As logged they take half of what they take in a table, and to decode them again is a pass over the file.
    """

    def __init__(self, messages: Mapping[str, pd.DataFrame]):
        self._messages = messages
        self._kept: pd.DataFrame | None = None
        self._asked: set[str] = set()

    def some(self, name: str, fields: Collection[str]) -> pd.DataFrame:
        """Return a message with those of the fields that it has, and perhaps more."""
        missing = set(fields) - self._asked
        if self._kept is None or missing:
            frame = SomeFields(self._messages, missing)[name]
            self._kept = frame if self._kept is None else _beside(self._kept, frame)
            self._asked |= missing
        return self._kept

    def release(self) -> None:
        """Release what is kept."""
        self._kept = None
        self._asked.clear()


def _beside(kept: pd.DataFrame, more: pd.DataFrame) -> pd.DataFrame:
    """Return a message with the fields of both frames, which are of its same rows, without copying them."""
    columns = {str(name): frame[name].to_numpy() for frame in (kept, more) for name in frame}
    both = pd.DataFrame(columns, index=kept.index, copy=False)
    both.attrs = dict(kept.attrs)
    for key, value in more.attrs.items():
        both.attrs[key] = {**kept.attrs.get(key, {}), **value} if isinstance(value, dict) else value
    return both


@dataclass(slots=True)
class Later:
    """What is still to be built, and what building had to say."""

    builders: dict[str, Callable[[], Built]] = field(default_factory=dict)  #: By table.
    #: By table, of those whose columns can be had one by one; what removes no value, and so has nothing to say.
    columns: dict[str, Columns] = field(default_factory=dict)
    kept: list[KeptFields] = field(default_factory=list)  #: What columns are made of.
    remarks: dict[str, Remarks] = field(default_factory=dict)  #: Of the tables that were built so far.

    def take(
        self,
        name: str,
        messages: Mapping[str, pd.DataFrame],
        sources: tuple[str, ...],
        build: Callable[[Remarks], Built],
        remarks: Remarks,
        columns: Columns | None = None,
    ) -> Built:
        """Build a table now when it is short; else remember how, and how to give its columns one by one.

        Returns
        -------
        (DataFrame or None, tuple of DataFrame)
            The table and further ones; None and none where it is built later.
        """
        counts: Mapping[str, int] = getattr(messages, "counts", {})
        if sum(counts.get(source, 0) for source in sources) < LONG:
            return build(remarks)

        def build_and_remark() -> Built:
            own = Remarks()
            table, further = build(own)
            self.remarks[name] = own
            return (table if table is not None and len(table) else None), further

        self.builders[name] = build_and_remark
        if columns is not None:
            self.columns[name] = columns
        return None, ()

    def silent(self) -> list[str]:
        """Return the tables that must be built before all findings are known."""
        return [name for name in self.builders if name not in self.remarks and name not in self.columns]

    def findings(self, remarks: Remarks) -> tuple[Finding, ...]:
        """Return the findings of the tables built so far, and others."""
        together = Remarks()
        for each in (remarks, *self.remarks.values()):
            together.take(each)
        return together.findings()


class DeferredTables(Tables):
    """Canonical tables of which the long ones are built when they are first asked for.

    The one asked for last is kept until another is asked for or it is released: two beside each other are as large as
    the log.
    """

    __slots__ = ("_later", "_long", "_times")
    _later: Later
    _long: dict[str, Built]
    _times: dict[str, npt.NDArray[np.float64]]

    @classmethod
    def of(cls, tables: Tables, later: Later) -> "DeferredTables":
        """Return the same tables, with those that `later` knows."""
        made = cls(**{each.name: getattr(tables, each.name) for each in fields(tables)})
        object.__setattr__(made, "_later", later)
        return made

    def __init__(self, **tables: Any):
        object.__setattr__(self, "_later", Later())
        object.__setattr__(self, "_long", {})
        object.__setattr__(self, "_times", {})
        super().__init__(**tables)

    def has(self, name: str) -> bool:
        """Whether the log has a table; a long one need not be built for that."""
        return name in self._later.builders or super().has(name)

    def columns(self, name: str, wanted: Collection[str] | None = None) -> Iterator["pd.Series[float]"]:
        """Yield columns of a table one by one; of a long one no more than one is in memory at a time."""
        if name in self._later.columns and name not in self._long:
            yield from self._later.columns[name](list(COLUMNS[name]) if wanted is None else wanted)
        else:
            yield from super().columns(name, wanted)

    def times(self, name: str) -> npt.NDArray[np.float64] | None:
        """Return the times of a table's rows; those of long tables are kept when the tables are not."""
        if name not in self._later.builders:
            return super().times(name)
        if name not in self._times:
            first = next(self.columns(name, list(COLUMNS[name])[:1]), None)
            if first is None:
                return None
            self._times[name] = first.index.to_numpy(np.float64)
        return self._times[name]

    def release(self, keep: str = "") -> None:
        """Release the long table that is kept, unless it is `keep`, and of others times and what columns are made of.

        They are built anew when they are asked for again.
        """
        for kept in self._later.kept:
            kept.release()
        for name in {*self._long, *self._times} - {keep}:
            self._long.pop(name, None)
            self._times.pop(name, None)

    def __reduce__(self) -> tuple[Any, ...]:
        return _whole, ({each.name: getattr(self, each.name) for each in fields(self)},)

    def _built(self, name: str) -> Built:
        if name not in self._later.builders:
            return None, ()
        if name not in self._long:
            self._long.clear()
            self._long[name] = self._later.builders[name]()
        found: Built = self._long[name]
        return found


def _whole(tables: dict[str, Any]) -> Tables:
    return Tables(**tables)


def _long_table(name: str) -> property:
    """Make the attribute of a table that may be built later."""
    slot: Any = getattr(Tables, name)

    def get(tables: DeferredTables) -> pd.DataFrame | None:
        given: pd.DataFrame | None = slot.__get__(tables)
        return tables._built(name)[0] if given is None else given

    return property(get, slot.__set__)


def _further() -> property:
    slot: Any = getattr(Tables, "further")  # noqa: B009 -- the slot, not a value

    def get(tables: DeferredTables) -> Mapping[str, tuple[pd.DataFrame, ...]]:
        given: Mapping[str, tuple[pd.DataFrame, ...]] = slot.__get__(tables)
        others = tables._built("imu")[1]
        return {**given, "imu": others} if others else given

    return property(get, slot.__set__)


for _name in ("imu", "rates"):
    setattr(DeferredTables, _name, _long_table(_name))
DeferredTables.further = _further()  # type: ignore[assignment,misc]
