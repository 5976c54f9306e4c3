"""Missions under the cascade as cases: the octocopter of Elhesasy 2024 and the quadcopter."""

from dataclasses import dataclass, replace
from operator import attrgetter
from typing import Any

import numpy as np
import pandas as pd

from simulation import _kernels
from simulation.fly import STATE_COLUMNS, SimulatedFlight
from simulation.mission import FlownChirp, GoTo, Turn, Wait
from simulation.outcome import CaseOutcome, CasePlot, Fact, named, rotor_speeds, with_units
from simulation.sample_logs import FLIGHTS, SampleFlight, fly_sample, write_flight
from simulation.vehicle import Vector


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionSettings:
    """What of a mission can be changed."""

    mass: float  #: kg; the inertia stays.
    takeoff: float  #: Height of the first hover, m.
    #: North, east and up [m] to fly to one after the other, with two seconds' hover at each; none: the case's own.
    points: tuple[Vector, ...]
    speed: float  #: Largest speed between the points, m/s.
    heading: float  #: deg.
    #: Mean wind [m/s], where it comes from [deg] and the factor on its turbulence.
    wind: float
    wind_from: float
    gusts: float
    #: deg, deg, m above sea level, K above the standard atmosphere.
    latitude: float
    longitude: float
    altitude: float
    warmer: float
    gps_lag: float  #: s.
    step: float  #: Of the physics, s.
    seed: int


#: Where in the setup of a flight a setting lies.
_PLACES = {
    "mass": "vehicle.mass",
    "takeoff": "mission.takeoff",
    "heading": "mission.heading_deg",
    "wind": "wind.speed",
    "wind_from": "wind.from_deg",
    "gusts": "wind.gusts",
    "latitude": "place.lat_deg",
    "longitude": "place.lon_deg",
    "altitude": "place.alt",
    "warmer": "place.warmer",
    "gps_lag": "sensors.gps.lag",
    "step": "step",
    "seed": "seed",
}
#: Largest speed between the points of a sample, m/s, unless it says otherwise.
_SPEED = 3.0


def settings_of(sample: SampleFlight) -> MissionSettings:
    """Return the settings with which a sample is what it is."""
    return MissionSettings(
        points=(), speed=_SPEED, **{name: attrgetter(place)(sample.setup) for name, place in _PLACES.items()}
    )


def simulate(name: str, summary: str, settings: MissionSettings) -> CaseOutcome:
    """Fly a sample's mission with these settings."""
    sample = _apply(FLIGHTS[name], settings)
    flight = fly_sample(sample)

    names = [*STATE_COLUMNS, "wind_n", "wind_e", "wind_d", "voltage", "current", "mass"]
    numbers = range(1, len(flight.setup.vehicle.rotors) + 1)
    rows = flight.truth.iloc[:: round(0.05 / (flight.truth.index[1] - flight.truth.index[0]))]
    return CaseOutcome(
        name=name,
        summary=summary,
        facts=_facts(flight),
        plots=_plots(flight, rows),
        history=with_units(rows[[*names, *(f"{letter}{k}" for k in numbers for letter in "wm")]]),
        write_log=lambda folder: write_flight(sample, folder, flight),
    )


def _apply(sample: SampleFlight, settings: MissionSettings) -> SampleFlight:
    steps = sample.setup.mission.steps
    if settings.points:
        steps = tuple(step for n, e, up in settings.points for step in (Wait(2.0), GoTo(n, e, up, settings.speed)))
    elif settings.speed != _SPEED:
        steps = tuple(replace(step, speed=settings.speed) if isinstance(step, GoTo) else step for step in steps)
    setup = replace(sample.setup, mission=replace(sample.setup.mission, steps=steps))
    for name, place in _PLACES.items():
        setup = _with(setup, place.split("."), getattr(settings, name))
    return replace(sample, setup=setup)


def _with(part: Any, path: list[str], value: object) -> Any:
    """Return a dataclass with the value at a path through its fields changed."""
    name, *rest = path
    return replace(part, **{name: _with(getattr(part, name), rest, value) if rest else value})


