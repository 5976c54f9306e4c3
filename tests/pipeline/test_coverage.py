"""What flights covered, against the simulator's truth, and which held-out ones leave it."""

import dataclasses
import datetime as dt
import json
import math

import numpy as np
import pytest

import estimation
import logparse
from core.quantity import readable
from core.serialization import plain
from pipeline.fleet.envelope import envelope
from pipeline.flight.account import account_of_flight
from pipeline.flight.coverage import measure, word_of
from pipeline.results.coverage import QUANTITIES
from pipeline.results.span import Span
from simulation import elhesasy2024
from simulation.fly import Setup
from simulation.mission import GoTo, Mission, Turn, Wait
from simulation.place import Place, Wind
from simulation.sample_logs import SampleFlight, fly_sample, write_flight
from tests.pipeline.builders import covering, flown
from tests.pipeline.coverages import coverage_of


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
    coverage = measure(log, trajectory, span)
    truth = flown.truth.loc[span.start - sample.boot : span.stop - sample.boot]
    speed = np.hypot(truth["v_n"], truth["v_e"])
    for name, values in {
        "ground_speed": speed,
        "altitude": truth["p_d"].iloc[0] - truth["p_d"],
        "climb_rate": -truth["v_d"],
    }.items():
        known = coverage.quantities[name]
        step = QUANTITIES[name].step
        for part, quantile in (("p05", 0.05), ("median", 0.5), ("p95", 0.95)):
            assert getattr(known, part) == pytest.approx(values.quantile(quantile), abs=0.35 * step + 0.1)
        assert sum(known.seconds) == pytest.approx(coverage.seconds, abs=0.15)
    assert coverage.quantities["density"].median == pytest.approx(
        sample.setup.place.atmosphere.density_at(8.0), rel=0.01
    )
    assert sum(seconds for *_, seconds in coverage.map) == pytest.approx(coverage.seconds, abs=0.3)


def test_movement_is_told_axis_by_axis(flight):
    log, trajectory, span, flown, sample = flight
    excitation = measure(log, trajectory, span).excitation
    assert excitation.acceleration_rms > 5.0 * excitation.acceleration_noise
    assert excitation.speed_std[0] > 3.0 * excitation.speed_std[1], "the leg was flown along the nose"
    assert excitation.headings == 2, "north, then east; the turn between is too quick to count"
    truth = flown.truth.loc[span.start - sample.boot : span.stop - sample.boot]
    for axis, rate in (("roll", "w_x"), ("pitch", "w_y"), ("yaw", "w_z")):
        # Ten rows a second leave out what is faster than 4 Hz: touching down, mostly.
        assert 0.5 * truth[rate].std() < excitation.axes[axis].rms < 1.1 * truth[rate].std()


def test_the_log_is_judged(flight):
    log, _, span, *_ = flight
    account, health = account_of_flight(log, span), measure(*flight[:3]).health
    assert health.rates["motors"].rate == pytest.approx(10.0, rel=0.01)
    gps = health.rates["gps"]
    assert (gps.rate, gps.gaps) == (pytest.approx(5.0, rel=0.01), 0)
    assert gps.longest_gap == pytest.approx(0.2, abs=0.05)
    assert account.gps.fix_share == 1.0
    assert 0.1 < health.position_sigma.median < 1.5
    assert account.battery.start > account.battery.lowest > 10.0


def test_without_a_rigid_body_the_wind_is_unknown_and_said_so(flight):
    coverage = measure(*flight[:3])
    assert coverage.wind is None
    assert "airspeed" not in coverage.quantities
    assert "rigid body" in coverage.missing["airspeed"]


def test_where_the_wind_comes_from():
    from pipeline.results.coverage import MeanWind

    assert MeanWind.towards(-1.0, 0.0, 0.1, "").direction == 0.0
    assert MeanWind.towards(0.0, -2.0, 0.1, "").direction == pytest.approx(math.pi / 2)
    assert [word_of(x) for x in (0.1, 0.7, 2.0, 9.0)] == ["none", "weak", "fair", "strong"]


# What was flown where, together, and which judging flights leave it.


SLOW = np.linspace(0.0, 6.9, 1000)


