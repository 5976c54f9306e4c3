"""Missions of the papers' craft flown by `simulation`, cut into records with the truth's inputs and noisy outputs."""

import numpy as np

from simulation.fly import Setup, SimulatedFlight, fly
from simulation.instruments import attitude_angles
from simulation.mission import FlownChirp, GoTo, Mission, Turn, Wait
from simulation.place import Place, Wind
from simulation.vehicle import Multirotor
from sysid.records.context import standard_density
from tests.sysid.simulated_craft import described, of_craft

#: Back and forth at several speeds, up and down, every axis shaken, with turns between: what tells every parameter.
EXCITING = Mission(
    takeoff=8.0,
    steps=(
        GoTo(30.0, 0.0, 8.0, 8.0),
        GoTo(0.0, 0.0, 8.0, 3.0),
        GoTo(0.0, 30.0, 8.0, 8.0),
        GoTo(0.0, 0.0, 8.0, 3.0),
        GoTo(0.0, 0.0, 30.0, 5.0),
        Turn(100.0),
        GoTo(0.0, 0.0, 8.0, 2.0),
        GoTo(25.0, 25.0, 20.0, 6.0),
        FlownChirp("roll", 0.08, 0.5, 6.0, 12.0, placed=True),
        FlownChirp("pitch", 0.08, 0.5, 6.0, 12.0, placed=True),
        FlownChirp("yaw", 0.15, 0.5, 4.0, 10.0, placed=True),
        FlownChirp("throttle", 0.1, 0.5, 3.0, 8.0, placed=True),
        Turn(200.0),
        GoTo(0.0, 0.0, 10.0, 6.0),
        Wait(3.0),
    ),
    acceleration=3.0,
)
HOVER = Mission(takeoff=8.0, steps=(Wait(40.0),))


def flown(
    craft: Multirotor,
    mission: Mission = EXCITING,
    wind: Wind | None = None,
    altitude: float = 0.0,
    seed: int = 0,
    rate: float = 50.0,
) -> SimulatedFlight:
    """Fly a mission; `altitude` above the sea in m."""
    place = Place(name="test", lat_deg=47.0, lon_deg=8.0, alt=altitude)
    return fly(Setup(mission=mission, place=place, vehicle=craft, wind=wind or Wind(), seed=seed), rate=rate)


def record(
    flight: SimulatedFlight, rng: np.random.Generator | None = None, position: float = 0.01, name: str = "flight"
):
    """Cut the airborne part out, with noise on position [m] and tenths of it on velocity [m/s]."""
    craft, place = flight.setup.vehicle, flight.setup.place
    rows = flight.truth.loc[flight.airborne[0] + 2.0 : flight.airborne[1] - 3.0]
    t = rows.index.to_numpy()
    roll, pitch, yaw = attitude_angles(rows)

    def noisy(values, sigma):
        return values if rng is None else values + sigma * rng.standard_normal(len(values))

    context = {
        **{"roll": roll, "pitch": pitch, "yaw": np.unwrap(yaw)},
        **{f"w_{a}": rows[f"w_{a}"].to_numpy() for a in "xyz"},
        **{f"f_{a}": noisy(rows[f"f_{a}"].to_numpy(), 0.05) for a in "xyz"},
        **{f"v_{a}": noisy(rows[f"v_{a}"].to_numpy(), 0.1 * position) for a in "ned"},
        "density": standard_density(place.alt - rows["p_d"].to_numpy()),
        "voltage": rows["voltage"].to_numpy(),
        # The attitude is the truth's.
        **{f"phi_{a}": np.full(len(t), 1e-5) for a in "ned"},
    }
    pwm = rows[[f"m{k + 1}" for k in range(len(craft.rotors))]].to_numpy()
    place_up = [noisy(rows[f"p_{a}"].to_numpy() * s, position) for a, s in zip("ned", (1, 1, -1), strict=True)]
    return of_craft(t, pwm, np.column_stack(place_up), context, described(craft), name)
