"""What cannot exist is refused with a sentence: craft, instruments, missions, places and weather."""

import dataclasses

import numpy as np
import pytest

from simulation import ParameterError, Setup, elhesasy2024, guntur2019, motion2018
from simulation.atmosphere import Atmosphere
from simulation.controllers import Cascade
from simulation.drive import Battery, Drive, FirstOrder, ThirdOrder
from simulation.guntur2019 import MOTORS
from simulation.mission import Chirp, GoTo, Mission, Wait
from simulation.place import Place
from simulation.rotor import BladeElementRotor, QuadraticRotor
from simulation.sensors import Gps, Inertial
from simulation.vehicle import RotorMount, Tank
from simulation.wind import Wind

OCTA = elhesasy2024.octocopter()
ROTOR = OCTA.rotors[0].rotor


def octa(**changes):
    return dataclasses.replace(OCTA, **changes)


SEA = Place(name="sea", lat_deg=45.0, lon_deg=0.0, alt=0.0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Cascade(position_p=(-1.0, 2.0, 4.0)), "not negative"),
        (lambda: Cascade(tilt_limit_deg=80.0), "tilt limit 80"),
        (lambda: Mission(takeoff=0.0, steps=()), "take-off height 0 m"),
        (lambda: Mission(takeoff=5.0, steps=(GoTo(0, 0, -3.0),)), "fly between 1 and 500 m"),
        (lambda: Mission(takeoff=5.0, steps=(Wait(-1.0),)), "wait between 0 and 600 s"),
        (lambda: Place(name="x", lat_deg=95.0, lon_deg=0.0, alt=0.0), "below 89 deg"),
        (lambda: Drive(speed_max=-1.0, response=FirstOrder(0.04)), "speed_max must be positive"),
        (lambda: FirstOrder(0.0), "time_constant must be positive"),
        (lambda: Drive(speed_max=900.0, response=FirstOrder(0.04), expo=1.5), "expo must lie in 0..1"),
        (lambda: Drive(speed_max=900.0, response=FirstOrder(0.04), spin_min=0.99), "spin_arm <= spin_min < spin_max"),
        (lambda: Drive(speed_max=900.0, response=FirstOrder(0.04), pwm_min=2000.0), "pwm_min < pwm_max"),
        (lambda: QuadraticRotor(thrust_coefficient=0.0, torque_coefficient=1e-7), "thrust_coefficient"),
        (lambda: Battery(voltage_empty=17.0), "voltage_empty < voltage_full"),
        (lambda: Battery(capacity=0.0), "capacity must be positive"),
        (lambda: guntur2019.find("Duracell"), "no motor called 'Duracell'; there are: MT-4006"),
        (lambda: guntur2019.quadcopter(MOTORS[0], 1.2), r"payload 1\.2 must lie in 0..1"),
        (lambda: BladeElementRotor(radius=-0.1, pitch=0.1, chord=0.03), "radius must be positive"),
        (lambda: Tank(time=(0.0,), mass=(1.0,), inertia=(np.eye(3),)), "at least two times"),
        (lambda: Tank(time=(1.0, 0.0), mass=(1.0, 0.5), inertia=(np.eye(3),) * 2), "times must increase"),
        (lambda: Tank(time=(0.0, 1.0), mass=(1.0, 0.0), inertia=(np.eye(3),) * 2), "masses must be positive"),
        (lambda: Tank(time=(0.0, 1.0), mass=(1.0, 0.5), inertia=(np.eye(3), -np.eye(3))), "not positive definite"),
        (lambda: guntur2019.quadcopter(MOTORS[0], 0.0, discharge=0.1), "payload 0 must be positive"),
        (
            lambda: octa(rotors=(RotorMount(ROTOR, (0, 0, 0), 1, inertia=-1.0),)),
            "inertia of rotor 1",
        ),
        (lambda: Chirp("surge", 0.1), "not 'surge'"),
        (lambda: Chirp("roll", 0.9), "0 < magnitude <= 0.5"),
        (lambda: Chirp("roll", 0.1, start_hz=5.0, stop_hz=2.0), "start_hz < stop_hz"),
        (lambda: Chirp("roll", 0.1, seconds=1e4), "shorter than 600 s"),
        (lambda: Gps(outages=((5.0, 3.0),)), "begin before they end"),
        (lambda: Inertial(accel_range=0.0), "accel_range must be positive"),
        (
            lambda: Setup(mission=Mission(takeoff=3.0, steps=()), place=SEA, vehicle=OCTA, step=0.1),
            "step 0.1 s must lie in",
        ),
        (lambda: octa(mass=-1.0), "mass must be positive"),
        (lambda: octa(mass=float("nan")), "mass must be positive"),
        (lambda: octa(inertia=np.diag((0.1, 0.1, 0.5))), "no body has principal moments"),
        (lambda: octa(inertia=np.diag((0.1, -0.1, 0.1))), "not positive definite"),
        (lambda: octa(inertia=np.eye(2)), "symmetric 3 x 3"),
        (lambda: octa(rotors=()), "needs rotors"),
        (lambda: octa(rotors=(RotorMount(ROTOR, (0.1, 0, 0), 2),)), r"spin \+1 or -1"),
        (
            lambda: dataclasses.replace(OCTA, **{"rotors": (RotorMount(ROTOR, (0.1, 0, 0), 1, axis=(0, 0, -2.0)),)}),
            "unit vector",
        ),
        (lambda: octa(drag_linear=(-0.1, 0.0, 0.0)), "drag cannot be negative"),
        (lambda: ThirdOrder(lead=0.0, a1=0.01, a2=0.001, a3=0.001), "Routh"),
        (lambda: dataclasses.replace(motion2018.DRIVE, a2=-1.0), "a2 must be positive"),
        (lambda: Atmosphere.standard(-1000.0), "outside the standard troposphere"),
        (lambda: Atmosphere.standard(12000.0), "outside the standard troposphere"),
        (lambda: Wind(speed=-1.0), "wind speed"),
        (lambda: Wind(speed=99.0), "wind speed"),
        (lambda: Wind(gusts=-0.1), "gust factor"),
        (lambda: Wind(height=1.0), "low-altitude Dryden"),
    ],
)
def test_what_cannot_exist_is_refused(make, message):
    with pytest.raises(ParameterError, match=message):
        make()
