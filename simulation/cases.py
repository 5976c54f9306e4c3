"""Everything that can be simulated by name, with settings that options or a YAML or TOML file can change."""

import dataclasses
import difflib
import math
import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar, get_type_hints

import yaml

from simulation import chirp_case, guntur2019, kim2017, mission_case, motion2018
from simulation.errors import ParameterError
from simulation.outcome import CaseOutcome
from simulation.sample_logs import FLIGHTS, TRAINING, VALIDATION
from simulation.vehicle import Vector

Settings = TypeVar("Settings")


def changed(settings: Settings, changes: Mapping[str, object]) -> Settings:
    """Return settings with some of them changed."""
    kinds = get_type_hints(type(settings))
    values = {}
    for name, value in changes.items():
        if name not in kinds:
            raise ParameterError(f"there is no setting {name!r}{nearest(name, kinds)}; there are: {', '.join(kinds)}")
        values[name] = _converted(name, value, kinds[name])
    return dataclasses.replace(settings, **values)  # type: ignore[type-var]


def nearest(name: str, names: Iterable[str]) -> str:
    """Suggest the names that look like a wrong one, as the end of a sentence."""
    matches = difflib.get_close_matches(name, list(names), n=2, cutoff=0.5)
    return f" (did you mean {' or '.join(matches)}?)" if matches else ""


def read(path: Path) -> dict[str, object]:
    """Read settings from a YAML file, or a TOML file by its ending.

    Raises
    ------
    ParameterError
        The file cannot be read, is malformed, or is not a list of names with values.
    """
    try:
        text = path.read_text(encoding="utf-8")
        values = tomllib.loads(text) if path.suffix == ".toml" else yaml.safe_load(text)
    except OSError as error:
        raise ParameterError(f"{path}: {error.strerror or error}") from error
    except (yaml.YAMLError, tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        reason, form = " ".join(str(error).split()), "TOML" if path.suffix == ".toml" else "YAML"
        raise ParameterError(f"{path} is not well-formed {form}: {reason}") from error
    if values is None:
        return {}
    if not isinstance(values, dict) or not all(isinstance(name, str) for name in values):
        raise ParameterError(f"{path}: wants a name and a value in each line, such as `wind: 3.0`")
    return values


def parse(options: Iterable[str]) -> dict[str, object]:
    """Read options of the form ``name=value``; vectors are numbers with commas, points are vectors with semicolons.

    Raises
    ------
    ParameterError
        An option has another form.
    """
    values: dict[str, object] = {}
    for option in options:
        name, equals, value = option.partition("=")
        if not (equals and name.strip() and value.strip()):
            raise ParameterError(f"{option!r}: wants name=value, such as wind=3 or target=48,35,81")
        values[name.strip()] = value.strip()
    return values


def _converted(name: str, value: object, kind: Any) -> object:
    if kind is float:
        return _number(name, value)
    if kind is int:
        number = _number(name, value)
        if number != round(number):
            raise ParameterError(f"{name} must be a whole number, not {value}")
        return round(number)
    if kind is str:
        return str(value)
    if kind == Vector:
        if name == "wind" and (
            not isinstance(value, str | list | tuple) or (isinstance(value, str) and "," not in value)
        ):
            # The papers' wind blows along x, and is given by its speed.
            return _number(name, value), 0.0, 0.0
        return _vector(name, value)
    points = value.split(";") if isinstance(value, str) else value
    if not isinstance(points, list | tuple):
        raise ParameterError(f"{name} must be a list of points of three numbers, not {value!r}")
    return tuple(_vector(name, point) for point in points)


def _number(name: str, value: object) -> float:
    try:
        if isinstance(value, bool) or not isinstance(value, str | float | int):
            raise ValueError
        number = float(value)
    except ValueError as error:
        raise ParameterError(f"{name} must be a number, not {value!r}") from error
    if not math.isfinite(number):
        raise ParameterError(f"{name} must be a finite number, not {value!r}")
    return number


def _vector(name: str, value: object) -> Vector:
    parts = value.split(",") if isinstance(value, str) else value
    if not (isinstance(parts, list | tuple) and len(parts) == 3):
        raise ParameterError(f"{name} must be three numbers, such as 48,35,81, not {value!r}")
    x, y, z = (_number(name, part) for part in parts)
    return x, y, z


@dataclass(frozen=True, slots=True)
class Case:
    """A simulation with a name."""

    name: str
    summary: str
    settings: Any  #: What can be changed, with the usual values.
    simulate: Callable[[str, str, Any], CaseOutcome]  #: Takes name, summary and settings.

    def run(self, changes: Mapping[str, object] = MappingProxyType({})) -> CaseOutcome:
        """Simulate the case.

        Parameters
        ----------
        changes : mapping
            Settings that differ from the usual ones, by name; see `simulation.cases.changed`.

        Raises
        ------
        ParameterError
            A setting does not exist or cannot be.
        DivergenceError
            The simulation left every sensible state; the message says when and in which.
        ArrivalError
            The craft did not reach its target.
        """
        return self.simulate(self.name, self.summary, changed(self.settings, changes))


_ALL = (
    *(
        Case(sample.name, sample.summary, mission_case.settings_of(sample), mission_case.simulate)
        for sample in FLIGHTS.values()
    ),
    *(Case(name, summary, flight, motion2018.simulate) for name, summary, flight in motion2018.FLIGHTS),
    Case(
        "chirps",
        "a hover with chirps on roll, pitch and yaw, for rotorid tune and rotorid prove",
        chirp_case.Chirps(),
        chirp_case.simulate,
    ),
    Case("kim-recovery", "Kim 2017: the LQR levels the craft from Table 5", kim2017.Recovery(), kim2017.simulate),
    Case(
        "guntur-profile",
        "Guntur 2019: the flight plan with five payloads, and which of five motors holds it",
        guntur2019.Profile(),
        guntur2019.simulate,
    ),
    Case(
        "guntur-discharge",
        "Guntur 2019: the flight plan while the tank empties",
        guntur2019.Profile(payload=1.0, discharge=0.05, discharge_start=5.0),
        guntur2019.simulate,
    ),
)

#: Every case by name.
CASES: Mapping[str, Case] = MappingProxyType({case.name: case for case in _ALL})

#: Several cases under one name.
GROUPS: Mapping[str, tuple[Case, ...]] = MappingProxyType(
    {
        "elhesasy": tuple(CASES[sample.name] for sample in (*TRAINING, *VALIDATION)),
        "motion": tuple(CASES[name] for name, _, _ in motion2018.FLIGHTS),
        "guntur": (CASES["guntur-profile"], CASES["guntur-discharge"]),
        "kim": (CASES["kim-recovery"],),
    }
)


def find(name: str) -> tuple[Case, ...]:
    """Return the case of this name, or the cases of the group of this name.

    Raises
    ------
    ParameterError
        There is none; the message suggests those that look alike.
    """
    if name in GROUPS:
        return GROUPS[name]
    if name in CASES:
        return (CASES[name],)
    hint = nearest(name, (*CASES, *GROUPS))
    raise ParameterError(f"no case called {name!r}{hint}; `rotorid simulate --list` names all of them")
