"""The flights behind `sample_logs/`: the octocopter of Elhesasy 2024 on missions as in the paper, and a quadcopter."""

import datetime as dt
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

from simulation import survey_quadcopter
from simulation.controllers import Cascade
from simulation.elhesasy2024 import octocopter
from simulation.flight_log import Logging
from simulation.fly import Setup
from simulation.mission import Chirp, GoTo, Mission, Step, Turn, Wait
from simulation.place import Place
from simulation.sensors import Gps, Inertial, Magnetometer, Sensors, Vector
from simulation.wind import Wind


@dataclass(frozen=True, slots=True, kw_only=True)
class SampleFlight:
    """A mission that can be flown by name."""

    name: str  #: Also the name of its log.
    summary: str  #: What is flown, in a line.
    setup: Setup  #: Everything that determines the flight.
    start_utc: dt.datetime  #: UTC at the start of the simulation.
    boot: float = 18.0  #: Time since the autopilot's boot at that instant, s.
    logging: Logging = field(default_factory=Logging)  #: What is logged how often.
    telemetry: bool = False  #: Whether a telemetry log (`.tlog`) is written beside the on-board log.


def _flight(name: str, row: Mapping[str, Any]) -> SampleFlight:
    octo = row["group"] != "quadcopter"
    setup = Setup(
        mission=Mission(steps=tuple(_step(*step) for step in row["steps"]), **row["mission"]),
        place=Place(**row["place"]),
        vehicle=octocopter() if octo else survey_quadcopter.quadcopter(),
        wind=Wind(**row.get("wind", {})),
        cascade=Cascade() if octo else survey_quadcopter.CASCADE,
        sensors=_sensors(**row["sensors"]),
        seed=row["seed"],
    )
    return SampleFlight(
        name=name,
        summary=row["summary"],
        setup=setup,
        start_utc=row["start_utc"],
        boot=row["boot"],
        logging=Logging(**row.get("logging", {})),
        telemetry=row.get("telemetry", False),
    )


def _step(kind: str, *values: Any) -> Step:
    kinds: dict[str, Callable[..., Step]] = {"wait": Wait, "go": GoTo, "turn": Turn, "chirp": Chirp}
    return kinds[kind](*values)


def _sensors(
    gps_lag: float,
    gyro: list[float],
    accel: list[float],
    iron: list[float],
    drifting: bool = False,
    outages: Sequence[Sequence[float]] = (),
) -> Sensors:
    return Sensors(
        inertial=Inertial(
            gyro_bias=_scaled(gyro, 1e-3),
            accel_bias=_scaled(accel, 1e-3),
            gyro_instability=1.7e-4 if drifting else 0.0,
            accel_instability=0.02 if drifting else 0.0,
        ),
        gps=Gps(lag=gps_lag, outages=tuple((start, end) for start, end in outages)),
        magnetometer=Magnetometer(hard_iron=_scaled(iron, 1e-9)),
    )


def _scaled(vector: list[float], unit: float) -> Vector:
    x, y, z = vector
    return x * unit, y * unit, z * unit


_ROWS = tomllib.loads(Path(__file__).with_name("sample_flights.toml").read_text(encoding="utf-8"))

#: Every flight by name.
FLIGHTS: Mapping[str, SampleFlight] = MappingProxyType({name: _flight(name, row) for name, row in _ROWS.items()})

#: Three training flights, nine held-out ones, and those of another craft.
TRAINING, VALIDATION, QUADCOPTERS = (
    tuple(FLIGHTS[name] for name, row in _ROWS.items() if row["group"] == group)
    for group in ("training", "validation", "quadcopter")
)
