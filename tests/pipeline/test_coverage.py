"""What a flight covered, against the simulator's truth."""

import datetime as dt
import math

import numpy as np
import pytest

import estimation
import logparse
from pipeline.flight.coverage import measure
from pipeline.flight.excitation import word_of
from pipeline.results.coverage import QUANTITIES
from pipeline.results.span import Span
from simulation import elhesasy2024
from simulation.fly import Setup
from simulation.mission import GoTo, Mission, Turn, Wait
from simulation.place import Place, Wind
from simulation.sample_logs import SampleFlight, fly_sample, write_flight


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    """Fly a leg to and fro at 4 m/s, a turn and a climb at 1500 m; give log, trajectory and truth."""
    mission = Mission(
        takeoff=8.0,
        steps=(Wait(3), GoTo(30, 0, 8, 4.0), GoTo(0, 0, 8, 4.0), Turn(90.0), Wait(4), GoTo(0, 0, 18), GoTo(0, 0, 6)),
    )
    sample = SampleFlight(
        name="covered",
        summary="",
        setup=Setup(
            mission=mission,
            place=Place(name="Aosta", lat_deg=45.7, lon_deg=7.3, alt=1500.0),
            vehicle=elhesasy2024.octocopter(),
            wind=Wind(),
            seed=77001,
        ),
        start_utc=dt.datetime(2025, 5, 5, 10, tzinfo=dt.UTC),
    )
    flown = fly_sample(sample)
    path = write_flight(sample, tmp_path_factory.mktemp("coverage"), flown)[0]
    log = logparse.read_log(path)
    trajectory = estimation.estimate(log.tables)
    span = Span(log.flight.start, log.flight.stop)
    return log, trajectory, span, flown, sample


def test_distributions_are_those_of_the_truth(flight):
    log, trajectory, span, flown, sample = flight
    found = measure(log, trajectory, span)
    truth = flown.truth.loc[span.start - sample.boot : span.stop - sample.boot]
    speed = np.hypot(truth["v_n"], truth["v_e"])
    for name, values in {
        "ground_speed": speed,
        "altitude": truth["p_d"].iloc[0] - truth["p_d"],
        "climb_rate": -truth["v_d"],
    }.items():
        known = found.quantities[name]
        step = QUANTITIES[name].step
        for part, quantile in (("p05", 0.05), ("median", 0.5), ("p95", 0.95)):
            assert getattr(known, part) == pytest.approx(values.quantile(quantile), abs=0.35 * step + 0.1)
        assert sum(known.seconds) == pytest.approx(found.seconds, abs=0.15)
    assert found.quantities["density"].median == pytest.approx(sample.setup.place.atmosphere.density_at(8.0), rel=0.01)
    assert sum(seconds for *_, seconds in found.map) == pytest.approx(found.seconds, abs=0.3)


def test_movement_is_told_axis_by_axis(flight):
    log, trajectory, span, flown, sample = flight
    found = measure(log, trajectory, span).excitation
    assert found.acceleration_rms > 5.0 * found.acceleration_noise
    assert found.speed_std[0] > 3.0 * found.speed_std[1], "the leg was flown along the nose"
    assert found.headings == 2, "north, then east; the turn between is too quick to count"
    truth = flown.truth.loc[span.start - sample.boot : span.stop - sample.boot]
    for axis, rate in (("roll", "w_x"), ("pitch", "w_y"), ("yaw", "w_z")):
        # Ten rows a second leave out what is faster than 4 Hz: touching down, mostly.
        assert 0.5 * truth[rate].std() < found.axes[axis].rms < 1.1 * truth[rate].std()


def test_the_log_is_judged(flight):
    health = measure(*flight[:3]).health
    assert health.rates["motors"].rate == pytest.approx(10.0, rel=0.01)
    gps = health.rates["gps"]
    assert (gps.rate, gps.gaps) == (pytest.approx(5.0, rel=0.01), 0)
    assert gps.longest_gap == pytest.approx(0.2, abs=0.05)
    assert health.gps.fix_share == 1.0
    assert 0.1 < health.position_sigma.median < 1.5
    assert health.battery.start > health.battery.lowest > 10.0


def test_without_a_rigid_body_the_wind_is_unknown_and_said_so(flight):
    found = measure(*flight[:3])
    assert found.wind is None
    assert "airspeed" not in found.quantities
    assert "rigid body" in found.missing["airspeed"]


def test_where_the_wind_comes_from():
    from pipeline.results.coverage import MeanWind

    assert MeanWind.towards(-1.0, 0.0, 0.1, "").direction == 0.0
    assert MeanWind.towards(0.0, -2.0, 0.1, "").direction == pytest.approx(math.pi / 2)
    assert [word_of(x) for x in (0.1, 0.7, 2.0, 9.0)] == ["none", "weak", "fair", "strong"]