def _planned(flight: SimulatedFlight, rows: pd.DataFrame) -> np.ndarray:
    planned: np.ndarray = flight.reference.samples[flight.reference.tick_at(rows.index.to_numpy())]
    return planned


def _facts(flight: SimulatedFlight) -> tuple[Fact, ...]:
    setup = flight.setup
    air = flight.truth.loc[flight.airborne[0] : flight.airborne[1]]
    flying = flight.truth[flight.truth["state"] == _kernels.FLYING]
    error = flying[["p_n", "p_e", "p_d"]].to_numpy() - _planned(flight, flying)[:, 0:3]
    apart, axes = np.sqrt(np.mean(error**2, axis=0)), ("north", "east", "down")
    speed = np.sqrt((air[["v_n", "v_e"]] ** 2).sum(axis=1))
    motors = air[[f"m{k}" for k in range(1, len(setup.vehicle.rotors) + 1)]]
    tilt = np.degrees(np.hypot(air["roll"], air["pitch"]))
    kinds = {Wait: "hold", GoTo: "relocation", Turn: "turn", FlownChirp: "chirp"}
    counts = [kinds[type(step)] for step in setup.mission.steps]
    steps = ", ".join(f"{counts.count(kind)} x {kind}" for kind in dict.fromkeys(counts))
    return (
        Fact("craft", setup.vehicle.name),
        Fact("mass", setup.vehicle.mass, "kg"),
        Fact("place", f"{setup.place.name}, {setup.place.alt:g} m"),
        Fact("air density at the ground", setup.place.atmosphere.density_at(0.0), "kg/m³"),
        Fact("mean wind", setup.wind.speed, "m/s"),
        Fact("mission", steps),
        Fact("time in the air", flight.airborne[1] - flight.airborne[0], "s"),
        Fact("greatest height", float(-air["p_d"].min()), "m"),
        Fact("greatest horizontal speed", float(speed.max()), "m/s"),
        Fact("greatest tilt", float(tilt.max()), "deg"),
        *(Fact(f"distance from the plan, RMS {axis}", float(apart[k]), "m") for k, axis in enumerate(axes)),
        Fact("hover thrust", 100.0 * flight.hover_thrust, "% of full"),
        Fact("motor outputs", f"{motors.min().min():.0f} to {motors.max().max():.0f}", "us"),
        Fact("charge drawn", float(air["charge"].iloc[-1]) / 3.6, "mA h"),
        Fact("battery voltage at landing", float(air["voltage"].iloc[-1]), "V"),
        Fact("accelerometer samples clipped", float(flight.truth["clips"].iloc[-1])),
    )


def _plots(flight: SimulatedFlight, rows: pd.DataFrame) -> tuple[CasePlot, ...]:
    active = rows["state"].isin((_kernels.FLYING, _kernels.LANDING)).to_numpy()
    plan = np.where(active, -_planned(flight, rows)[:, 2], np.nan)
    where = "Position against the plan: steps are flown from rest to rest, the landing ends where the ground is."
    lean = "Attitude: the craft leans against the wind and into each relocation."
    up = rows.assign(up=-rows["p_d"], up_planned=plan, climb=-rows["v_d"])
    turned = rows[["roll", "pitch", "yaw"]] * (180.0 / np.pi)
    return (
        CasePlot(where, "position (m)", named(up, north="p_n", east="p_e", up="up", up_planned="up_planned")),
        CasePlot("Velocity over the ground.", "velocity (m/s)", named(up, north="v_n", east="v_e", up="climb")),
        CasePlot(lean, "angle (deg)", turned[["roll", "pitch"]]),
        CasePlot("Heading.", "heading (deg)", turned[["yaw"]]),
        CasePlot("Speeds of the rotors.", "rotor speed (rad/s)", rotor_speeds(rows)),
        CasePlot("Wind at the craft.", "wind (m/s)", named(rows, north="wind_n", east="wind_e", down="wind_d")),
        CasePlot("Battery under load.", "voltage (V)", named(rows, voltage="voltage")),
    )
