"""Messages that are a test's own, their canonical tables, and a log that never was a file."""

from logparse.canonical import gather_tables
from logparse.craft.vehicle import describe
from logparse.messages import MessageView


class Decoded(dict):
    """Messages that are there without decoding."""

    @property
    def counts(self):
        return {name: len(frame) for name, frame in self.items()}

    def once(self, name, fields=None):
        return self[name]


def tables_of(messages, kind, parameters):
    """Return the canonical tables of messages, and what was left out or assumed for them."""
    vehicle = describe(messages, format=kind, parameters=parameters)
    tables, findings = gather_tables(MessageView(messages), format=kind, parameters=parameters, vehicle=vehicle)
    return tables, findings()
