"""The messages of a log by name, each decoded when it is asked for."""

from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Protocol, runtime_checkable

import pandas as pd

from logparse.source import LONG, Boot, MessageSource

#: Messages after which a loop over their names is taken to want all, and the part of a file decoded ahead of it.
_ASKED, _SHARE = 2, 2

#: Part of all rows that messages held together may have: what is decoded of a row is about as large as the row.
_HELD = 5


@runtime_checkable
class _BatchSource(Protocol):
    """A source that decodes several message types in one pass over the file."""

    def decode_many(self, names: Iterable[str], boot: Boot) -> dict[str, pd.DataFrame]: ...


@runtime_checkable
class _FieldSource(Protocol):
    """A source that decodes some of the fields of a message type."""

    def decode_fields(self, name: str, boot: Boot, fields: Collection[str]) -> pd.DataFrame: ...


class Messages(Mapping[str, pd.DataFrame]):
    """The messages of one boot by name as logged, decoded when first asked for.

    Iterating over values or items, and `load`, decode what is missing in one pass over the file. So do loops over the
    names that ask for one message after another: from the second on, those to come are decoded along with it.
    """

    def __init__(self, source: MessageSource, boot: Boot):
        self._source, self._boot = source, boot
        self._counts = source.counts(boot)
        self._frames: dict[str, pd.DataFrame] = {}
        self._asking: int | None = None  # Messages that a loop over the names has asked for and were not there.

    @property
    def counts(self) -> Mapping[str, int]:
        """Rows of each message type, without decoding."""
        return self._counts

    def load(self, names: Iterable[str]) -> None:
        """Decode several message types at once; names that the log does not have are passed over."""
        missing = [name for name in names if name in self._counts and name not in self._frames]
        if isinstance(self._source, _BatchSource) and missing:
            self._frames.update(self._source.decode_many(missing, self._boot))
        else:
            for name in missing:
                self._frames[name] = self._source.decode(name, self._boot)

    def together(self, names: Iterable[str]) -> dict[str, pd.DataFrame]:
        """Decode several message types in one pass over the file; long ones are not kept.

        Parameters
        ----------
        names : iterable of str
            Message types; those that the log lacks are passed over.
        """
        missing = [name for name in names if name in self._counts and name not in self._frames]
        if not isinstance(self._source, _BatchSource) or not missing:
            return {}
        frames = self._source.decode_many(missing, self._boot)
        self._frames |= {name: frame for name, frame in frames.items() if self._counts[name] < LONG}
        return frames

    def __getitem__(self, name: str) -> pd.DataFrame:
        if name not in self._frames:
            if name not in self._counts:
                raise KeyError(name)
            self.load([name, *self._next(name)])
        return self._frames[name]

    def replace(self, name: str, rows: pd.DataFrame) -> None:
        """Use other rows of a message than the log's, such as those that somebody has corrected by hand.

        Tables, findings and models that are made from now on follow them; `counts` stays that of the file.

        Parameters
        ----------
        name : str
            A message that the log has.
        rows : pandas.DataFrame
            Indexed by time [s] like those that they replace, whose units (`attrs`) they keep.
        """
        units = self[name].attrs
        self._frames[name] = rows.copy(deep=False)
        self._frames[name].attrs = units

    @property
    def decoded(self) -> Collection[str]:
        """Names of the messages that are decoded and kept."""
        return self._frames.keys()

    def _next(self, name: str) -> Iterator[str]:
        """Yield what a loop over the names will ask for after `name`, up to a share of the file."""
        asked = self._asking
        if asked is None:
            return
        self._asking = asked + 1
        if asked + 1 < _ASKED or not isinstance(self._source, _BatchSource):
            return
        names = list(self._counts)
        rows = self._counts[name]
        for other in names[names.index(name) + 1 :]:
            rows += 0 if other in self._frames else self._counts[other]
            if rows > sum(self._counts.values()) // _SHARE:
                return
            yield other

    def once(self, name: str, fields: Collection[str] | None = None) -> pd.DataFrame:
        """Decode a message without keeping it, of `fields` only where that spares memory; or the one that is kept."""
        if name in self._frames:
            return self._frames[name]
        if fields is not None and isinstance(self._source, _FieldSource):
            return self._source.decode_fields(name, self._boot, fields)
        return self._source.decode(name, self._boot)

    def __contains__(self, name: object) -> bool:
        return name in self._counts

    def __iter__(self) -> Iterator[str]:
        self._asking = 0
        try:
            yield from self._counts
        finally:
            self._asking = None

    def __len__(self) -> int:
        return len(self._counts)

    def values(self):  # type: ignore[no-untyped-def]
        """Frames, all decoded."""
        self.load(self._counts)
        return super().values()

    def items(self):  # type: ignore[no-untyped-def]
        """Names and frames, all decoded."""
        self.load(self._counts)
        return super().items()

    def __repr__(self) -> str:
        return f"<Messages of {len(self)} types: {', '.join(self)}>"


class Passing(Mapping[str, pd.DataFrame]):
    """Messages for whoever builds tables of them: long ones that nobody asked for by name are not kept."""

    def __init__(self, messages: Messages):
        self._messages = messages
        self._held: dict[str, pd.DataFrame] = {}

    @property
    def counts(self) -> Mapping[str, int]:
        """Rows of each message type, without decoding."""
        return self._messages.counts

    @contextmanager
    def held(self, names: Iterable[str]) -> Iterator[None]:
        """Hold messages while several tables are built of them: decoding one by one passes over the file each time."""
        counts, room = self.counts, sum(self.counts.values()) // _HELD
        chosen = []
        for name in sorted(set(names) & set(counts), key=lambda name: (counts[name], name)):
            room -= counts[name]
            if room >= 0 or counts[name] < LONG:
                chosen.append(name)
        self._held = self._messages.together(chosen)
        try:
            yield
        finally:
            self._held = {}

    def __getitem__(self, name: str) -> pd.DataFrame:
        return self.choose(name, None)

    def choose(self, name: str, fields: Collection[str] | None) -> pd.DataFrame:
        """Decode a message; of a long one only `fields`."""
        if name in self._held:
            return self._held[name]
        if self._messages.counts.get(name, 0) < LONG:
            return self._messages[name]
        return self._messages.once(name, fields)

    def __contains__(self, name: object) -> bool:
        return name in self._messages

    def __iter__(self) -> Iterator[str]:
        return iter(self._messages)

    def __len__(self) -> int:
        return len(self._messages)
