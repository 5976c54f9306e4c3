"""What a log says never commands the terminal that shows it."""

import io

from rotorid.cli.output import Guarded


class _Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_control_characters_are_shown_and_not_sent():
    """`rotorid inspect` printed the escapes of a log's name; texts and names of parameters may hold them too."""
    said = "log \x1b]0;title\x07\x1b[2J\x1b[31m \x9b2J é\ttab\r\n"
    piped, terminal = io.StringIO(), _Terminal()
    assert Guarded(piped).write(said) == Guarded(terminal).write(said) == len(said)
    assert piped.getvalue() == "log \\x1b]0;title\\x07\\x1b[2J\\x1b[31m \\x9b2J é\ttab\r\n"
    assert terminal.getvalue() == "log \\x1b]0;title\\x07\\x1b[2J\x1b[31m \\x9b2J é\ttab\r\n"
    assert Guarded(terminal).isatty()
