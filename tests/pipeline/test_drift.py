"""Parameters over flights, by closed forms and false alarms at their rate; a motor that weakens."""

import dataclasses

import numpy as np
import pytest
from scipy import stats

from logparse.craft.frames import motor_table
from pipeline.fleet.drift import follow
from pipeline.fleet.meta_analysis import ALPHA, holm, meta_regression
from pipeline.results.account import Account, MotorsReading
from pipeline.results.drift import Step, Trend
from tests.pipeline.builders import FRAMES, hovering, stated
from tests.pipeline.histories import CRAFT, flights_of, series


def history_of(drift, parameter):
    return next(history for history in drift.parameters if history.parameter == parameter)


def test_false_alarms_keep_to_the_rate_for_the_whole_craft():
    """300 crafts of 4 to 14 flights, nothing changes: at most 5 % have any alarm at all, 15 of 300; 25 is 3 sigma."""
    random = np.random.default_rng(20261121)
    alarmed = sum(
        any(
            parameter.change is not None
            for parameter in follow(flights_of(series(random, int(random.integers(4, 15))))).parameters
        )
        for _ in range(300)
    )
    assert alarmed <= 25


def test_a_drift_is_found_with_its_power_and_size():
    """Thrust falls by 1 % per flight over ten flights that differ by 1.2 %: nearly always found, never another."""
    random = np.random.default_rng(4)
    sizes = []
    for _ in range(40):
        drift = follow(flights_of(series(random, 10, drift=("thrust over mass", -0.085))))
        history = history_of(drift, "thrust over mass")
        if history.trend.significant:
            sizes.append(history.trend.per_flight)
        assert sum(parameter.change is not None for parameter in drift.parameters if parameter is not history) <= 1
    assert len(sizes) >= 34
    assert np.mean(sizes) == pytest.approx(-0.085, rel=0.1)


def test_a_step_is_found_where_it_is():
    """Other propellers from the seventh of twelve flights on: 8 % more thrust."""
    drift = follow(flights_of(series(np.random.default_rng(5), 12, step=("thrust over mass", 0.68))))
    history = history_of(drift, "thrust over mass")
    assert isinstance(history.change, Step)
    assert (history.change.before, history.change.after) == ("f05", "f06")
    assert history.change.change == pytest.approx(0.68, abs=0.2)
    (finding,) = drift.findings
    assert finding.id == "parameter-drift"
    assert "between f05 and f06 it rose by" in finding.reason
    assert "propellers" in finding.advice


def test_scatter_between_flights_is_told_from_their_own_errors():
    random = np.random.default_rng(6)
    drift = follow(flights_of(series(random, 30)))
    thrust, lag = history_of(drift, "thrust over mass"), history_of(drift, "motor lag")
    assert thrust.between == pytest.approx(0.10, rel=0.35)
    assert thrust.heterogeneity.p < 0.001
    assert "beyond their own errors" in thrust.sentence
    assert lag.between < 0.003
    assert "no more than their own errors" in lag.sentence
    for history, (value, *_) in zip((thrust, lag), (CRAFT["thrust over mass"], CRAFT["motor lag"]), strict=True):
        assert abs(history.mean - value) < 4.0 * history.mean_sigma


def test_dates_order_the_flights():
    values = {"thrust over mass": [(8.5 - 0.1 * k, 0.01) for k in range(6)]}
    flights = flights_of(values, days=2.0)
    renamed = [dataclasses.replace(flight, name=f"z{9 - k}") for k, flight in enumerate(flights)]
    drift = follow(renamed[::-1])
    (history,) = drift.parameters
    assert drift.order == "date"
    assert drift.flights == ("z9", "z8", "z7", "z6", "z5", "z4")
    assert isinstance(history.change, Trend)
    assert history.trend.per_flight == pytest.approx(-0.1)
    assert follow([dataclasses.replace(flight, start_utc=None) for flight in flights]).order == "name"


def test_the_method_that_most_flights_have_is_followed_and_others_are_kept():
    flights = flights_of({"motor lag": [(0.05, 0.001)] * 5})
    other = stated("motor lag", 0.06, 0.0001, "s", "rotor")
    flights = [dataclasses.replace(f, parameters=(*f.parameters, other)) if k < 3 else f for k, f in enumerate(flights)]
    (history,) = follow(flights).parameters
    assert history.method == "rigid body"
    assert [point.value for point in history.others["rotor"]] == [0.06] * 3


