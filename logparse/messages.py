"""The messages of a log by name, each decoded when it is asked for."""

from collections.abc import Collection, Iterable, Iterator, Mapping

import numpy as np
import pandas as pd

from logparse.kept import Kept
from logparse.source import Boot, MessageSource
from logparse.stray import Strays, find_strays, without


class Messages(Mapping[str, pd.DataFrame]):
    """The messages of one boot by name as logged, decoded when they are asked for.

    Iterating over values or items, and `load`, decode what is missing in one pass over the file.

    Parameters
    ----------
    source : MessageSource
    boot : Boot
    kept : Kept, optional
        Where decoded messages are kept as long as there is room.
    """

    def __init__(self, source: MessageSource, boot: Boot, kept: Kept | None = None):
        self._source, self._boot = source, boot
        self.counts = source.counts(boot)  #: Rows of each message type, without decoding.
        self._kept = kept or Kept()
        self._given: dict[str, pd.DataFrame] = {}  # Loaded together, or given by hand: these are not let go.

    def load(self, names: Iterable[str]) -> None:
        """Decode several message types at once, and keep them; names that the log does not have are passed over."""
        missing = [name for name in names if name in self.counts and name not in self._given]
        self._given |= self._source.decode_many(missing, self._boot) if missing else {}

    def __getitem__(self, name: str) -> pd.DataFrame:
        if name in self._given:
            return self._given[name]
        if name not in self.counts:
            raise KeyError(name)
        return self._kept.get(("message", name), lambda: self._source.decode(name, self._boot))

    def once(self, name: str, fields: Collection[str] | None = None) -> pd.DataFrame:
        """Decode a message without keeping it, of `fields` only where that spares memory; or the one that is kept."""
        if name in self._given or ("message", name) in self._kept:
            return self[name]
        return self._source.decode_many((name,), self._boot, fields)[name]

    def replace(self, name: str, rows: pd.DataFrame) -> None:
        """Use other rows of a message than the log's, such as those that somebody has corrected by hand.

        Tables, findings and models follow them from now on; `counts` stays that of the file.

        Parameters
        ----------
        name : str
            A message that the log has.
        rows : pandas.DataFrame
            Indexed by time [s] like those that they replace, whose units (`attrs`) they keep.
        """
        units = self[name].attrs
        self._given[name] = rows.copy(deep=False)
        self._given[name].attrs = units
        self._kept.clear()

    def __contains__(self, name: object) -> bool:
        return name in self.counts

    def __iter__(self) -> Iterator[str]:
        return iter(self.counts)

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

    def part(self, name: str, fields: Collection[str], *, of_all: bool = False) -> pd.DataFrame:
        """Return a message, with more than some fields."""
        return self[name]

    def __contains__(self, name: object) -> bool:
        return name in self._messages

    def __iter__(self) -> Iterator[str]:
        return iter(self._messages)

    def __len__(self) -> int:
        return len(self._messages)


class IntactMessages(MessageView):
    """Messages for whoever builds tables of them, without damaged values; what is `checked` by a checksum has none."""

    _messages: Messages

    def __init__(self, messages: Messages, kept: Kept, *, checked: bool):
        super().__init__(messages)
        self._strays: dict[tuple[str, frozenset[str] | None], Strays] = {}  # Of each look; all fields are None.
        self._kept, self._checked = kept, checked

    def __getitem__(self, name: str) -> pd.DataFrame:
        if name not in self._messages:
            raise KeyError(name)
        return self._kept.get(("intact", name), lambda: self._intact(name, self._messages.once(name), None))

    def part(self, name: str, fields: Collection[str], *, of_all: bool = False) -> pd.DataFrame:
        """Return a message with no more than some fields where that spares memory.

        Whether a value is damaged is told by these fields alone, or by those of the whole message: other parts of a
        message that is read in several then say the same of it.
        """
        if ("intact", name) in self._kept:
            return self[name]
        wanted = frozenset(fields)
        if of_all and not self._checked and (name, None) not in self._strays:
            self._intact(name, self._messages.once(name), None)
        # Not kept: what is made of it is, and another part has the times once more.
        return self._intact(name, self._messages.once(name, wanted), None if of_all else wanted)

    @property
    def damaged(self) -> dict[str, int]:
        """Values left out of each message so far; of one that was looked at in parts, those of the worst part."""
        worst: dict[str, int] = {}
        for (name, _), strays in self._strays.items():
            worst[name] = max(sum(map(len, strays.values())), worst.get(name, 0))
        return worst

    def _intact(self, name: str, frame: pd.DataFrame, look: frozenset[str] | None) -> pd.DataFrame:
        if self._checked or self._strays.get((name, None)) == {}:
            return frame
        if (name, look) not in self._strays:
            self._strays[name, look] = find_strays(name, frame)
        return without(frame, self._strays[name, look])


class NumericMessages(MessageView):
    """Messages as numbers, with NaN for text, which damage and strange writers make of fields."""

    def __getitem__(self, name: str) -> pd.DataFrame:
        frame = self._messages[name]
        texts = [column for column in frame.columns if not pd.api.types.is_numeric_dtype(frame[column].dtype)]
        numbers = {
            text: pd.to_numeric(frame[text], errors="coerce").to_numpy(np.float64, na_value=np.nan) for text in texts
        }
        return frame.assign(**numbers) if texts else frame
