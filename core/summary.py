"""How results show themselves: a few lines in a terminal, a small table in a notebook."""

from collections.abc import Mapping

from core.table import Row, Table

#: Longest text of one entry; the rest is in the result's own fields.
_LONGEST = 100


class Summarised:
    """Base of results: `summary` is all that a subclass has to offer."""

    __slots__ = ()

    def summary(self) -> Mapping[str, str]:
        """Return the few facts by which a reader knows this result, label to text."""
        raise NotImplementedError

    def __repr__(self) -> str:
        entries = {label: _shortened(text) for label, text in self.summary().items()}
        width = max(map(len, entries), default=0)
        lines = (f"  {label:{width}}  {text}" for label, text in entries.items())
        return "\n".join((type(self).__name__, *lines))

    def _repr_html_(self) -> str:
        rows = [Row(label, [text]) for label, text in self.summary().items()]
        return Table("", [""], rows, caption=type(self).__name__, texts=[0]).html()


def listed(names: Mapping[str, object] | tuple[str, ...] | list[str], most: int = 6) -> str:
    """Return names separated by commas, the first `most` of them and how many more there are."""
    some = [str(name) for name in names]
    more = len(some) - most
    return ", ".join(some[:most]) + (f" and {more} more" if more > 0 else "")


def _shortened(text: str) -> str:
    return text if len(text) <= _LONGEST else text[: _LONGEST - 1] + "…"
