"""What is learned from the rest of a model is kept only where held-out records gain; trim is not taken for wind."""

from dataclasses import replace

import numpy as np
import pytest

from sysid import ExperimentError, estimate_trim, estimate_wind
from sysid.rigid_body.six_dof import learning
from sysid.rigid_body.six_dof.fit import fit_six_dof
from sysid.rigid_body.six_dof.learning import choose_observer, learn_correction
from tests.sysid.six_dof import flown

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def flights():
    return [flown.experiment(flown.fly(16.0, seed), f"flight {seed}", seed) for seed in range(1, 5)]


@pytest.fixture(scope="module")
def fitted(flights):
    return fit_six_dof(flights, indoors=True, most_runs=400, horizons=(0.1, 0.3))


def errors(model, experiment, horizon=0.3):
    record = model.record(experiment)
    predicted = model.predict_states(experiment, horizon)
    return np.sqrt(np.mean((predicted - record.states)[60:, :3] ** 2))


def test_errors_at_random_gain_nothing_and_those_by_a_feature_do():
    """120 rows for 40 features: an unchecked regression would learn the noise by heart and call it a third better."""
    rng = np.random.default_rng(3)
    table = [np.column_stack([rng.standard_normal((30, 39)), np.ones(30)]) for _ in range(4)]
    noise = [rng.standard_normal((30, 5, 4, 3)) for _ in range(4)]
    assert max(learning.gains_of_order(table, noise, (0, 1, 2, 3), 1e-3)) < 0.0
    answers = [goal + 20.0 * x[:, 0, None, None, None] for goal, x in zip(noise, table, strict=True)]
    assert min(learning.gains_of_order(table, answers, (0, 1, 2, 3), 1e-3)) > 50.0


def test_a_force_that_the_model_lacks_is_learned_and_held_out_flights_gain(flights, fitted):
    lame = replace(fitted, theta=fitted.theta * np.r_[np.ones(4), np.zeros(6), np.ones(17)])  # no drag
    learned = learn_correction(lame, flights[:3], 0.3)
    assert learned.correction is not None
    assert learned.correction.gain_percent["position"] > 20.0
    assert errors(learned, flights[3]) < 0.8 * errors(lame, flights[3])


def test_thrust_that_fades_is_found_where_no_voltage_is_logged():
    """Commands that grow by 0.1 % a second for the same lift, as on a real tail-sitter: 0.1 m/s^2 in ten seconds."""
    drift = -1e-3
    flights = [flown.fly(25.0, seed, shake=5.0) for seed in range(11, 15)]
    records = [flown.commanded(flight, f"flight {k}", k, drift) for k, flight in enumerate(flights)]
    model = fit_six_dof(records[:3], indoors=True, most_runs=300, horizons=(0.2, 0.5, 1.0), attitude="measured")
    parameter = model.parameters["thrust_drift"]
    assert parameter.value == pytest.approx(drift, abs=3.0 * parameter.sigma)
    assert parameter.sigma < 1e-4
    slope = np.polyfit(model.record(records[3]).t[1:], model.missed(model.record(records[3]))[1:, 2], 1)[0]
    assert abs(slope) < 1.5e-3  # 0.01 without the drift


@pytest.fixture(scope="module")
def batteries():
    """Fit three flights in 4 m/s of known wind, whose batteries are full, half full, and nearly empty."""
    charges, wind = {"full": 1.08, "half": 1.0, "low": 0.92}, (4.0, 0.0)
    records = [
        flown.commanded(flown.fly(14.0, 31 + k, wind=wind), name, k, charge=charge)
        for k, (name, charge) in enumerate(charges.items())
    ]
    model = fit_six_dof(
        records, winds=dict.fromkeys(charges, wind), most_runs=300, horizons=(0.2, 0.6), attitude="measured"
    )
    return model, records, charges


def test_batteries_that_are_not_equally_full_are_told_apart_by_their_thrust(batteries):
    """Where one thrust stood for all, commands that hover on an empty battery bent the curve of thrust."""
    model, _, charges = batteries
    assert model.shape.charges == pytest.approx(charges, abs=0.01)
    assert abs(model.value("thrust_offset")) < 0.3
    assert abs(model.value("thrust_drift")) < 3.0 * model.parameters["thrust_drift"].sigma
    # Commands are of twice the speed of hover, and a motor carries a quarter.
    assert model.value("thrust") / model.shape.scale == pytest.approx(flown.GRAVITY, rel=0.02)


