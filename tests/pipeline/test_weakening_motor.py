"""A motor that loses thrust from flight to flight, flown by the simulator in different winds, sensed and logged."""

import dataclasses
import datetime as dt

import numpy as np
import pytest

import logparse
from pipeline.fleet.drift import follow
from simulation import elhesasy2024
from simulation.drive import QuadraticRotor
from simulation.fly import Setup
from simulation.mission import GoTo, Mission, Turn, Wait
from simulation.place import Place, Wind
from simulation.sample_logs import SampleFlight, write_flight
from sysid.rotors.motor_faults.trims import steady_trims
from tests.pipeline.builders import flown

FLIGHTS = 6


def octocopter(weak, loss):
    """Build the octocopter with one motor that gives less thrust and torque by the part `loss`."""
    craft = elhesasy2024.octocopter()
    mount = craft.rotors[weak - 1]
    rotor = QuadraticRotor(
        thrust_coefficient=mount.rotor.thrust_coefficient * (1.0 - loss),
        torque_coefficient=mount.rotor.torque_coefficient * (1.0 - loss),
    )
    rotors = list(craft.rotors)
    rotors[weak - 1] = dataclasses.replace(mount, rotor=rotor)
    return dataclasses.replace(craft, rotors=tuple(rotors))


def fly(folder, number, weak, loss, random):
    """Fly once, in a wind of its own, and read what the log says of the motors."""
    name = f"flight{number}"
    sample = SampleFlight(
        name=name,
        summary="",
        setup=Setup(
            mission=Mission(
                takeoff=8.0,
                heading_deg=float(random.uniform(-180.0, 180.0)),
                steps=(Wait(12), GoTo(8, 0, 10), Turn(60.0), Wait(12)),
            ),
            place=Place(name="Zurich", lat_deg=47.4, lon_deg=8.5, alt=488.0),
            vehicle=octocopter(weak, loss),
            wind=Wind(speed=float(random.uniform(0.0, 2.5)), from_deg=float(random.uniform(0.0, 360.0))),
            seed=int(random.integers(1, 400_000_000)),
        ),
        start_utc=dt.datetime(2025, 3, 1, 9, tzinfo=dt.UTC) + dt.timedelta(days=number),
    )
    log = logparse.read_log(write_flight(sample, folder)[0])
    trims = steady_trims(log.tables, log.vehicle, log.flight.start, log.flight.stop)
    return dataclasses.replace(flown(name, start=log.start_utc), trims=trims)


@pytest.mark.slow
@pytest.mark.parametrize(("weak", "loss"), [(3, 0.02), (6, 0.0)])
def test_a_motor_that_loses_two_per_cent_a_flight_is_named_and_a_sound_one_is_not(tmp_path, weak, loss):
    random = np.random.default_rng(90210 + weak)
    flights = [fly(tmp_path, k, weak, loss * k, random) for k in range(FLIGHTS)]
    motors = follow(flights).motors
    if loss:
        assert motors.weakening == f"m{weak}"
        assert motors.loss == pytest.approx(loss, rel=0.25)
    else:
        assert motors.weakening is None
