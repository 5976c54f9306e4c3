"""Messages that a test makes up, their canonical tables, and a log that never was a file."""

import numpy as np
import pandas as pd

from logparse.canonical import gather_tables
from logparse.craft.vehicle import describe


class Decoded(dict):
    """Messages that are there without decoding."""

    @property
    def counts(self):
        return {name: len(frame) for name, frame in self.items()}

    def once(self, name, fields=None):
        return self[name]


def message(t, units=None, /, **columns):
    """Return a message of some times; columns of one number have it in every row."""
    frame = pd.DataFrame(columns, index=pd.Index(np.asarray(t, dtype=float), name="t"))
    frame.attrs["units"] = units or {}
    return frame


def tables_of(messages, kind, parameters):
    """Return the canonical tables of messages, and what was left out or assumed for them."""
    vehicle = describe(messages, format=kind, parameters=parameters)
    tables, findings = gather_tables(messages, format=kind, parameters=parameters, vehicle=vehicle)
    return tables, findings()
