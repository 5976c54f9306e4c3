"""Write `sample_logs/`: logs of simulated flights with the truth beside them, the same files on every run.

The flights are the octocopter of Elhesasy 2024 on missions as in the paper, and a quadcopter.
"""

import datetime as dt
import json
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from simulation.controllers import Cascade
from simulation.elhesasy2024 import CASCADE, octocopter, quadcopter
from simulation.flight_log import Logging, write_bin, write_tlog
from simulation.fly import MotorLoss, Setup, SimulatedFlight, fly
from simulation.instruments import InstrumentedFlight
from simulation.mission import FlownChirp, GoTo, Mission, Step, Turn, Wait
from simulation.place import Place, Wind
from simulation.sensors import Gps, Inertial, Magnetometer, Sensors, Vector
from simulation.truth import describe_mission


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
    octo = name.startswith("octa")
    setup = Setup(
        mission=Mission(steps=tuple(_step(*step) for step in row["steps"]), **row["mission"]),
        place=Place(**row["place"]),
        vehicle=octocopter() if octo else quadcopter(),
        wind=Wind(**row.get("wind", {})),
        cascade=Cascade() if octo else CASCADE,
        sensors=_sensors(**row["sensors"]),
        losses=tuple(MotorLoss(*loss) for loss in row.get("losses", [])),
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
    kinds: dict[str, Callable[..., Step]] = {"wait": Wait, "go": GoTo, "turn": Turn, "chirp": FlownChirp}
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

#: Three training flights, and nine held-out ones.
TRAINING, VALIDATION = (
    tuple(FLIGHTS[name] for name, row in _ROWS.items() if row["group"] == group) for group in ("training", "validation")
)


#: The damaged log: which flight it was, and its name.
DAMAGED_FLIGHT, DAMAGED = "octa04_bergen_gusty", "octa13_damaged"


def fly_sample(sample: SampleFlight) -> SimulatedFlight:
    """Fly a sample's mission, recorded as finely as it is logged; what chirps do is logged in each loop."""
    loop = 0.5 / sample.setup.step if sample.logging.pid else 100.0
    return fly(sample.setup, rate=max(loop, sample.logging.imu, sample.logging.rate))


def write_flight(sample: SampleFlight, folder: Path, flight: SimulatedFlight | None = None) -> list[Path]:
    """Write the log of a flight (`.bin`), its truth (`.json`) and, where it has one, its telemetry log (`.tlog`)."""
    folder.mkdir(parents=True, exist_ok=True)
    flight = flight or fly_sample(sample)
    log = InstrumentedFlight(flight, sample.start_utc, sample.boot)
    paths = [folder / f"{sample.name}.bin", folder / f"{sample.name}.json"]
    write_bin(paths[0], log, sample.logging)
    truth = describe_mission(flight, log, sample.name, sample.summary, sample.logging.imu)
    paths[1].write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")
    if sample.telemetry:
        paths.append(folder / f"{sample.name}.tlog")
        write_tlog(paths[2], log)
    return paths


def write_sample_logs(folder: str | Path, progress: Callable[[str, float], None] | None = None) -> list[Path]:
    """Fly all samples and write their logs and truth; the same files on every run.

    Parameters
    ----------
    folder : path-like
        Made if missing; files of the same names are overwritten.
    progress : callable, optional
        Called with what is being written and the fraction done.

    Returns
    -------
    list of Path
        The files written.
    """
    folder = Path(folder)
    paths: list[Path] = []
    for done, sample in enumerate(FLIGHTS.values()):
        if progress is not None:
            progress(sample.name, done / len(FLIGHTS))
        paths += write_flight(sample, folder)
    paths += write_damaged(folder)
    if progress is not None:
        progress("sample logs", 1.0)
    return paths


def write_damaged(folder: Path) -> list[Path]:
    """Write a log that a card has spoilt, from the log of `DAMAGED_FLIGHT` in the folder, and its truth.

    A block of the card was never written and holds 0xFF, another holds what was there before, some bytes are gone,
    and the battery was pulled in flight, in the middle of a row.
    """
    whole = (folder / f"{DAMAGED_FLIGHT}.bin").read_bytes()
    random = np.random.RandomState(113)
    data = bytearray(whole)
    erased, stale, lost = (round(share * len(data)) for share in (0.35, 0.55, 0.62))
    data[erased : erased + 4096] = b"\xff" * 4096
    data[stale : stale + 2048] = random.randint(0, 256, 2048, dtype=np.uint8).tobytes()
    del data[lost : lost + 37]
    del data[round(0.8 * len(data)) + 11 :]
    paths = [folder / f"{DAMAGED}.bin", folder / f"{DAMAGED}.json"]
    paths[0].write_bytes(data)
    truth = json.loads((folder / f"{DAMAGED_FLIGHT}.json").read_text(encoding="utf-8"))
    truth["name"] = DAMAGED
    truth["damage"] = {
        "flight": DAMAGED_FLIGHT,
        "bytes_of_the_whole_log": len(whole),
        "bytes_left": len(data),
        "erased_block": [erased, erased + 4096],
        "stale_block": [stale, stale + 2048],
        "bytes_lost": [lost, lost + 37],
        "end": "cut in flight, inside a row",
    }
    paths[1].write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")
    return paths
