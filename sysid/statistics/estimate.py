"""A number that a fit gives, or why it gives none."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number with its standard error; None when not determined, with the reason."""

    value: float | None
    sigma: float | None
    unit: str
    reason: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Give numbers for JSON."""
        return {name: getattr(self, name) for name in self.__slots__}
