"""Proposed parameters of an autopilot: value now, value proposed, sigma, reason; as a table and as files that load."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

from core.lazy import lazy
from core.parameter import Parameter
from core.quantity import number, uncertain
from core.summary import Summarised, listed
from core.table import Cell, Row, Table

if TYPE_CHECKING:
    from sysid.loops import parameter_file
else:
    parameter_file = lazy("sysid.loops.parameter_file")  # whoever reads values of a report needs no numerical package

#: Standard deviations from what flies below which a value is no other.
_OTHER = 2.0


class ParameterFile(StrEnum):
    """Steps of the ArduPilot Methodic Configurator whose files are written, as it names them."""

    ESC = "20_esc.param"
    THROTTLE = "24_throttle_controller.param"
    MOTOR_NOTCH = "25_motor_notch_filter_results.param"
    PID_FILTERS = "28_pid_notch_filter_results.param"
    D_FF = "46_pid_d_ff.param"
    WIND = "47_windspeed_estimation.param"
    GAINS = "57_analytical_pid_optimization.param"


@dataclass(frozen=True, slots=True)
class AutopilotValue:
    """One parameter of the autopilot, and what flights say of it."""

    name: str  #: As the autopilot spells it.
    file: ParameterFile
    now: float | None  #: As flown; None where the log does not tell.
    #: What to set, with its sigma and reason; its value is None where nothing is proposed, and the reason says why.
    proposed: Parameter
    right: bool = False  #: Whether the value flown was confirmed.

    @property
    def shown(self) -> str:
        """The proposed value for people; empty where there is none."""
        value, sigma = self.proposed.value, self.proposed.sigma
        return "" if value is None else uncertain(value, sigma) if sigma else f"{value:g}"

    @property
    def line(self) -> str:
        """The line of a parameter file."""
        assert self.proposed.value is not None
        spread = f"± {self.proposed.sigma:.2g}; " if self.proposed.sigma else ""
        before = "" if self.now is None else f"was {self.now:g}; "
        return parameter_file.parameter_line(self.name, self.proposed.value, spread + before + self.proposed.reason)


@dataclass(frozen=True, slots=True, repr=False)
class AutopilotValues(Summarised):
    """What the flights of one craft propose to its autopilot."""

    flights: tuple[str, ...]  #: In the order in which they were flown.
    values: tuple[AutopilotValue, ...]  #: Step by step.
    remarks: tuple[str, ...] = ()  #: What about the flights, or the order of loading, is to be known.

    @property
    def proposed(self) -> Mapping[str, float]:
        """Values to set by name."""
        return {value.name: value.proposed.value for value in self.values if value.proposed.value is not None}

    def table(self) -> Table:
        """Return the table of every parameter, proposed and flown, with its reason."""
        rows: list[Row] = []
        for file in ParameterFile:
            own = [value for value in self.values if value.file is file]
            rows += [Row(file.value, kind="part")] if own else []
            for (new, why), alike in groupby(own, lambda value: (bool(value.shown), value.proposed.reason)):
                first, *others = alike
                stays = Cell("right" if first.right else "stays", "unknown")
                if others and not new:
                    rows.append(Row(f"  {first.name} to {others[-1].name}", ["", stays, why]))
                    continue
                for value in (first, *others):  # the reason stands once
                    now = "" if value.now is None else number(value.now, parameter_file.DIGITS)
                    cell = Cell(value.shown, "good") if new else stays
                    rows.append(Row(f"  {value.name}", [now, cell, why if value is first else ""]))
        return Table("parameter", ["now", "proposed", "why, or why not"], rows, texts=(2,), style="reasons")

    def write(self, folder: Path) -> list[Path]:
        """Write a file for each step of which something is proposed, each loadable alone; drop those of an earlier run.

        Parameters
        ----------
        folder : Path
            Made when missing.

        Returns
        -------
        list of Path
        """
        folder.mkdir(parents=True, exist_ok=True)
        written = []
        for file in ParameterFile:
            lines = [value.line for value in self.values if value.file is file and value.proposed.value is not None]
            path = folder / file.value
            if lines:
                path.write_text("\n".join(lines) + "\n", encoding="utf-8")
                written.append(path)
            else:
                path.unlink(missing_ok=True)
        return written

    def summary(self) -> Mapping[str, str]:
        """Return what is proposed, and what is not."""
        changes = [f"{name} {value:.4g}" for name, value in self.proposed.items()]
        stays = [value.name for value in self.values if value.proposed.value is None]
        return {"flights": listed(self.flights), "proposed": listed(changes) or "nothing", "stays": listed(stays)}


def refused(
    names: Sequence[str], file: ParameterFile, flown: Mapping[str, float], why: str, right: bool = False
) -> list[AutopilotValue]:
    """Return parameters of which nothing is proposed."""
    return [AutopilotValue(name, file, flown.get(name), Parameter(None, None, "", why), right) for name in names]


def over_flights(flights: Sequence[tuple[str, Sequence[AutopilotValue]]]) -> AutopilotValues:
    """Return what the flights of a craft, the newest last, say together: of each step the newest that knows of it.

    Values of a step belong together, but for those of an axis: the published procedure flies one in each flight. Gains
    found with another filter of the gyro, which serves all axes, belong together again.
    """
    by_step: dict[tuple[ParameterFile, str], list[list[AutopilotValue]]] = {}
    gains = [value for _, values in flights for value in values if value.file is ParameterFile.GAINS]
    whole = any(gain.proposed.value is not None and not _axis(gain.name) for gain in gains)
    for _, values in flights:
        own: dict[tuple[ParameterFile, str], list[AutopilotValue]] = {}
        for value in values:
            by_axis = value.file is ParameterFile.D_FF or (value.file is ParameterFile.GAINS and not whole)
            own.setdefault((value.file, _axis(value.name) if by_axis else ""), []).append(value)
        for step, step_values in own.items():
            by_step.setdefault(step, []).append(step_values)
    newest: list[AutopilotValue] = []
    for file, alone in sorted(by_step, key=lambda step: list(ParameterFile).index(step[0])):
        every = by_step[file, alone]
        known = [values for values in every if any(value.right or value.proposed.value is not None for value in values)]
        newest += (known or every)[-1]
    return AutopilotValues(tuple(name for name, _ in flights), tuple(newest))


def _axis(name: str) -> str:
    """Return the letters of the axis that a parameter is of; empty of one that serves all."""
    return next((part for part in name.split("_") if part in ("RLL", "PIT", "YAW")), "")


def decided(
    parameters: Mapping[str, Parameter], file: ParameterFile, flown: Mapping[str, float]
) -> list[AutopilotValue]:
    """Return values that are set together: all, or none if all equal those flown within their errors."""
    if all(_as_flown(flown.get(name), parameters[name]) for name in parameters):
        stays = {name: f"within the error of what flew: {parameters[name]}" for name in parameters}
        return [one for name in parameters for one in refused([name], file, flown, stays[name], right=True)]
    return [
        AutopilotValue(
            name,
            file,
            flown.get(name),
            replace(parameter, value=None if parameter.value is None else parameter_file.typed(parameter.value)),
        )
        for name, parameter in parameters.items()
    ]


def _as_flown(now: float | None, parameter: Parameter) -> bool:
    if now is None or parameter.value is None:
        return False
    return abs(parameter.value - now) <= max(
        _OTHER * (parameter.sigma or 0.0), abs(parameter.value) * 10.0**-parameter_file.DIGITS
    )
