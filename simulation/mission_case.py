"""Missions under the cascade as cases: the octocopter of Elhesasy 2024 and the quadcopter."""

import dataclasses
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from simulation import _kernels
from simulation.fly import Flight
from simulation.mission import Chirp, GoTo, Turn, Wait
from simulation.outcome import Fact, Outcome, Plot
from simulation.sample_flights import FLIGHTS, SampleFlight
from simulation.sample_logs import fly_sample, write_flight
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


def settings_of(sample: SampleFlight) -> MissionSettings:
    """Return the settings with which a sample is what it is."""
    setup = sample.setup
    return MissionSettings(
        mass=setup.vehicle.mass,
        takeoff=setup.mission.takeoff,
        points=(),
        speed=3.0,
        heading=setup.mission.heading_deg,
        wind=setup.wind.speed,
        wind_from=setup.wind.from_deg,
        gusts=setup.wind.gusts,
        latitude=setup.place.lat_deg,
        longitude=setup.place.lon_deg,
        altitude=setup.place.alt,
        warmer=setup.place.warmer,
        gps_lag=setup.sensors.gps.lag,
        step=setup.step,
        seed=setup.seed,
    )


def simulate(name: str, summary: str, settings: MissionSettings) -> Outcome:
    """Fly a sample's mission with these settings."""
    sample = _apply(FLIGHTS[name], settings)
    flight = fly_sample(sample)

    def write_log(folder: Path) -> list[Path]:
        return write_flight(sample, folder, flight)

    rows = flight.truth.iloc[:: round(0.05 / (flight.truth.index[1] - flight.truth.index[0]))]
    return Outcome(
        name=name,
        summary=summary,
        facts=_facts(flight),
        plots=_plots(flight, rows),
        history=_history(flight, rows),
        write_log=write_log,
    )


def _apply(sample: SampleFlight, settings: MissionSettings) -> SampleFlight:
    setup = sample.setup
    steps = setup.mission.steps
    if settings.points:
        steps = tuple(step for n, e, up in settings.points for step in (Wait(2.0), GoTo(n, e, up, settings.speed)))
    elif settings.speed != settings_of(sample).speed:
        steps = tuple(
            dataclasses.replace(step, speed=settings.speed) if isinstance(step, GoTo) else step for step in steps
        )
    setup = dataclasses.replace(
        setup,
        mission=dataclasses.replace(setup.mission, takeoff=settings.takeoff, heading_deg=settings.heading, steps=steps),
        vehicle=dataclasses.replace(setup.vehicle, mass=settings.mass),
        wind=dataclasses.replace(setup.wind, speed=settings.wind, from_deg=settings.wind_from, gusts=settings.gusts),
        place=dataclasses.replace(
            setup.place,
            lat_deg=settings.latitude,
            lon_deg=settings.longitude,
            alt=settings.altitude,
            warmer=settings.warmer,
        ),
        sensors=dataclasses.replace(setup.sensors, gps=dataclasses.replace(setup.sensors.gps, lag=settings.gps_lag)),
        seed=settings.seed,
        step=settings.step,
    )
    return dataclasses.replace(sample, setup=setup)


def _planned(flight: Flight, rows: pd.DataFrame) -> np.ndarray:
    tick = (rows.index.to_numpy() / flight.reference.tick + 1e-9).astype(np.int64)
    return flight.reference.samples[np.minimum(tick, len(flight.reference.samples) - 1)]


def _facts(flight: Flight) -> tuple[Fact, ...]:
    setup = flight.setup
    air = flight.truth.loc[flight.airborne[0] : flight.airborne[1]]
    flying = flight.truth[flight.truth["state"] == _kernels.FLYING]
    error = flying[["p_n", "p_e", "p_d"]].to_numpy() - _planned(flight, flying)[:, 0:3]
    speed = np.sqrt((air[["v_n", "v_e"]] ** 2).sum(axis=1))
    motors = air[[f"m{k}" for k in range(1, len(setup.vehicle.rotors) + 1)]]
    tilt = np.degrees(np.hypot(air["roll"], air["pitch"]))
    kinds = {Wait: "hold", GoTo: "relocation", Turn: "turn", Chirp: "chirp"}
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
        Fact("distance from the plan, RMS north", float(np.sqrt(np.mean(error[:, 0] ** 2))), "m"),
        Fact("distance from the plan, RMS east", float(np.sqrt(np.mean(error[:, 1] ** 2))), "m"),
        Fact("distance from the plan, RMS down", float(np.sqrt(np.mean(error[:, 2] ** 2))), "m"),
        Fact("hover thrust", 100.0 * flight.hover_thrust, "% of full"),
        Fact("motor outputs", f"{motors.min().min():.0f} to {motors.max().max():.0f}", "us"),
        Fact("charge drawn", float(air["charge"].iloc[-1]) / 3.6, "mA h"),
        Fact("battery voltage at landing", float(air["voltage"].iloc[-1]), "V"),
        Fact("accelerometer samples clipped", float(flight.truth["clips"].iloc[-1])),
    )


def _plots(flight: Flight, rows: pd.DataFrame) -> tuple[Plot, ...]:
    planned = _planned(flight, rows)
    active = rows["state"].isin((_kernels.FLYING, _kernels.LANDING)).to_numpy()
    planned = np.where(active[:, None], planned, np.nan)
    n = len(flight.setup.vehicle.rotors)

    def lines(**columns: np.ndarray | pd.Series) -> pd.DataFrame:
        return pd.DataFrame({name.replace("_", " "): value for name, value in columns.items()}, index=rows.index)

    return (
        Plot(
            "Position against the plan: steps are flown from rest to rest, the landing ends where the ground is.",
            "position (m)",
            lines(north=rows["p_n"], east=rows["p_e"], up=-rows["p_d"], up_planned=-planned[:, 2]),
        ),
        Plot(
            "Velocity over the ground.",
            "velocity (m/s)",
            lines(north=rows["v_n"], east=rows["v_e"], up=-rows["v_d"]),
        ),
        Plot(
            "Attitude: the craft leans against the wind and into each relocation.",
            "angle (deg)",
            lines(roll=np.degrees(rows["roll"]), pitch=np.degrees(rows["pitch"])),
        ),
        Plot("Heading.", "heading (deg)", lines(yaw=np.degrees(rows["yaw"]))),
        Plot(
            "Speeds of the rotors.",
            "rotor speed (rad/s)",
            pd.DataFrame({f"rotor {k}": rows[f"w{k}"] for k in range(1, n + 1)}),
        ),
        Plot("Wind at the craft.", "wind (m/s)", lines(north=rows["wind_n"], east=rows["wind_e"], down=rows["wind_d"])),
        Plot("Battery under load.", "voltage (V)", lines(voltage=rows["voltage"])),
    )


def _history(flight: Flight, rows: pd.DataFrame) -> pd.DataFrame:
    names = {f"p_{axis}": f"p_{axis}_m" for axis in "ned"} | {f"v_{axis}": f"v_{axis}_m_s" for axis in "ned"}
    names |= {name: name for name in ("q_w", "q_x", "q_y", "q_z")} | {f"w_{axis}": f"w_{axis}_rad_s" for axis in "xyz"}
    names |= {f"wind_{axis}": f"wind_{axis}_m_s" for axis in "ned"} | {"voltage": "voltage_v", "current": "current_a"}
    names |= {"mass": "mass_kg"}
    for k in range(1, len(flight.setup.vehicle.rotors) + 1):
        names |= {f"w{k}": f"w{k}_rad_s", f"m{k}": f"m{k}_us"}
    return rows[list(names)].rename(columns=names).rename_axis("t_s")
