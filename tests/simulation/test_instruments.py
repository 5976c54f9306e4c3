"""Errors of the instruments: drift, clipping, outages, speed controllers; chirps."""

import dataclasses
import math

import numpy as np
import pytest

from simulation import elhesasy2024, fly
from simulation.fly import Setup
from simulation.mission import CHIRP_AXES, Chirp, Mission, Wait
from simulation.place import Place
from simulation.sensors import Inertial, Navigation, Sensors

SEA = Place(name="sea", lat_deg=45.0, lon_deg=0.0, alt=0.0)
OCTA = elhesasy2024.octocopter()


def setup(*steps, **changes):
    mission = Mission(takeoff=3.0, steps=steps, disarmed=0.5, armed=0.5)
    return dataclasses.replace(Setup(mission=mission, place=SEA, vehicle=OCTA), **changes)


def test_bias_drift_is_gauss_markov_from_zero():
    inertial = Inertial(gyro_instability=2e-4, accel_instability=0.02, instability_time=50.0)
    drift = inertial.drift(400_000, 0.05, np.random.RandomState(3))
    assert np.array_equal(drift[0], np.zeros(6))
    # 20 000 s hold 200 spans of two correlation times: variances come out to 10 %, means to 7 % of a sigma.
    wander = drift - drift.mean(axis=0)
    assert wander[:, :3].std() == pytest.approx(2e-4, rel=0.1)
    assert wander[:, 3:].std() == pytest.approx(0.02, rel=0.1)
    lag = round(50.0 / 0.05)
    correlation = np.mean(wander[lag:] * wander[:-lag], axis=0) / wander.var(axis=0)
    assert correlation.mean() == pytest.approx(math.exp(-1.0), abs=0.1)
    assert not Inertial().drift(10, 0.05, np.random.RandomState(3)).any()


def test_chirp_sweeps_between_its_frequencies():
    """The phase's derivative is the stated frequency; the sine starts and ends at nothing."""
    chirp = Chirp("pitch", 0.1, start_hz=0.5, stop_hz=10.0, seconds=20.0, fade=2.0)
    t = np.linspace(0.0, chirp.duration, 200_001)
    signal = chirp.signal(t)
    assert chirp.hold == 4.0
    assert (chirp.frequency(t[:1])[0], chirp.frequency(t[-1:])[0]) == pytest.approx((0.5, 10.0))
    assert np.abs(signal).max() == pytest.approx(0.1, rel=1e-3)
    assert signal[[0, -1]] == pytest.approx([0.0, 0.0])
    crossings = t[1:][(signal[:-1] < 0.0) & (signal[1:] >= 0.0)]
    middle = 0.5 * (crossings[1:] + crossings[:-1])
    counted = 1.0 / np.diff(crossings)
    inside = (middle > 3.0) & (middle < 21.0)
    assert counted[inside] == pytest.approx(chirp.frequency(middle[inside]), rel=0.02)


@pytest.mark.parametrize("axis", CHIRP_AXES)
def test_chirps_move_their_axis_only(axis):
    chirp = Chirp(axis, 0.05, start_hz=1.0, stop_hz=4.0, seconds=5.0, fade=1.0)
    sure = Sensors(navigation=Navigation(position=0.0, velocity=0.0, tilt=0.0, yaw=0.0))
    flight = fly(setup(Wait(1), chirp, Wait(1), sensors=sure))
    ((start, flown),) = flight.reference.chirps
    during = flight.truth.loc[start + 1.0 : start + flown.duration]
    moved = during[["w_x", "w_y", "w_z"]].std().to_numpy()
    if axis == "throttle":
        assert during["a_d"].std() > 0.3
        assert moved.max() < 0.03
    else:
        assert moved.argmax() == CHIRP_AXES.index(axis)
        assert np.sort(moved)[-2] < 0.2 * moved.max()
