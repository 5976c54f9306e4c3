"""What the user may choose about an analysis, with the defaults that suit most logs.

Python, the command line, a folder's store and the service have names, defaults, limits and words from here alone.
"""

import math
from dataclasses import dataclass, fields
from typing import Annotated, get_type_hints

from logparse import RotoridError

#: Shortest flight that models are fitted to, s: less says nothing of a craft that takes seconds to move.
SHORTEST = 20.0


class ConfigError(RotoridError):
    """An analysis was asked for with a setting that cannot be; the message names the setting and what it may be."""


@dataclass(frozen=True, slots=True)
class Setting:
    """What a setting means, and what it may be."""

    help: str
    least: float = -math.inf
    most: float = math.inf
    unit: str = ""
    remark: str = ""  #: Said besides where a value is refused.


@dataclass(frozen=True, slots=True, kw_only=True)
class AnalysisConfig:
    """Settings of `pipeline.analyze` and `pipeline.analyze_fleet`."""

    #: Sampling rate of the experiment, Hz. Motor outputs are logged at 10 Hz, which is also the paper's rate (Elhesasy
    #: 2024).
    rate: Annotated[
        float,
        Setting(
            "Samples per second of the fit. Autopilots log motor outputs at 10 Hz; more adds nothing.",
            least=0.5,
            most=400.0,
            unit="Hz",
            remark="motor outputs are logged at 10 Hz",
        ),
    ] = 10.0
    #: Order of every transfer function; the paper found 5 and 3.
    poles: Annotated[
        int,
        Setting(
            "Poles of each transfer function. More follow a flight closer and others worse.",
            least=1,
            most=12,
            remark="the paper used 5",
        ),
    ] = 5
    zeros: Annotated[int, Setting("Zeros of each transfer function, fewer than poles.", least=0, most=11)] = 3
    #: Take-off mass, kg. Without it only ratios to the mass (k/m) can be determined.
    mass: Annotated[
        float | None,
        Setting(
            "Take-off mass in kg. A flight shows only k/m; with the mass, thrust comes in newtons.",
            least=0.01,
            most=1000.0,
            unit="kg",
        ),
    ] = None
    #: One log: the part of the airborne time, from its start, that the model is fitted to; the rest judges it.
    training_fraction: Annotated[
        float, Setting("Of a single flight, the part to fit on; the rest judges.", least=0.1, most=0.95)
    ] = 0.7
    #: Several logs: names (shell patterns) of the logs to fit on; all others judge. Empty: chosen by what was flown
    #: (`pipeline.fleet.split`).
    training: Annotated[
        tuple[str, ...],
        Setting(
            "Name (or pattern such as 'paper0[1-3]') of a flight to fit on; all others judge. May be given several "
            "times. Default: half of them, chosen alike by place, day and excitation."
        ),
    ] = ()
    #: Several logs: names (shell patterns) of the logs that judge; all others train, unless `training` names those.
    validation: Annotated[
        tuple[str, ...],
        Setting("Name (or pattern) of a flight to judge on, likewise. Default: all that do not train."),
    ] = ()
    #: Also try other numbers of poles and zeros and recommend one; takes as long as ten more fits.
    scan_orders: Annotated[
        bool,
        Setting("Also try other numbers of poles and zeros, and recommend one. Takes as long as ten more fits."),
    ] = False
    #: Seconds that the fits of one log may take; a fit that takes longer is given up with a finding.
    time_limit: Annotated[
        float, Setting("Seconds after which a fit of one log is given up.", least=math.ulp(0.0), unit="s")
    ] = 120.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value, setting = getattr(self, field.name), SETTINGS[field.name]
            if isinstance(value, int | float) and not setting.least <= value <= setting.most:
                raise ConfigError(_refusal(field.name, value, setting))
        if self.zeros >= self.poles:
            raise ConfigError(f"zeros is {self.zeros}; choose 0 to {self.poles - 1}, fewer than the {self.poles} poles")


def _refusal(name: str, value: float, setting: Setting) -> str:
    unit = f" {setting.unit}" if setting.unit else ""
    said = name if "_" not in name else f"{name} (--{name.replace('_', '-')})"
    allowed = "more than 0" if math.isinf(setting.most) else f"{setting.least:g} to {setting.most:g}{unit}"
    return f"{said} is {value:g}{unit}; choose {allowed}{f' ({setting.remark})' if setting.remark else ''}"


#: By name, all that a user may set.
SETTINGS: dict[str, Setting] = {
    name: setting
    for name, hint in get_type_hints(AnalysisConfig, include_extras=True).items()
    for setting in getattr(hint, "__metadata__", ())
}
