"""The messages of a log by name, each decoded when it is asked for."""

from collections.abc import Collection, Iterable, Iterator, Mapping

import numpy as np
import pandas as pd

from logparse.source import LONG, Boot, MessageSource
from logparse.stray import without_stray

#: Messages after which a loop over their names is taken to want all, and the part of a file decoded ahead of it.
_ASKED, _SHARE = 2, 2

#: Part of all rows that messages held together may have: what is decoded of a row is about as large as the row.
_HELD = 5


class Messages(Mapping[str, pd.DataFrame]):
    """The messages of one boot by name as logged, decoded when first asked for.

    Iterating over values or items, and `load`, decode what is missing in one pass over the file. So do loops over the
    names that ask for one message after another: from the second on, those to come are decoded along with it.
    """

    def __init__(self, source: MessageSource, boot: Boot):
        self._source, self._boot = source, boot
        self.counts = source.counts(boot)  #: Rows of each message type, without decoding.
        self._frames: dict[str, pd.DataFrame] = {}
        self._asking: int | None = None  # Messages that a loop over the names has asked for and were not there.

    def load(self, names: Iterable[str]) -> None:
        """Decode several message types at once; names that the log does not have are passed over."""
        self._frames |= self.decode(names)

    def decode(self, names: Iterable[str]) -> dict[str, pd.DataFrame]:
        """Return several message types that are not there yet, decoded in one pass over the file and not kept."""
        missing = [name for name in names if name in self.counts and name not in self._frames]
        return self._source.decode_many(missing, self._boot) if missing else {}

    def __getitem__(self, name: str) -> pd.DataFrame:
        if name not in self._frames:
            if name not in self.counts:
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
        if asked + 1 < _ASKED:
            return
        names = list(self.counts)
        rows = self.counts[name]
        for other in names[names.index(name) + 1 :]:
            rows += 0 if other in self._frames else self.counts[other]
            if rows > sum(self.counts.values()) // _SHARE:
                return
            yield other

    def once(self, name: str, fields: Collection[str] | None = None) -> pd.DataFrame:
        """Decode a message without keeping it, of `fields` only where that spares memory; or the one that is kept."""
        if name in self._frames:
            return self._frames[name]
        return self._source.decode_many((name,), self._boot, fields)[name]

    def __contains__(self, name: object) -> bool:
        return name in self.counts

    def __iter__(self) -> Iterator[str]:
        self._asking = 0
        try:
            yield from self.counts
        finally:
            self._asking = None

    def __len__(self) -> int:
        return len(self.counts)

    def values(self):  # type: ignore[no-untyped-def]
        """Frames, all decoded."""
        self.load(self.counts)
        return super().values()

    def items(self):  # type: ignore[no-untyped-def]
        """Names and frames, all decoded."""
        self.load(self.counts)
        return super().items()

    def __repr__(self) -> str:
        return f"<Messages of {len(self)} types: {', '.join(self)}>"


class MessageView(Mapping[str, pd.DataFrame]):
    """The messages of a log, seen in another way."""

    def __init__(self, messages: Mapping[str, pd.DataFrame]):
        self._messages = messages

    def __getitem__(self, name: str) -> pd.DataFrame:
        return self._messages[name]

    def __contains__(self, name: object) -> bool:
        return name in self._messages

    def __iter__(self) -> Iterator[str]:
        return iter(self._messages)

    def __len__(self) -> int:
        return len(self._messages)


class PassingMessages(MessageView):
    """Messages for whoever builds tables of them: without damaged values, and long ones are not kept.

    Those of `together` are, until `release`, as far as there is room: to decode one by one passes over the file each
    time. What is `checked` by a checksum has no damage.
    """

    _messages: Messages

    def __init__(self, messages: Messages, together: Iterable[str], *, checked: bool):
        super().__init__(messages)
        self.counts = messages.counts
        self.damaged: dict[str, int] = {}  #: Values that were left out of each message so far.
        self._checked = checked
        room = sum(self.counts.values()) // _HELD
        chosen = []
        for name in sorted(set(together) & set(self.counts), key=lambda name: (self.counts[name], name)):
            room -= self.counts[name]
            if room >= 0 or self.counts[name] < LONG:
                chosen.append(name)
        decoded = messages.decode(chosen)
        messages._frames |= {name: frame for name, frame in decoded.items() if self.counts[name] < LONG}
        self._held = {name: self._intact(name, frame) for name, frame in decoded.items()}

    def release(self) -> None:
        """Release what was decoded together."""
        self._held = {}

    def __getitem__(self, name: str) -> pd.DataFrame:
        return self.once(name)

    def once(self, name: str, fields: Collection[str] | None = None) -> pd.DataFrame:
        """Return a message; of a long one only `fields`."""
        if name in self._held:
            return self._held[name]
        if self.counts.get(name, 0) >= LONG:
            return self._intact(name, self._messages.once(name, fields))
        self._held[name] = self._intact(name, self._messages[name])
        return self._held[name]

    def _intact(self, name: str, frame: pd.DataFrame) -> pd.DataFrame:
        if self._checked:
            return frame
        frame, removed = without_stray(name, frame)
        if removed:
            self.damaged[name] = removed
        return frame


class NumericMessages(MessageView):
    """Messages as numbers, with NaN for damaged ones and for text, which damage and strange writers make of fields."""

    def __init__(self, messages: Mapping[str, pd.DataFrame], *, checked: bool):
        super().__init__(messages)
        self._checked = checked

    def __getitem__(self, name: str) -> pd.DataFrame:
        frame = self._messages[name] if self._checked else without_stray(name, self._messages[name])[0]
        texts = [column for column in frame.columns if not pd.api.types.is_numeric_dtype(frame[column].dtype)]
        numbers = {
            text: pd.to_numeric(frame[text], errors="coerce").to_numpy(np.float64, na_value=np.nan) for text in texts
        }
        return frame.assign(**numbers) if texts else frame
