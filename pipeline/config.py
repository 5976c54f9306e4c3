"""What the user may choose about an analysis, with the defaults that suit most logs."""

from dataclasses import dataclass

from pipeline.errors import ConfigError


@dataclass(frozen=True, slots=True, kw_only=True)
class AnalysisConfig:
    """Settings of `pipeline.analyze` and `pipeline.analyze_fleet`."""

    #: Sampling rate of the experiment, Hz. Motor outputs are logged at 10 Hz, which is also the paper's rate (Elhesasy
    #: 2024).
    rate: float = 10.0
    #: Order of every transfer function; the paper found 5 and 3.
    poles: int = 5
    zeros: int = 3
    mass: float | None = None  #: Take-off mass, kg. Without it only ratios to the mass (k/m) can be determined.
    #: One log: the part of the airborne time, from its start, that the model is fitted to; the rest judges it.
    training_fraction: float = 0.7
    #: Several logs: names (shell patterns) of the logs to fit on; all others judge. Empty: chosen by what was flown
    #: (`pipeline.fleet.split`).
    training: tuple[str, ...] = ()
    #: Several logs: names (shell patterns) of the logs that judge; all others train, unless `training` names those.
    validation: tuple[str, ...] = ()
    #: Also try other numbers of poles and zeros and recommend one; takes as long as ten more fits.
    scan_orders: bool = False
    estimation_rate: float = 50.0  #: Rate at which the trajectory is reported, Hz.
    #: Seconds that the fits of one log may take; a fit that takes longer is given up with a finding.
    time_limit: float = 120.0

    def __post_init__(self) -> None:
        wrong = self._wrong()
        if wrong:
            raise ConfigError(wrong)

    def _wrong(self) -> str:
        """Report which setting cannot be and what it may be; empty when all can."""
        if not 0.5 <= self.rate <= 400.0:
            return f"rate is {self.rate:g} Hz; choose 0.5 to 400 Hz (motor outputs are logged at 10 Hz)"
        if not 1 <= self.poles <= 12:
            return f"poles is {self.poles}; choose 1 to 12 (the paper used 5)"
        if not 0 <= self.zeros < self.poles:
            return f"zeros is {self.zeros}; choose 0 to {self.poles - 1}, fewer than the {self.poles} poles"
        if self.mass is not None and not 0.01 <= self.mass <= 1000.0:
            return f"mass is {self.mass:g} kg; choose the take-off mass in kilograms, 0.01 to 1000"
        if not 0.1 <= self.training_fraction <= 0.95:
            return f"training_fraction (--training-fraction) is {self.training_fraction:g}; choose 0.1 to 0.95"
        if not self.time_limit > 0:
            return f"time_limit (--time-limit) is {self.time_limit:g} s; choose more than 0"
        return ""
