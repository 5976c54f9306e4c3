"""Values as a person types them and as the autopilot then holds them: four digits, single precision."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from sysid.loops.controller import LoopError

#: Significant digits of a proposed value.
DIGITS = 4


def typed(value: float) -> float:
    """Round a value to what will be typed."""
    return float(f"{value:.{DIGITS}g}")


def parameter_line(name: str, value: float, reason: str = "") -> str:
    """Return ``NAME,VALUE  # reason``: some tools drop a comment on a line of its own."""
    text = f"{value:.9g}"
    if np.float32(float(text)) != np.float32(value):
        raise LoopError(f"{name} = {value!r} cannot be written exactly")
    return f"{name},{text}  # {' '.join(reason.split())}" if reason else f"{name},{text}"


def parameter_file(
    values: Mapping[str, float], comments: tuple[str, ...], reasons: Mapping[str, str] = MappingProxyType({})
) -> str:
    """Write parameters as ground stations read them, one a line, below the comments; `reasons` are by name."""
    lines = [f"# {line}" for comment in comments for line in comment.splitlines()]
    lines += [parameter_line(name, value, reasons.get(name, "")) for name, value in sorted(values.items())]
    return "\n".join(lines) + "\n"


def read_parameter_file(text: str) -> dict[str, float]:
    """Read parameters as ground stations do: name and value parted by comma, blank or tab."""
    values: dict[str, float] = {}
    for number, line in enumerate(text.splitlines(), 1):
        bare = line.split("#", 1)[0].strip()
        if not bare:
            continue
        parts = bare.replace(",", " ").split()
        try:
            name, value = parts
            values[name] = float(value)
        except ValueError as error:
            raise LoopError(f"line {number} of the parameters is no name and number: {line!r}") from error
    return values
