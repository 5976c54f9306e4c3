"""Options that several commands share."""

from typing import Annotated

import typer

#: Which power-up of a log with several; shared by the commands that look into one log.
Boot = Annotated[
    int | None,
    typer.Option(
        min=1, help="Which power-up of a file with several, from 1. Default: the one with the longest flight."
    ),
]


def power_up(boot: int | None) -> int | None:
    """Index of a power-up that the user counts from 1."""
    return None if boot is None else boot - 1
