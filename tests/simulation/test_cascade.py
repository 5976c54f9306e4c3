"""The PID cascade with the gains of Elhesasy 2024, Table 1."""

import dataclasses
import math

import numpy as np
import pytest

from simulation import DivergenceError, Setup, elhesasy2024, fly
from simulation._kernels import FLYING, mix
from simulation.controllers import Cascade, mixer
from simulation.mission import GoTo, Mission, Wait
from simulation.place import Place, Wind
from simulation.sensors import Inertial, Navigation, Sensors

OCTA = elhesasy2024.octocopter()
SEA = Place(name="sea", lat_deg=45.0, lon_deg=0.0, alt=0.0)
#: Instruments without any error, to see the craft alone.
PERFECT = Sensors(
    inertial=Inertial(gyro_noise=0.0, accel_noise=0.0, gyro_vibration=0.0, accel_vibration=0.0),
    navigation=Navigation(position=0.0, velocity=0.0, tilt=0.0, yaw=0.0),
)


def setup(*steps, wind=Wind(), sensors=PERFECT, **changes):  # noqa: B008 - frozen
    mission = Mission(takeoff=5.0, steps=steps, disarmed=0.5, armed=0.5)
    return dataclasses.replace(Setup(mission=mission, place=SEA, vehicle=OCTA, wind=wind, sensors=sensors), **changes)


def test_table_1_makes_damped_loops_with_a_tenth_of_the_printed_inertia_only():
    """Attitude as two integrators with rate gain K (1/s): damping sqrt(K / P) / 2, before the lags take their share.

    Table 1 read in ArduPilot's normalised units, authority at half thrust or more. With the printed
    inertia roll would swing with a damping below 0.25.
    """
    factors = mixer(OCTA)
    arms = np.array([mount.position for mount in OCTA.rotors])
    per_unit = OCTA.rotors[0].rotor.thrust(OCTA.drive.speed_max) * (-arms[:, 1] @ factors[:, 0])
    rate_gain = 0.1 * per_unit / OCTA.inertia[0, 0]
    printed = 0.1 * per_unit / elhesasy2024.PRINTED_INERTIA[0, 0]
    assert 0.5 * math.sqrt(rate_gain / 6.5) == pytest.approx(0.73, abs=0.04)
    assert 0.5 * math.sqrt(printed / 6.5) < 0.25
    # And the print would put every gram of the craft beyond its rotors.
    assert elhesasy2024.PRINTED_INERTIA[2, 2] > OCTA.mass * 0.35**2


def test_mixer_is_that_of_octa_plus():
    """ArduPilot's AP_MotorsMatrix: sine and cosine of the arm, +-0.5; clockwise motors turn the nose left."""
    c = math.sqrt(0.5)
    roll = 0.5 * np.array([0, 0, -c, -c, c, c, 1, -1])
    pitch = 0.5 * np.array([1, -1, c, -c, c, -c, 0, 0])
    yaw = 0.5 * np.array([-1, -1, 1, 1, 1, 1, -1, -1])
    assert mixer(OCTA) == pytest.approx(np.column_stack((roll, pitch, yaw)), abs=1e-12)


def test_allocation_gives_up_yaw_before_roll():
    factors, u = mixer(OCTA), np.empty(8)
    assert not mix(0.5, 0.2, 0.0, 0.1, factors, u)
    assert u == pytest.approx(0.5 + factors @ [0.2, 0.0, 0.1])
    assert mix(0.5, 0.8, 0.0, 1.0, factors, u)
    assert u.min() >= 0.0
    assert u.max() <= 1.0
    assert u @ factors[:, 0] == pytest.approx(0.8 * (factors[:, 0] @ factors[:, 0]), rel=1e-6)


def test_relocation_arrives_and_stays_upright_in_wind():
    flight = fly(setup(Wait(1), GoTo(12.0, -6.0, 9.0), Wait(6), wind=Wind(speed=3.0, from_deg=300.0, gusts=0.0)))
    end = flight.truth.loc[: flight.reference.land].iloc[-1]
    # Integral action: the steady wind leaves decimetres after six seconds.
    assert end[["p_n", "p_e", "p_d"]].to_numpy() == pytest.approx([12.0, -6.0, -9.0], abs=0.15)
    airborne = flight.truth[flight.truth["state"] == FLYING]
    assert np.degrees(np.abs(airborne[["roll", "pitch"]].to_numpy()).max()) < 20.0


def test_unstable_gains_stop_with_time_and_state():
    wild = Cascade(roll_rate=(3.0, 0.0, 0.0), pitch_rate=(3.0, 0.0, 0.0), angle_p=(40.0, 40.0, 2.5))
    with pytest.raises(DivergenceError, match=r"at \d+\.\d+ s"):
        fly(setup(Wait(5), GoTo(20, 0, 10), cascade=wild, wind=Wind(speed=3.0)))
