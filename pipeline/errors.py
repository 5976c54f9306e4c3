"""What can be wrong with what the user asked for, beside what can be wrong with a log."""

from logparse import RotoridError


class ConfigError(RotoridError):
    """An analysis was asked for with a setting that cannot be; the message names the setting and what it may be."""
