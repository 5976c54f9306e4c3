"""Messages of which only numbers are wanted."""

from collections.abc import Iterator, Mapping

import numpy as np
import pandas as pd


class NumericMessages(Mapping[str, pd.DataFrame]):
    """Messages as logged, with NaN for what is no number: damage and strange writers make text of fields.

    Parameters
    ----------
    messages : mapping of str to DataFrame
    """

    def __init__(self, messages: Mapping[str, pd.DataFrame]) -> None:
        self._messages = messages

    def __getitem__(self, name: str) -> pd.DataFrame:
        """Return the rows of a message."""
        frame = self._messages[name]
        texts = [column for column in frame.columns if not pd.api.types.is_numeric_dtype(frame[column].dtype)]
        if not texts:
            return frame
        return frame.assign(
            **{
                text: pd.to_numeric(frame[text], errors="coerce").to_numpy(np.float64, na_value=np.nan)
                for text in texts
            }
        )

    def __contains__(self, name: object) -> bool:
        """Return whether a message was logged, without decoding it."""
        return name in self._messages

    def __iter__(self) -> Iterator[str]:
        """Iterate over names."""
        return iter(self._messages)

    def __len__(self) -> int:
        """Return how many kinds of message there are."""
        return len(self._messages)
