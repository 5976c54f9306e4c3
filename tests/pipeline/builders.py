"""Entries of flights as the store keeps them, and what chirps told, made up for tests."""

import dataclasses
from datetime import UTC, datetime, timedelta
from math import pi

import numpy as np

from core.parameter import Parameter
from logparse import Vehicle
from logparse.craft.frames import motor_table
from pipeline.flight.coverage import distribution
from pipeline.flight.craft import build_of
from pipeline.flight.rotation import fitted_response
from pipeline.results.account import Account, MotorsReading
from pipeline.results.fleet import FlightEntry, FlightParameter
from pipeline.results.rotation import AxisMargins, AxisRotation, RotationResult, state_of
from pipeline.results.span import Span
from sysid.frequency.response import FrequencyResponse
from sysid.loops.known_margins import Margins
from sysid.rotors.steady_trims import SteadyTrims
from tests.pipeline.coverages import coverage_of

OCTA = Vehicle(autopilot="ArduPilot", frame_class="octa", frame_type="plus")


NOON = datetime(2024, 5, 2, 9, 30, tzinfo=UTC)


def flown(
    name: str,
    *,
    start: datetime | None = NOON,
    form: str = "dataflash",
    craft: str = "octa",
    lat: float = 0.8,
    sha256: str | None = None,
    board: str | None = None,
    vehicle: Vehicle = OCTA,
    tune: dict[str, str | float] | None = None,
) -> FlightEntry:
    track = tuple((float(t), 3.0 * float(t), 0.0, -10.0) for t in np.arange(0.0, 60.0, 0.5))
    return FlightEntry(
        name=name,
        folder=name,
        source=f"{name}.bin",
        key=name,
        sha256=sha256 or name,
        size=1,
        format=form,
        start_utc=start,
        duration=60.0,
        craft=craft,
        craft_name="octa",
        frame_class=vehicle.frame_class,
        vehicle=craft,
        flight=Span(5.0, 55.0),
        origin=(lat, 0.1, 100.0),
        track=track,
        position_known=True,
        experiments=("motors",),
        board=board,
        build=build_of(vehicle),
        tune=tune or {},
    )


def flight(name, moves=1.0, *, day=0, place=0, sigma=0.5, noise=0.05, hour=0):
    """Fly at one of several places, 64 km apart, on one of several days, moving so much."""
    entry = flown(name, start=NOON + timedelta(days=day, hours=hour), lat=0.8 + 0.01 * place)
    return dataclasses.replace(
        entry,
        coverage=coverage_of(
            excitation={"acceleration_rms": moves, "acceleration_noise": noise},
            health={"position_sigma": {"median": sigma, "max": sigma}},
        ),
    )


def covering(name, **values):
    """Make a flight of given values, ten a second; a place and height for the map."""
    quantities = {key: distribution(key, np.asarray(v, float)) for key, v in values.items()}
    seconds = len(next(iter(values.values()))) / 10.0
    return dataclasses.replace(
        flown(name),
        coverage=coverage_of(
            seconds=seconds,
            quantities=quantities,
            map=[[0, 1, seconds]],
            wind={"speed": 2.0, "direction": pi / 2, "sigma": 0.2},
            health={"position_sigma": {"median": 0.5, "max": 1.0}},
        ),
    )


def stated(parameter, value, sigma, unit="u", method="rigid body"):
    """State a parameter of a flight."""
    return FlightParameter(parameter=parameter, method=method, value=value, sigma=sigma, unit=unit)


START = datetime(2025, 6, 1, 8, tzinfo=UTC)


FRAMES = {"quad": "x", "hexa": "x", "octa": "plus"}


def hovering(random, frame, count, *, weak=None, loss=0.0, shift=0.0, scatter=0.004, sigma=0.001):
    """Fly a craft whose controller restores moments by roll, pitch and yaw alone.

    `weak` loses `loss` of its thrust from flight to flight; the centre of gravity moves ahead by `shift`; wind and load
    change the trims by `scatter` between flights.
    """
    motors = motor_table(frame, FRAMES[frame], None)
    factors = np.array([[m.roll, m.pitch, m.yaw] for m in motors])
    basis, _ = np.linalg.qr(factors)
    flights = []
    for k in range(count):
        trim = scatter * random.standard_normal(3)
        if weak is not None:
            trim = trim + basis[weak - 1] * loss * k
        trim[1] += np.sign(basis[:, 1] @ factors[:, 1]) * shift * k
        steady = SteadyTrims(
            tuple(f"m{motor.number}" for motor in motors),
            tuple(trim + sigma * random.standard_normal(3)),
            (sigma**2,) * 3,
            tuple(map(tuple, basis.tolist())),
        )
        entry = flown(f"f{k:02d}", start=START + timedelta(days=k))
        works = MotorsReading(mean={str(motor.number): 0.4 for motor in motors}, hardest="1", at_limit=0.0)
        flights.append(dataclasses.replace(entry, trims=steady, account=Account(flight=entry.flight, motors=works)))
    return flights


def margins(gain: float | None, phase: float | None, *, stable: bool = True, unstable: float = 0.0) -> Margins:
    def known(value: float | None, unit: str) -> Parameter:
        return Parameter(value, None if value is None else 0.1, unit, "" if value is not None else "beyond the band")

    return Margins(
        gain_db=known(gain, "dB"),
        phase_deg=known(phase, "deg"),
        crossover_hz=known(5.0, "Hz"),
        rejection_hz=known(2.0, "Hz"),
        peak_db=known(4.0, "dB"),
        intervals={"gain_db": (5.0, 7.0)},
        stable=stable,
        unstable=unstable,
    )


def chirped() -> FrequencyResponse:
    """Make the response that a chirp of the roll axis tells: 100 rad/s^2 through an integrator, 10 ms late."""
    hz = np.geomspace(0.5, 20.0, 40)
    s = 2j * np.pi * hz
    response = 100.0 / s * np.exp(-0.01 * s)
    ones = np.ones(len(hz))
    return FrequencyResponse(
        axis="roll",
        input="out_roll",
        output="w_x",
        unit="rad/s",
        hz=hz,
        response=response,
        coherence=0.9 * ones,
        sigma=0.05 * ones,
        averages=20.0 * ones,
        resolution=0.5 * ones,
        multiple_coherence=0.9 * ones,
        method="instrument",
        instrument="chirp",
        direct=response,
        step=0.0025,
        duration=20.0,
    )


def turning(computed: Margins) -> RotationResult:
    """Make what a chirp of the roll axis tells of a flight."""
    rate = fitted_response(chirped(), None)
    rate = dataclasses.replace(
        rate,
        model=(rate.gain_db, rate.phase_deg),
        structure="rate",
        parameters={"gain": Parameter(100.0, 2.0, "rad/s^2"), "effective_delay": Parameter(0.01, 0.001, "s")},
        insensitivity={"gain": 0.01, "delay": 0.02},
        cost=3.0,
        verdict="excellent",
    )
    loop = AxisMargins(state=state_of(computed), gains={"ATC_RAT_RLL_P": 0.1}, computed=computed)
    roll = AxisRotation(axis="roll", rate=rate, loop=loop)
    others = (AxisRotation(axis=axis, reason="nothing moved", loop_reason="no chirp") for axis in ("pitch", "yaw"))
    return RotationResult(axes=(roll, *others))