def test_a_full_battery_is_no_wind(batteries):
    """A craft that leans into 6 m/s with 8 % more thrust than the model knows: it was 0.4 m/s less wind."""
    model, *_ = batteries
    wind = np.array([6.0, 0.0])
    record = flown.commanded(flown.fly(20.0, 41, wind=wind), "unseen", 41, charge=1.08)
    track = estimate_wind(model, record)
    assert np.abs(track.mean - wind).max() < 0.15
    assert np.abs(np.median(track.wind, axis=0) - wind).max() < 0.15


def test_how_full_a_battery_is_is_remembered_as_on_records_that_were_not_fitted(batteries):
    """On the records fitted it is known: chosen on those as they are, an observer would gain nothing."""
    model, records, _ = batteries
    watching = choose_observer(model, records, 1.0)
    assert watching.observer.lift_memory > 0.0
    wind = (4.0, 0.0)
    unseen = flown.commanded(flown.fly(20.0, 43, wind=wind), "unseen", 43, charge=1.08)
    both = (body.with_wind({"unseen": np.array(wind)}) for body in (model, watching))
    plain, held = (body.predict(unseen, 1.0)[400:, 2] for body in both)
    truth = unseen.y[400:, 2]
    assert np.abs(held - truth).mean() < 0.4 * np.abs(plain - truth).mean()
    # One record cannot show how another differs: what is known of batteries does.
    assert choose_observer(model, records[1], 1.0).observer.lift_memory > 0.0


def test_the_rest_of_a_flight_has_the_wind_and_the_battery_of_its_first_part():
    """The rest was flown in still air with a battery as full as before: half a metre of wind after a second."""
    flight = flown.commanded(flown.fly(30.0, 51, wind=(4.0, 0.0), shake=5.0), "flight", 51, drift=-2e-3)
    first, rest = flight.split(0.7)
    model = fit_six_dof(first, most_runs=200, horizons=(0.3, 0.8), attitude="measured")
    errors = {
        name: (body.predict(rest, 1.0) - rest.y)[150:].mean(axis=0)
        for name, body in (("alone", model), ("rest", model.with_rest(first, rest)))
    }
    assert abs(errors["alone"][0]) > 0.3
    assert np.abs(errors["rest"]).max() < 0.05


def test_air_that_still_moves_at_first_is_no_trim(fitted):
    """The fans of a tunnel stopped just before the flight: 2 m/s that decay within five seconds."""
    moving = flown.fly(40.0, 9, wind=np.outer(2.0 * np.exp(-np.arange(4000) / 500.0), [1.0, 0.0]))
    assert np.abs(estimate_trim(fitted, flown.experiment(moving, "still", 9))).max() < 0.03


def test_an_observer_remembers_as_long_as_predicts_best(fitted):
    """Wind that the model does not know pushes for seconds: to remember it predicts better than not to."""
    windy = [flown.experiment(flown.fly(16.0, seed, wind=(2.0, 1.0)), f"windy {seed}", seed) for seed in (21, 22)]
    watching = choose_observer(fitted, windy, 1.0)
    assert watching.observer.force_memory > 0.0
    assert errors(watching, windy[0], 1.0) < 0.7 * errors(fitted, windy[0], 1.0)
    with pytest.raises(ExperimentError, match="no record"):
        choose_observer(fitted, windy, 9.0)


def test_one_record_is_too_few_to_accept_a_correction(flights, fitted):
    with pytest.raises(ExperimentError, match="two at least"):
        learn_correction(fitted, flights[0], 0.3)


def test_trim_is_found_in_still_air_and_is_not_taken_for_wind(fitted):
    """A craft whose thrust leans by 0.02 rad more than that of the flights fitted, in still air and in 4 m/s."""
    wind = np.array([4.0, 0.0])
    leaning = replace(fitted, theta=fitted.theta + np.r_[0, 0, 0.02, np.zeros(24)])
    still = flown.experiment(flown.fly(20.0, 7), "still", 7)
    blown = flown.experiment(flown.fly(20.0, 8, wind=wind), "blown", 8)
    trim = estimate_trim(leaning, still)
    assert trim[0] == pytest.approx(-0.02 * 9.81, abs=0.03)
    plain, tared = estimate_wind(leaning, blown), estimate_wind(leaning, blown, trim=trim)
    assert abs(plain.mean[0] - 4.0) > 0.25
    assert np.abs(tared.mean - wind).max() < 0.15
