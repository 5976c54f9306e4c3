"""Everything that can be simulated by name, with settings that can be changed."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from simulation import chirp_case, guntur2019, kim2017, mission_case, motion2018
from simulation.errors import ParameterError
from simulation.outcome import Outcome
from simulation.sample_flights import FLIGHTS, TRAINING, VALIDATION
from simulation.settings import changed, nearest


@dataclass(frozen=True, slots=True)
class Case:
    """A simulation with a name."""

    name: str
    summary: str
    settings: Any  #: What can be changed, with the usual values.
    simulate: Callable[[str, str, Any], Outcome]  #: Takes name, summary and settings.

    def run(self, changes: Mapping[str, object] = MappingProxyType({})) -> Outcome:
        """Simulate the case.

        Parameters
        ----------
        changes : mapping
            Settings that differ from the usual ones, by name; see `simulation.settings.changed`.

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
        "a hover with chirps on roll, pitch and yaw, for `rotorid tune` and `rotorid prove`",
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
