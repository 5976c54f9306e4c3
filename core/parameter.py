"""A number that a fit found, with its standard deviation, or why there is none."""

from __future__ import annotations

from dataclasses import dataclass

from core.quantity import NOT_DETERMINED, uncertain


@dataclass(frozen=True, slots=True)
class Parameter:
    """An estimated number."""

    #: Estimate and standard deviation; `value` is None when the data do not determine it.
    value: float | None
    sigma: float | None
    unit: str
    reason: str = ""  #: Why not determined, or what limits it; empty where there is nothing to add.

    @property
    def determined(self) -> bool:
        """Whether there is a value."""
        return self.value is not None

    def __str__(self) -> str:
        if self.value is None:
            return f"{NOT_DETERMINED} ({self.reason})" if self.reason else NOT_DETERMINED
        return uncertain(self.value, self.sigma, self.unit)