def test_time_adds_up_over_flights():
    flights = [
        covering("a", ground_speed=SLOW),
        covering("b", ground_speed=SLOW + 2.0),
        covering("c", ground_speed=SLOW),
    ]
    ranges = envelope(flights, ["a", "b"], ["c"])
    speed = ranges.quantities["ground_speed"]
    assert sum(speed.training) == 200.0
    assert sum(speed.held_out) == 100.0
    assert speed.first == 0
    assert ranges.map.training == ((0, 1, 200.0),)
    assert [wind.part for wind in ranges.winds] == ["training", "training", "held-out"]
    edges = speed.step * (speed.first + np.arange(len(speed.training)))
    counts = np.histogram(np.concatenate([SLOW, SLOW + 2.0]), np.append(edges, edges[-1] + speed.step))[0]
    assert np.allclose(speed.training, counts / 10.0, atol=0.06)


def test_leaving_the_fitted_range_is_found_with_its_part_and_reach():
    fast = np.concatenate([np.full(700, 3.0), np.full(300, 14.5)])
    ranges = envelope([covering("a", ground_speed=SLOW), covering("b", ground_speed=fast)], ["a"], ["b"])
    (out,) = ranges.outside
    assert (out.flight, out.quantity, out.fitted) == ("b", "ground_speed", (0.0, 7.0))
    assert (out.part, out.reach) == (0.3, 14.5)
    (finding,) = ranges.findings
    assert finding.id == "outside-fitted-range"
    assert "ground speed up to 14.5 m/s (fitted to 7 m/s) for 30 % of its time" in finding.reason


def test_one_bin_beyond_a_blip_and_a_poor_position_are_no_extrapolation():
    near = np.concatenate([np.full(700, 3.0), np.full(300, 7.5)])
    blip = np.concatenate([np.full(970, 3.0), np.full(30, 20.0)])
    flights = [covering("a", ground_speed=SLOW), covering("b", ground_speed=near), covering("c", ground_speed=blip)]
    assert not envelope(flights, ["a"], ["b", "c"]).outside


def test_a_blip_in_training_fits_nothing():
    """Half a per cent of training time is left out at either end: 0.3 s of 100 s at 20 m/s are no range."""
    training = np.concatenate([SLOW[:997], [20.0] * 3])
    fast = np.full(1000, 19.5)
    ranges = envelope([covering("a", ground_speed=training), covering("b", ground_speed=fast)], ["a"], ["b"])
    assert ranges.quantities["ground_speed"].fitted == (0.0, 7.0)
    assert ranges.outside[0].part == 1.0


def test_ranges_below_are_left_too_and_angles_are_told_in_degrees():
    flights = [
        covering("a", density=np.full(1000, 1.2), tilt=np.full(1000, 0.05)),
        covering("b", density=np.full(1000, 0.9), tilt=np.full(1000, 0.3)),
    ]
    ranges = envelope(flights, ["a"], ["b"])
    assert [out.quantity for out in ranges.outside] == ["density", "tilt"]
    assert "air density down to 0.9 kg/m^3 (fitted from 1.18 kg/m^3)" in ranges.findings[0].reason or (
        "air density down to 0.9 kg/m^3 (fitted from 1.2 kg/m^3)" in ranges.findings[0].reason
    )
    assert "tilt up to 17.2° (fitted to 5°)" in ranges.findings[0].reason
    assert readable("part of full thrust", 0.65) == "65 % of full thrust"
    # Nor where the position is poor.
    lost = covering("b", ground_speed=np.full(900, 25.0))
    lost = dataclasses.replace(lost, coverage=coverage_of(lost.coverage, health={"position_sigma": {"max": 18.0}}))
    assert not envelope([covering("a", ground_speed=SLOW), lost], ["a"], ["b"]).outside
    # How far is told by what was flown, and not by a blip.
    mostly = np.concatenate([np.full(980, 12.5), np.full(20, 30.0)])
    ranges = envelope([covering("a", ground_speed=SLOW), covering("b", ground_speed=mostly)], ["a"], ["b"])
    assert ranges.outside[0].reach == 12.5


def test_flights_without_coverage_leave_no_trace_and_no_error():
    bare = flown("bare")
    assert envelope([bare], ["bare"], []) is None
    ranges = envelope([bare, covering("a", ground_speed=SLOW)], [], ["a", "bare"])
    assert ranges.held_out == ("a",)
    assert ranges.quantities["ground_speed"].fitted is None
    assert not ranges.outside
    json.dumps(plain(ranges), allow_nan=False)
