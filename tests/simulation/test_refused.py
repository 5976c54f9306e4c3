"""What cannot exist is refused with a sentence: craft, instruments, missions, places and weather."""

import dataclasses

import numpy as np
import pytest

from simulation import ParameterError, Setup, elhesasy2024
from simulation.atmosphere import Atmosphere
from simulation.controllers import Cascade
from simulation.drive import Battery, Drive, FirstOrder
from simulation.mission import Chirp, Mission
from simulation.place import Place, Wind
from simulation.sensors import Gps
from simulation.vehicle import RotorMount, Tank

OCTA = elhesasy2024.octocopter()
ROTOR = OCTA.rotors[0].rotor


def octa(**changes):
    return dataclasses.replace(OCTA, **changes)


SEA = Place(name="sea", lat_deg=45.0, lon_deg=0.0, alt=0.0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Cascade(position_p=(-1.0, 2.0, 4.0)), "not negative"),
        (lambda: Mission(takeoff=0.0, steps=()), "take-off height 0 m"),
        (lambda: Place(name="x", lat_deg=95.0, lon_deg=0.0, alt=0.0), "below 89 deg"),
        (lambda: Drive(speed_max=-1.0, response=FirstOrder(0.04)), "speed_max must be positive"),
        (lambda: Battery(voltage_empty=17.0), "voltage_empty < voltage_full"),
        (lambda: Tank(time=(0.0, 1.0), mass=(1.0, 0.5), inertia=(np.eye(3), -np.eye(3))), "not positive definite"),
        (
            lambda: octa(rotors=(RotorMount(ROTOR, (0, 0, 0), 1, inertia=-1.0),)),
            "inertia of rotor 1",
        ),
        (lambda: Chirp("roll", 0.9), "0 < magnitude <= 0.5"),
        (lambda: Gps(outages=((5.0, 3.0),)), "begin before they end"),
        (
            lambda: Setup(mission=Mission(takeoff=3.0, steps=()), place=SEA, vehicle=OCTA, step=0.1),
            "step 0.1 s must lie in",
        ),
        (lambda: octa(mass=-1.0), "mass must be positive"),
        (lambda: octa(inertia=np.diag((0.1, 0.1, 0.5))), "no body has principal moments"),
        (lambda: octa(rotors=(RotorMount(ROTOR, (0.1, 0, 0), 2),)), r"spin \+1 or -1"),
        (
            lambda: dataclasses.replace(OCTA, **{"rotors": (RotorMount(ROTOR, (0.1, 0, 0), 1, axis=(0, 0, -2.0)),)}),
            "unit vector",
        ),
        (lambda: Atmosphere.standard(-1000.0), "outside the standard troposphere"),
        (lambda: Wind(speed=-1.0), "wind speed"),
    ],
)
def test_what_cannot_exist_is_refused(make, message):
    with pytest.raises(ParameterError, match=message):
        make()
