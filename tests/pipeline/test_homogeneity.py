"""Flights that are pooled are of one load: honest fleets raise nothing, other payloads and craft are named."""

from datetime import UTC, datetime
from types import SimpleNamespace

import numpy as np
import pytest

from logparse.craft.frames import motor_table
from pipeline.fleet.homogeneity import alike_flights, unlike_findings, unlike_flights
from pipeline.flight.summary import BATTERY
from sysid.rotors.steady_trims import SteadyTrims
from tests.pipeline.builders import stated


def entry(name, parameters=(), day=None, trims=None):
    """Return what is read of a flight, at one place."""
    return SimpleNamespace(
        name=name, parameters=parameters, trims=trims, start_utc=day, flight=None, origin=(0.8, 0.15, 400.0), track=()
    )


def fleet(seed, count=8, payload=None, voltage=16.0, changes=None, day=None):
    """Return flights of one craft: air 10 K and battery 3 % different from day to day, errors as they are stated.

    All on one `day`, where it is given: air 4 K, and errors of thrust below 1 %.
    """
    rng = np.random.default_rng(seed)
    flights = []
    for k in range(count):
        mass = 1.0 if payload is None else payload.get(k, 1.0)
        volts = voltage * float(np.exp(0.03 * rng.standard_normal())) * (changes or {}).get(k, 1.0)
        thrust = 8.0 * (volts / 16.0) ** 2 / mass * float(np.exp((0.014 if day else 0.035) * rng.standard_normal()))
        rows = [stated("voltage", volts, 0.1, "V", BATTERY)]
        for parameter, value, part in (
            ("thrust over mass", thrust, float(rng.uniform(0.003, 0.01 if day else 0.05))),
            ("roll inertia over mass and arm", 0.03 / mass, float(rng.uniform(0.01, 0.1))),
            ("yaw torque over inertia", 12.0, float(rng.uniform(0.02, 0.2))),
        ):
            measured = value * float(np.exp(part * rng.standard_normal()))
            rows.append(stated(parameter, measured, part * measured, "m/s^2"))
        flights.append(entry(f"flight {k}", tuple(rows), day))
    return flights


def test_two_hundred_honest_fleets_raise_hardly_anything():
    """Three questions at 0.1 % each: of 200 fleets at most two may be blamed by chance, of the first 20 none."""
    alarms = [bool(unlike_flights(fleet(seed, count=2 + seed % 12))) for seed in range(200)]
    assert not any(alarms[:20])
    assert sum(alarms) <= 2


def test_odd_flights_of_a_fleet_of_a_thousand_are_named():
    """All windows of sorted values were tried one by one: half a minute, and eight times as long for twice as many."""
    assert list(unlike_flights(fleet(3, count=1000, payload={7: 1.5, 400: 0.6}))) == ["flight 7", "flight 400"]


@pytest.mark.parametrize("count", [20, 50, 200])
def test_one_flight_is_not_lost_among_many(count):
    """A sum over all flights hid one of another payload: of 60 with 1.3 times the mass 23, 4 and 0 were named."""
    named = [list(unlike_flights(fleet(seed, count=count, payload={1: 1.4}))) for seed in range(12)]
    assert sum(names == ["flight 1"] for names in named) >= 11
    assert not any(unlike_flights(fleet(seed, count=count)) for seed in range(12))


@pytest.mark.parametrize("mass", [0.6, 1.5, 2.0])
def test_flights_of_another_payload_are_named(mass):
    for seed in range(10):
        findings = unlike_findings(fleet(seed, payload={1: mass, 4: mass}))
        assert [finding.evidence["flight"] for finding in findings] == ["flight 1", "flight 4"]
        assert {finding.id for finding in findings} == {"flights-not-alike"}


def test_on_one_day_a_tenth_of_payload_is_named():
    """Flights of one day share the air: 10 % of payload had not been named in three of three fleets flown."""
    day = datetime(2025, 6, 1, 12, tzinfo=UTC)
    for mass, least in ((1.1, 17), (0.9, 17), (1.15, 20)):
        named = [list(unlike_flights(fleet(seed, payload={2: mass}, day=day))) for seed in range(20)]
        assert sum(names == ["flight 2"] for names in named) >= least
        assert all(names in ([], ["flight 2"]) for names in named)
    assert not any(unlike_flights(fleet(seed, count=2 + seed % 12, day=day)) for seed in range(60))


def trimmed(rng, frame, loss=None):
    """Return trims of a flight: the craft's own, its battery's place, and a motor that gives the part `loss` less."""
    motors = motor_table(*frame)
    factors = np.array([[motor.roll, motor.pitch, motor.yaw] for motor in motors])
    basis = np.linalg.qr(factors - factors.mean(axis=0))[0]
    own = np.array([0.1, -0.2, 0.05]) + 0.005 * rng.standard_normal(3)
    if loss is not None:
        own = own + loss * basis[1]
    return SteadyTrims(
        tuple(f"m{motor.number}" for motor in motors), tuple(own), (1e-5,) * 3, tuple(map(tuple, basis.tolist()))
    )


@pytest.mark.parametrize("frame", [("quad", "x"), ("hexa", "plus"), ("octa", "x"), ("y6", None), ("octa-quad", "x")])
def test_a_flight_in_which_one_motor_gives_a_fifth_less_or_more_is_named(frame):
    named = {0.2: 0, -0.25: 0}
    for seed in range(20):
        rng = np.random.default_rng(seed)
        sound = [entry(f"flight {k}", trims=trimmed(rng, frame)) for k in range(5)]
        assert not unlike_flights(sound)
        for loss in named:
            odd = unlike_flights([*sound, entry("odd", trims=trimmed(rng, frame, loss))])
            assert list(odd) in ([], ["odd"])
            named[loss] += bool(odd)
            assert not odd or abs(odd["odd"].ratio - 1.0) == pytest.approx(abs(loss), abs=0.08)
    assert named[0.2] >= 15
    assert named[-0.25] >= 19


def test_a_fuller_battery_is_not_another_craft_but_twice_the_voltage_is():
    """3 kg at 12.6 V and 8 kg at 25.2 V hover at the same command: at one voltage their thrust over mass differs."""
    assert not unlike_flights(fleet(1, changes=dict.fromkeys((0, 3), 1.12)))
    heavy = fleet(2, count=3, voltage=25.2, payload=dict.fromkeys(range(3), (25.2 / 12.6) ** 2))
    mixed = [
        *fleet(3, count=4, voltage=12.6),
        *(SimpleNamespace(**{**vars(f), "name": f"heavy {f.name}"}) for f in heavy),
    ]
    assert sorted(unlike_flights(mixed)) == [f"heavy flight {k}" for k in range(3)]


def test_flights_of_each_payload_are_pooled_among_themselves():
    """Five flights as built, three with a camera, two with a heavier one: three sets; five flights were lost before."""
    payload = dict.fromkeys((1, 4, 7), 1.6) | dict.fromkeys((2, 8), 2.6)
    for seed in range(10):
        sets = alike_flights(fleet(seed, count=10, payload=payload))
        assert [[int(flight.name.split()[1]) for flight in part] for part in sets] == [
            [0, 3, 5, 6, 9],
            [1, 4, 7],
            [2, 8],
        ]
    assert [len(part) for part in alike_flights(fleet(1, count=7))] == [7]
    assert alike_flights([]) == []
    assert not unlike_flights([entry("a"), entry("b")]), "nothing known is no reason"
