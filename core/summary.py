"""Short representation of results: a few lines in a terminal, a small table in a notebook."""

from collections.abc import Iterable, Mapping

from core.table import Row, Table

#: Longest text of one entry, characters.
_LONGEST = 100


class Summarised:
    """Base of results; a subclass implements `summary`."""

    __slots__ = ()

    def summary(self) -> Mapping[str, str]:
        """Return the key facts of this result, label to text."""
        raise NotImplementedError

    def __repr__(self) -> str:
        entries = {label: _shorten(text) for label, text in self.summary().items()}
        width = max(map(len, entries), default=0)
        lines = (f"  {label:{width}}  {text}" for label, text in entries.items())
        return "\n".join((type(self).__name__, *lines))

    def _repr_html_(self) -> str:
        rows = [Row(label, [text]) for label, text in self.summary().items()]
        return Table("", [""], rows, caption=type(self).__name__, texts=[0]).html()


def listed(names: Iterable[object], most: int = 6) -> str:
    """Return names separated by commas, the first `most` of them and how many more there are."""
    some = [str(name) for name in names]
    more = len(some) - most
    return ", ".join(some[:most]) + (f" and {more} more" if more > 0 else "")


def _shorten(text: str) -> str:
    return text if len(text) <= _LONGEST else text[: _LONGEST - 1] + "…"
