"""A flight whose truth is simple, taken through the real identification, for pages and files to be made of."""

from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import sysid
from core.serialization import cleaned
from estimation import Trajectory
from logparse import Finding, Geodetic, Motor, Severity, Vehicle
from pipeline import AnalysisConfig, FlightResult, GroupResult, LogFacts, ModelResult, Span
from pipeline.fleet.result import FleetResult
from pipeline.flight.answer import compose_answer
from pipeline.flight.identification import free_runs, model_result
from pipeline.names import folder_names
from pipeline.results.failure import Failure
from pipeline.results.fleet import FlightEntry, GroupEntry, LogFailure
from pipeline.results.model import verdict_of
from pipeline.results.report import CraftReport
from pipeline.storage.store import open_store
from reports import publish, write_fleet
from tests.reports.accounts import account, signals
from tests.reports.made import made

NO_THRUST = Failure("thrust", "no voltage was logged; set LOG_BITMASK to include CURRENT")

#: A kind of model that the log could not give.
WITHOUT_REFERENCE = model_result(
    "reference",
    "position target → position",
    Failure("reference", "no position targets; set NTUN (bit 5) in LOG_BITMASK"),
)


def judged(model, fitted, judges, key="motors", title="motor PWM → position", **of) -> ModelResult:
    """Validate a model as the pipeline does."""
    records = [*fitted, *judges]
    validation = sysid.validate(model, records)
    return model_result(key, title, model, validation, free_runs(model, validation, records), **of)


