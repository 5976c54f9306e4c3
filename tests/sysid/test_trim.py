"""What belongs to a flight and not to the craft: its thrust scale, its wind and how that grows with height."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from simulation.elhesasy2024 import octocopter
from simulation.place import Wind
from sysid import validate
from sysid.records.motor_scaling import curve, motor_commands, motor_pwm
from sysid.rigid_body.body_motion import LAG, THETA, motion
from sysid.rigid_body.carried import STATES, carry_states
from tests.sysid.craft_flights import RATE, fitted, flown, record


@cache
def other(name="other", seed=3):
    return record(
        flown(octocopter(), wind=Wind(speed=3.0, from_deg=80.0, gusts=0.3), altitude=1500.0, seed=seed, rate=RATE),
        np.random.default_rng(seed),
        name=name,
    )


def with_commands(seen, factor):
    """Scale the commands by which a flight was flown, and give the thrust scale that makes up for it."""
    vehicle, expo = seen.vehicle, fitted().value("thrust_expo")
    command = motor_commands(seen.u, vehicle)
    scale = float(np.mean(curve(command, expo)) / np.mean(curve(factor * command, expo)))
    return replace(seen, u=np.asarray(motor_pwm(factor * command, vehicle)), name=f"load {factor}"), scale


def test_the_thrust_scale_of_another_load_is_found():
    """Within 1 %, a second ahead within 2 cm, and named where it is beyond what air temperature explains.

    Prior knowledge of +- 3.5 % outvoted the data before: commands 7 % lower left the scale at 0.9994 instead of 1.115.
    """
    seen, scale = with_commands(other(), 0.85)
    model = fitted()
    for seconds in (30.0, None):
        trim = model.trim(seen, seconds)
        assert trim.thrust_scale == pytest.approx(scale, rel=0.01)
    result = validate(model, [seen], horizons=(1.0,))
    vertical = result.horizons.set_index("output").loc["z", "rmse"]
    assert vertical < 0.02
    assert [finding.id for finding in result.findings] == ["thrust-differs"]
    assert not validate(model, [other()], horizons=()).findings


def sheared(exponent, seed, speed=5.0):
    """Return a flight whose path follows the equations of motion, in wind that grows with height by a power law."""
    seen, model = replace(other(seed=seed), name=f"exponent {exponent}, {seed}"), fitted()
    flight = motion(seen, seen.vehicle, model.reference_voltage)
    theta, shapes = model.kernel_inputs(flight, model.flights["flight"])
    theta[LAG + 1], rng = exponent, np.random.default_rng(seed)
    towards = rng.uniform(0.0, 2.0 * np.pi)
    shapes = np.ascontiguousarray(np.tile([speed * np.cos(towards), speed * np.sin(towards)], (len(flight.t), 1)))
    ground = flight.ground
    for _ in range(4):  # where the ground is follows from the path
        states = replace(flight, ground=ground).run(theta, shapes, model.law)
        ground = max(states[0, 2], states[-1, 2])
    context = seen.context.assign(
        **{f"v_{axis}": states[:, 3 + k] + 0.01 * rng.standard_normal(len(states)) for k, axis in enumerate("ned")},
        height=ground - states[:, 2],
    )
    y = states[:, :3] * [1.0, 1.0, -1.0] + 0.005 * rng.standard_normal((len(states), 3))
    return replace(seen, y=y - y[0], context=context)


def test_every_flight_has_its_own_wind_profile():
    """The exponent is found of a day with shear and of one without, by a model of either's craft.

    Shared among the flights of a craft, an exponent of 0.45 made the next day's free run err by tens of metres.
    """
    model = fitted()
    assert "wind_exponent" not in model.parameters
    for exponent, seed in ((0.45, 5), (0.0, 6), (0.25, 7)):
        seen = sheared(exponent, seed)
        trim = model.trim(seen)
        assert abs(trim.wind_exponent - exponent) < max(3.0 * trim.wind_exponent_sigma, 0.05)
        assert max(validate(model.trimmed([seen]), [seen], horizons=()).average.values()) < 1.0


def test_the_profile_counts_from_the_ground_wherever_a_record_begins():
    seen = sheared(0.45, 5)
    later = seen.window(seen.t[0] + 20.0, seen.t[-1] - 15.0)
    trim = fitted().trim(later)
    assert later.context["height"].iloc[[0, -1]].min() > 5.0
    assert abs(trim.wind_exponent - 0.45) < 0.05


def test_a_trim_is_no_better_known_than_the_drag_that_it_goes_by():
    """Drag of a craft that is 10 % off takes the wind with it: seven standard errors of the filter."""
    seen, model = other(), fitted()
    drags = [name for name in model.parameters if name.startswith("drag")]
    places = [model.estimated.index(name) for name in drags]
    covariance = model.covariance.copy()
    values = np.array([model.value(name) for name in drags])
    covariance[places], covariance[:, places] = 0.0, 0.0
    covariance[np.ix_(places, places)] = 0.01 * np.outer(values, values)
    off = {name: replace(model.parameters[name], used=1.1 * model.value(name)) for name in drags}
    right = model.trim(seen)
    trim = replace(model, covariance=covariance, parameters={**model.parameters, **off}).trim(seen)
    error = np.hypot(trim.wind_n - right.wind_n, trim.wind_e - right.wind_e)
    assert 0.3 * trim.wind_sigma < error < 2.0 * trim.wind_sigma
    assert trim.thrust_scale_sigma < 0.01


def test_the_beginning_of_a_flight_contradicts_wrong_drag():
    """Drag 20 % too high, known to 20 %: half a minute at several speeds tells, and the drift band need not hold it."""
    seen, model = other(), fitted()
    flight = motion(seen, seen.vehicle, model.reference_voltage)
    drags = np.array([name.startswith("drag_linear") for name in THETA])
    right = np.array([model.value(name) for name in THETA])
    wrong, doubt = np.where(drags, 1.2 * right, right), np.diag(np.where(drags, 0.2 * right, 0.0) ** 2)
    carried = carry_states(flight.cut(0, round(30.0 / flight.dt)), wrong, model.law, craft_covariance=doubt)
    left = (carried.craft[-1] + wrong - right)[drags]
    sigma = np.sqrt(np.diag(carried.covariances[-1])[STATES:][drags])
    assert (sigma[:2] < 0.15 * right[drags][:2]).all()
    assert (np.abs(left) < 3.0 * sigma).all()


def test_a_free_run_is_free_from_where_its_trim_has_looked_at():
    """The first 30 s tell the wind; from there on nothing measured is used, and the score begins there."""
    seen, model = other(), fitted()
    trimmed_flight = model.trimmed([seen], seconds=30.0)
    assert trimmed_flight.initial_seconds(seen) == pytest.approx(30.0, abs=0.1) == model.initial_seconds(seen)
    at = int(np.searchsorted(seen.t, trimmed_flight.flights["other"].looked_until))
    run = trimmed_flight.simulate(seen)
    np.testing.assert_allclose(run[at], seen.y[at], atol=1e-9)
    changed = replace(seen, y=np.where(np.arange(len(seen.t))[:, None] > at, seen.y + 100.0, seen.y))
    np.testing.assert_array_equal(trimmed_flight.simulate(changed), run)


def test_predictions_use_nothing_of_what_comes_after():
    """Wind and thrust scale are carried forward causally: what follows a restart does not change its prediction."""
    seen, model = other(), fitted()
    whole = model.predict(seen, 2.0, every=10)
    # All but the last sample, which tells where the ground is.
    later = (seen.t > seen.t[0] + 50.0) & (seen.t < seen.t[-1])
    changed = replace(
        seen,
        name="changed",
        y=seen.y + np.where(later, 30.0, 0.0)[:, None],
        context=seen.context.assign(v_n=seen.context["v_n"] + np.where(later, 4.0, 0.0)),
    )
    predicted = model.predict(changed, 2.0, every=10)
    steps = round(2.0 / seen.dt)
    restarts = np.arange(10, np.flatnonzero(later)[0], 10)
    np.testing.assert_allclose(predicted[restarts + steps], whole[restarts + steps], atol=1e-9)


def test_gusts_are_followed():
    """In gusts, 1 to 5 s ahead, carried states err at least 10 % less than the mean wind of the beginning."""
    model = fitted()
    errors = []
    for seed in (11, 13):
        gusty = record(
            flown(octocopter(), wind=Wind(speed=6.0, from_deg=30.0 * seed, gusts=1.0), seed=seed, rate=RATE),
            np.random.default_rng(seed),
            name=f"gusty {seed}",
        )
        flight, trim = motion(gusty, gusty.vehicle, model.reference_voltage), model.trim(gusty, 30.0)
        theta, shapes = model.kernel_inputs(flight, trim)
        for horizon in (1.0, 2.0, 5.0):
            steps = round(horizon / gusty.dt)
            carried = model.predict(gusty, horizon, every=10) - gusty.y
            starts = np.arange(round(30.0 / gusty.dt) // 10 * 10, len(gusty.t) - steps, 10)
            held = [
                flight.run(theta, shapes, model.law, int(k), int(k) + steps + 1)[-1, :3] - flight.position[k + steps]
                for k in starts
            ]
            errors.append((np.sqrt(np.mean(carried[starts + steps] ** 2)), np.sqrt(np.mean(np.square(held)))))
    ratio = np.array(errors).T[0] / np.array(errors).T[1]
    assert np.exp(np.mean(np.log(ratio))) < 0.9