def test_few_flights_say_what_they_can():
    assert follow([]) is None
    assert follow(flights_of({"motor lag": [(0.05, 0.001)]})) is None
    (history,) = follow(flights_of({"motor lag": [(0.05, 0.001), (0.052, 0.001)]})).parameters
    assert history.trend is None
    assert "4 flights are needed" in history.sentence
    (constant,) = follow(flights_of({"motor lag": [(0.05, 0.001)] * 5})).parameters
    assert constant.change is None


@pytest.mark.parametrize("frame", list(FRAMES))
def test_a_weakening_motor_is_named(frame):
    """2 % of one motor's thrust per flight over ten flights, in trims that scatter by 0.4 %: 20 crafts, any motor."""
    random = np.random.default_rng(11)
    count = len(motor_table(frame, FRAMES[frame], None))
    named, losses = 0, []
    for k in range(20):
        weak = 1 + k % count
        motors = follow(hovering(random, frame, 10, weak=weak, loss=0.02)).motors
        named += motors.weakening == f"m{weak}"
        if motors.weakening == f"m{weak}":
            losses.append(motors.loss)
            assert f"motor m{weak} is weakening" in motors.sentence
    # The right motor fails a 5 % test of fit about once in twenty.
    assert named >= 17
    assert np.mean(losses) == pytest.approx(0.02, rel=0.1)


def test_motors_that_do_not_weaken_are_not_accused():
    random = np.random.default_rng(12)
    accused = sum(follow(hovering(random, "octa", 10)).motors.weakening is not None for _ in range(100))
    assert accused <= 100 * ALPHA + 3 * (100 * ALPHA * (1 - ALPHA)) ** 0.5


def test_a_moving_centre_of_gravity_is_no_weak_motor():
    drift = follow(hovering(np.random.default_rng(13), "octa", 10, shift=0.02))
    assert drift.motors.weakening is None
    assert "a shift of the centre of gravity explains it" in drift.motors.sentence
    (finding,) = drift.findings
    assert finding.id == "parameter-drift"
    assert "centre of gravity" in finding.reason


def test_two_flights_do_not_tell_of_motors_but_show_how_hard_they_worked():
    flights = hovering(np.random.default_rng(14), "quad", 2)
    work = MotorsReading(mean={"1": 0.3, "2": 0.5, "3": 0.4, "4": 0.4}, hardest="2", at_limit=0.0)
    accounts = Account(flight=None, motors=work), None
    flights = [dataclasses.replace(flight, account=its) for flight, its in zip(flights, accounts, strict=True)]
    motors = follow(flights).motors
    assert "cannot be told" in motors.sentence
    first, second = (point.work for point in motors.points)
    assert first == pytest.approx({"m1": 0.75, "m2": 1.25, "m3": 1.0, "m4": 1.0})
    assert second == {}


# Values of several flights taken together: closed forms, textbook properties, rates of false alarms.


def test_a_binary_moderator_is_the_two_sample_t_test():
    a, b = np.array([1.0, 1.3, 0.9, 1.2]), np.array([1.6, 1.4, 1.9])
    design = np.column_stack([np.ones(7), np.repeat([0.0, 1.0], [4, 3])])
    estimate, sigma, p = meta_regression(np.concatenate([a, b]), np.full(7, 0.01), design).test([0.0, 1.0])
    ordinary = stats.ttest_ind(b, a)
    assert estimate == pytest.approx(b.mean() - a.mean())
    assert estimate / sigma == pytest.approx(ordinary.statistic)
    assert p == pytest.approx(ordinary.pvalue)


def test_a_flight_that_knows_nothing_leaves_the_scatter_of_the_others():
    """Beside errors of 1e-9 and of 1000 the scatter once came out as 297,360."""
    pooled = meta_regression([1.0, 2.0, 4.0, 3.0], [1e-9, 1e-9, 1e-9, 1000.0])
    residuals = np.array([1.0, 2.0, 4.0, 3.0]) - pooled.beta[0]
    assert np.sum(residuals**2 * pooled.weights) == pytest.approx(3.0)
    assert pooled.tau == pytest.approx(np.sqrt(14.0 / 9.0), rel=1e-4), "the sum of squares of 1, 2 and 4, over 3"
    # What cannot be told apart is refused.
    with pytest.raises(ValueError, match="2 values"):
        meta_regression([1.0, 2.0], [0.1, 0.1], [[1.0, 1.0], [1.0, 1.0]])


def test_holm_is_the_textbook_procedure():
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.6, 0.7]) == [1.0, 1.0]
    assert holm([]) == []
