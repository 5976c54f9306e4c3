"""Results of a simulated case: characteristics, plots, tables, a history and a log."""

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import pandas as pd


@dataclass(frozen=True, slots=True)
class Fact:
    """One characteristic of a flight, such as ``Fact("largest speed", 4.93, "m/s")``."""

    name: str
    value: float | str
    unit: str = ""

    @property
    def text(self) -> str:
        """Value with its unit, to four digits."""
        value = self.value if isinstance(self.value, str) else f"{self.value:.4g}"
        return f"{value} {self.unit}".strip()


@dataclass(frozen=True, slots=True)
class CasePlot:
    """Lines over time."""

    caption: str  #: What to see.
    axis: str  #: Title of the vertical axis, with the unit.
    lines: pd.DataFrame  #: Index `t` [s]; a column for each line, named as in the legend.


@dataclass(frozen=True, slots=True)
class CaseTable:
    """Rows to read; `frame` holds text and numbers, its columns are named as they shall be read."""

    caption: str
    frame: pd.DataFrame


@dataclass(frozen=True, slots=True, kw_only=True)
class CaseOutcome:
    """A simulated case."""

    name: str
    summary: str
    facts: tuple[Fact, ...]  #: Characteristics of the flight.
    plots: tuple[CasePlot, ...]
    history: pd.DataFrame  #: Index `t` [s]; names of columns carry their units.
    write_log: Callable[[Path], list[Path]]  #: Writes the log and its truth into a folder; returns the files.
    notes: tuple[str, ...] = ()  #: Where this differs from what the paper prints, and why.
    tables: tuple[CaseTable, ...] = field(default=())
    #: What is wrong with the settings although the flight came to its end, such as unstable gains; else empty.
    fault: str = ""


#: Units of columns by their names, as they are appended in a history.
_UNITS = (
    (r"p_[ned]|[xyz]", "m"),
    (r"v_.|wind_.", "m_s"),
    (r"w_.|w\d+", "rad_s"),
    (r"a\d+", "rad_s2"),
    (r"m\d+", "us"),
    ("mass", "kg"),
    ("voltage", "v"),
    ("current", "a"),
)


def with_units(path: pd.DataFrame) -> pd.DataFrame:
    """Return a history: columns with their units in their names, indexed by `t_s`."""

    def name(column: str) -> str:
        unit = next((unit for pattern, unit in _UNITS if re.fullmatch(pattern, column)), "")
        return f"{column}_{unit}" if unit else column

    return path.rename(columns=name).rename_axis("t_s")


def named(path: pd.DataFrame, **columns: str) -> pd.DataFrame:
    """Return columns of a path under the names of a legend."""
    return pd.DataFrame({name.replace("_", " "): path[column] for name, column in columns.items()})


def rotor_speeds(path: pd.DataFrame, word: str = "rotor") -> pd.DataFrame:
    """Return the speeds of the rotors, rad/s, as lines of a plot."""
    return path.filter(regex=r"^w\d+$").rename(columns=lambda column: f"{word} {column[1:]}")


def write(outcome: CaseOutcome, folder: Path) -> list[Path]:
    """Write NAME.txt (characteristics), NAME.csv (history), a CSV for each table, the log and its truth.

    Returns
    -------
    list of Path
        The files written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"{outcome.name}.txt", folder / f"{outcome.name}.csv"]
    paths[0].write_text(characteristics(outcome), encoding="utf-8")
    outcome.history.to_csv(paths[1], float_format="%.6g")
    for number, table in enumerate(outcome.tables, start=1):
        paths.append(folder / f"{outcome.name}_table{number}.csv")
        table.frame.to_csv(paths[-1], index=False, float_format="%.6g")
    return paths + outcome.write_log(folder)


def characteristics(outcome: CaseOutcome) -> str:
    """Return the characteristics of the flight as text."""
    width = max(len(fact.name) for fact in outcome.facts) + 2
    lines = [f"{outcome.name}: {outcome.summary}", "simulated by rotorid, not flown", ""]
    lines += [f"{fact.name:{width}}{fact.text}" for fact in outcome.facts]
    for table in outcome.tables:
        lines += ["", table.caption, table.frame.to_string(index=False, float_format=lambda value: f"{value:.4g}")]
    if outcome.notes:
        lines += ["", "Where the paper prints something else:", *(f"- {note}" for note in outcome.notes)]
    return "\n".join(lines) + "\n"
