"""What can be wrong with the user's input, as exceptions whose text a user can act on."""


class RotoridError(Exception):
    """Something is wrong with the input and the message says what it is and what to do.

    Every error that rotorid raises on purpose derives from this class; whatever else is raised is a bug.
    """


class LogError(RotoridError):
    """A file cannot be read as a flight log: empty, of an unknown format, or without a single intact message."""


class MissingDataError(RotoridError):
    """A log is readable but lacks what the next step needs, such as motor outputs or GPS.

    The message names the missing messages and the autopilot setting that makes the autopilot log them.
    """
