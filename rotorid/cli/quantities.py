"""Measured quantities on the command line: positive or zero, and numbers at all."""

import math

import typer

Quantity = float | list[float] | None


def not_negative(value: Quantity) -> Quantity:
    """Check an option or argument, or each of several; for ``callback=``.

    Raises
    ------
    typer.BadParameter
        When it is nan, infinite or below zero.
    """
    for each in value if isinstance(value, list) else [] if value is None else [value]:
        if not math.isfinite(each):
            raise typer.BadParameter(f"{each} is not a number that can be measured")
        if each < 0.0:
            raise typer.BadParameter(f"{each:g} is below 0")
    return value
