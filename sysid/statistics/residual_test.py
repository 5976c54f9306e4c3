"""What residual tests found (`sysid.statistics.residuals`), which pages read without numpy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class ResidualTest:
    """Residual tests of one output over one or several records."""

    output: str
    samples: int
    lags: int
    autocorrelation: tuple[float, ...]  #: At lags 1, 2, ...
    band: float  #: Each autocorrelation of white residuals is within plus or minus this with probability `LEVEL`.
    #: Portmanteau statistic (Ljung and Box 1978) and what white residuals exceed with probability ``1 - LEVEL`` only.
    whiteness: float
    whiteness_limit: float
    #: For each input the chi-square statistic of the residual with the input 1, 2, ... samples before it.
    independence: Mapping[str, float]
    #: What the largest of them exceeds with probability ``1 - LEVEL`` if the residual is independent of every input.
    independence_limit: float

    @property
    def white(self) -> bool:
        """Whether the residuals pass as white."""
        return self.whiteness <= self.whiteness_limit

    @property
    def dependent(self) -> tuple[str, ...]:
        """Inputs that the residual still depends on, strongest first."""
        names = [name for name, value in self.independence.items() if value > self.independence_limit]
        return tuple(sorted(names, key=lambda name: -self.independence[name]))

    @property
    def sentence(self) -> str:
        """Report what the tests found."""
        largest = max(map(abs, self.autocorrelation))
        white = (
            "errors one sample ahead are white"
            if self.white
            else f"errors one sample ahead are not white (autocorrelation up to {largest:.2f}, 99 % band "
            f"±{self.band:.2f}): earlier errors would improve the prediction"
        )
        if not self.dependent:
            return f"{white}; they are independent of the inputs before them"
        missed = ", ".join(self.dependent)
        return f"{white}; inputs before them would improve it ({missed}): the model misses what these say"