@cache
def made_flight(
    name: str = "flight01",
    *,
    motors: int = 2,
    poles: int = 2,
    zeros: int = 1,
    duration: float = 60.0,
    seed: int = 1,
    fit: bool = True,
) -> FlightResult:
    """Fly a craft whose position is a damped second-order answer to its motors, and identify it."""
    rng = np.random.default_rng(seed)
    t = np.arange(40.0, 40.0 + duration, 0.1)
    hover = 1550.0
    steps = np.repeat(rng.normal(0.0, 60.0, (len(t) // 30 + 1, motors)), 30, axis=0)[: len(t)]
    u = hover + steps + rng.normal(0.0, 8.0, (len(t), motors))
    mix = rng.normal(0.0, 0.02, (3, motors))
    y = np.zeros((len(t), 3))
    velocity = np.zeros(3)
    for k in range(len(t) - 1):
        velocity = velocity + 0.1 * (mix @ (u[k] - hover) - 0.6 * y[k] - 0.9 * velocity)
        y[k + 1] = y[k] + 0.1 * velocity
    y += rng.normal(0.0, 0.02, y.shape)
    names = tuple(f"m{k + 1}" for k in range(motors))
    angles = np.linspace(0.0, 2 * np.pi, motors, endpoint=False)
    vehicle = Vehicle(
        autopilot="ArduCopter",
        firmware="ArduCopter",
        version="4.5.7",
        frame_class="octa" if motors == 8 else "quad",
        frame_type="plus",
        motors=tuple(Motor(k + 1, k + 1, float(angles[k]), 1 - 2 * (k % 2), 0, 0.0, 0.0, 0.0) for k in range(motors)),
    )
    record = sysid.Experiment.from_arrays(
        t,
        u,
        y,
        name=name,
        input_names=names,
        output_names=("x", "y", "z"),
        units={"x": "m", "y": "m", "z": "m"},
        vehicle=vehicle,
    )
    wide = np.arange(20.0, 60.0 + duration, 0.05)
    states = pd.DataFrame({"p_n": 0.0, "p_e": 0.0, "p_d": 0.0, "v_n": 0.0, "v_e": 0.0, "v_d": 0.0}, index=wide)
    for column, sign, number in (("p_n", 1.0, 0), ("p_e", 1.0, 1), ("p_d", -1.0, 2)):
        states[column] = sign * np.interp(wide, t, y[:, number])
        states[f"v{column[1:]}"] = np.gradient(states[column], wide)
    sigma = pd.DataFrame(0.1, index=wide, columns=["p_n", "p_e", "p_d", "v_n", "v_e", "v_d", "phi_n", "phi_e", "phi_d"])
    trajectory = Trajectory(
        states=states,
        sigma=sigma,
        covariance=np.zeros((len(wide), 9, 9)),
        origin=Geodetic(0.8, 0.1, 200.0),
        method="strapdown",
        diagnostics={"gps_nis": 1.04},
    )
    lat = 0.8 + (states["p_n"] + rng.normal(0, 0.4, len(wide))) / 6.371e6
    lon = 0.1 + (states["p_e"] + rng.normal(0, 0.4, len(wide))) / 6.371e6 / np.cos(0.8)
    gps = pd.DataFrame({"lat": lat, "lon": lon, "alt": 200.0 - states["p_d"] + rng.normal(0, 0.6, len(wide))}).iloc[::4]
    models = (model_result("motors", "motor PWM → position", Failure("motors", "the fit was not asked for")),)
    if fit:
        fitted, held_out = record.split(0.7)
        model = sysid.fit_transfer_functions([fitted], poles=poles, zeros=zeros)
        models = (judged(model, [fitted], [held_out], flight=name), WITHOUT_REFERENCE)
    flight = Span(float(t[0]), float(t[-1]))
    result = FlightResult(
        name=name,
        log=LogFacts(
            file=f"{name}.BIN",
            bytes=2_756_608,
            sha256="0" * 64,
            format="dataflash",
            duration_s=duration + 60.0,
            start_utc=datetime(2024, 5, 2, 9, 30, tzinfo=UTC).isoformat(),
            boots=1,
            flights=(flight,),
            flight_number=1,
            flight_count=1,
        ),
        vehicle=vehicle,
        craft="craft",
        config=AnalysisConfig(poles=poles, zeros=zeros),
        flight=flight,
        motors=pd.DataFrame(u, index=t, columns=list(names)),
        modes=pd.DataFrame({"mode": ["STABILIZE", "AUTO", "LAND"]}, index=[10.0, 44.0, 40.0 + 0.85 * duration]),
        gps=gps,
        trajectory=trajectory,
        experiments={"motors": record},
        models=models,
        findings=(
            Finding(
                "gps-lag",
                Severity.WARNING,
                "GPS positions were written 0.18 s after they were true.",
                "Set GPS_DELAY_MS to what your receiver needs.",
                {"lag_s": 0.18},
            ),
            Finding("backward-rows", Severity.INFO, "212 rows go slightly backwards in time and were sorted."),
        ),
        account=account(flight=flight),
        signals=signals(),
        **dict.fromkeys(("thrust", "parameters", "coverage", "rotation"), NO_THRUST),
        timings={"read": 0.021, "trajectory": 0.84, "model": 6.2},
    )
    return replace(result, answer=compose_answer(result))


@pytest.fixture(scope="session")
def flight() -> FlightResult:
    return made_flight()


@pytest.fixture(scope="session")
def other() -> FlightResult:
    return made_flight("flight02", seed=2, fit=False)


@pytest.fixture(scope="session")
def craft(flight: FlightResult, other: FlightResult) -> GroupResult:
    model = sysid.fit_transfer_functions([flight.experiment], poles=2, zeros=1)
    plain = sysid.fit_transfer_functions([flight.experiment], poles=1, zeros=0, structure="common")
    name, records = "ArduCopter quad plus", ([flight.experiment], [other.experiment])
    models = (
        judged(model, *records, craft=name),
        judged(plain, *records, "mixer", "mixer commands → position", craft=name),
        WITHOUT_REFERENCE,
    )
    report = made(
        CraftReport,
        name=name,
        vehicle=flight.vehicle,
        training=("flight01",),
        held_out=("flight02",),
        split="every second flight in order of name trains, the others judge",
        verdict=verdict_of(model.report for model in models),
        models=tuple(model.report for model in models),
        rmse=tuple(row for model in models for row in model.report.rmse),
        missing={"thrust": "no accelerometer"},
    )
    return GroupResult(report=cleaned(report, CraftReport), models=models)


FAILURES = (LogFailure("notes.bin", "not a flight log: text without a single FMT row"),)


def composed(folder: Path, flights: Sequence[FlightResult], crafts: Sequence[GroupResult] = (), **facts) -> Path:
    """Publish flights and crafts below a folder and compose the report on all of them; give its page."""
    names = folder_names([flight.name for flight in flights])
    for flight in flights:
        publish(flight, folder / "flights" / names[flight.name])
    for number, group in enumerate(crafts):
        publish(group, folder / "crafts" / f"craft{number}")
    write_fleet(
        FleetResult(
            flights=tuple(made(FlightEntry, folder=name) for name in names.values()),
            groups=tuple(made(GroupEntry, folder=f"craft{number}") for number in range(len(crafts))),
            config=flights[0].config if flights else AnalysisConfig(),
            store=open_store(folder),
            **{"failures": FAILURES} | facts,
        )
    )
    return folder / "report.html"


@pytest.fixture(scope="session")
def fleet(flight, other, craft, tmp_path_factory) -> Path:
    """Return the folder of a report on two flights of one craft."""
    return composed(tmp_path_factory.mktemp("fleet"), [flight, other], [craft]).parent
