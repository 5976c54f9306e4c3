"""Messages of a log that never was a file."""


class Decoded(dict):
    """Messages that are there without decoding."""

    def once(self, name, fields=None):
        return self[name]
