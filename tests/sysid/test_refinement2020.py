"""Refinement 2020 on simulated craft: the stacked fit against truth, the paper's mean beside it, honest silence."""

from dataclasses import replace

import numpy as np
import pytest

from logparse import MissingDataError
from simulation.elhesasy2024 import octocopter
from simulation.kim2017 import quadcopter
from sysid.records.thrust_curve import Law
from sysid.rotors.refinement2020 import fit_refinement2020
from sysid.rotors.refinement_instants import STILL_AIR, mean_of_instants
from sysid.rotors.thrust_regression import blocks_of, unexplained_part
from tests.sysid.craft_flights import disturbed, flight, without

#: The paper's drag: C |v| v on each axis, here 0.0306 N s^2/m^2.
AREA = (0.05, 0.05, 0.05)


def octo():
    return replace(octocopter(), drag_linear=(0.0, 0.0, 0.0), drag_area=AREA)


def truth(craft, arm):
    thrust = np.mean([m.rotor.thrust_coefficient for m in craft.rotors])
    torque = np.mean([m.rotor.torque_coefficient for m in craft.rotors])
    jx, jy, jz = np.diag(craft.inertia)
    specific = craft.mass * arm
    return {
        "k": thrust / craft.mass,
        "C": 0.5 * 1.225 * AREA[0] / craft.mass,
        "Jx": jx / specific,
        "Jy": jy / specific,
        "Jz": jz / specific,
        "b": torque / specific,
        "b/Jz": torque / jz,
    }


@pytest.fixture(scope="module")
def record():
    return flight(octo(), 1, wander=8.0)


def test_stacked_estimates_are_true(record):
    """Within 2 standard errors, or the tenth of a percent that differences over 40 ms err, and within 3 %."""
    model = fit_refinement2020([record], 4.3)
    for name, value in truth(octo(), 0.35).items():
        stacked = model.stacked[name]
        assert stacked.value == pytest.approx(value, rel=0.03), name
        assert abs(stacked.value - value) < 2.0 * stacked.sigma + 1e-3 * value, name


def test_unequal_motors_do_not_bend_the_stacked_fit():
    made = quadcopter(16.0)
    craft = replace(made, inertia=made.inertia / 100.0, drag_area=AREA)
    model = fit_refinement2020([flight(craft, 1, wander=8.0)], 2.6)
    for name, value in truth(craft, 0.4).items():
        assert model.stacked[name].value == pytest.approx(value, rel=0.03), name


def test_the_paper_s_mean_stands_beside_with_its_spread(record):
    """Identical motors, as the paper takes them: means come near; spreads say how far single instants are off."""
    model = fit_refinement2020([record])
    expected = truth(octo(), 0.35)
    assert model.instants["k"].mean == pytest.approx(expected["k"], rel=0.01)
    assert model.instants["Jx"].mean == pytest.approx(expected["Jx"], rel=0.05)
    for name in ("k", "C", "Jx"):
        mean = model.instants[name]
        assert mean.dropped > 0
        assert mean.used > 9


def test_outliers_do_not_move_the_stacked_fit(record):
    context = record.context.copy()
    context.iloc[100::200, context.columns.get_loc("f_z")] += 30.0
    context.iloc[150::200, context.columns.get_loc("w_x")] += 2.0
    model = fit_refinement2020([replace(record, context=context)])
    assert model.stacked["k"].value == pytest.approx(truth(octo(), 0.35)["k"], rel=0.005)


def test_standard_errors_agree_with_monte_carlo():
    """Twenty times other noise on one flight: less what noise does not move (wind, inflow)."""
    clean = flight(octo(), 1, wander=8.0, noise=0.0)
    noisy = [disturbed(clean, np.random.default_rng(k)) for k in range(20)]
    models = [fit_refinement2020([hop]) for hop in noisy]
    parts = np.array([unexplained_part([hop], [blocks_of(hop, hop.vehicle, None, Law.SPEED)]) for hop in noisy])
    for name, air in (("Jx", np.hypot(STILL_AIR, parts)), ("C", 0.0)):
        values = np.array([model.stacked[name].value for model in models])
        sigmas = np.array([model.stacked[name].sigma for model in models])
        claimed = np.sqrt(np.mean(sigmas**2 - (air * values) ** 2))
        assert np.std(values, ddof=1) == pytest.approx(claimed, rel=0.35)


def test_hover_tells_thrust_only():
    model = fit_refinement2020([flight(octo(), 2, duration=20.0, strength=0.0)])
    assert model.stacked["k"].value == pytest.approx(truth(octo(), 0.35)["k"], rel=0.01)
    for name in ("Jx", "Jy", "Jz", "b", "b/Jz"):
        assert model.stacked[name].value is None
        assert model.stacked[name].reason


def test_slow_outputs_and_missing_columns(record):
    slow = np.column_stack([np.interp(record.t, record.t[::5], record.u[::5, k]) for k in range(8)])
    names = [f"rotor_speed_{k}" for k in range(1, 9)]
    model = fit_refinement2020([without(replace(record, u=slow), *names)])
    assert all(model.stacked[name].value is None for name in ("Jx", "b/Jz"))
    assert model.stacked["k"].value is not None
    with pytest.raises(MissingDataError, match="velocity or attitude not known"):
        fit_refinement2020([without(record, "v_n")])


def test_samples_of_one_turn_are_one_instant():
    """Four samples within 0.08 s made an inertia three times too large with a tenth of it as its error."""
    t, kept = np.arange(1000) * 0.02, np.zeros(1000, dtype=bool)
    kept[[500, 501, 502, 504]] = True
    values = np.full(1000, np.nan)
    values[kept] = (0.07, 0.06, 0.075, 0.065)
    mean = mean_of_instants(t, values, kept, "the craft hardly turns")
    assert (mean.mean, mean.used, mean.events) == (None, 4, 1)
    assert "4 instants in 1 stretch of 2 s" in mean.reason


def test_what_motors_do_not_explain_gives_no_inertia(record):
    """Rates that the motors did not make, as wind and slow logs leave them: the paper's mean has no way to tell."""
    rng = np.random.default_rng(3)
    context = record.context.copy()
    for name in ("w_x", "w_y", "w_z"):
        shake = np.convolve(rng.standard_normal(len(context)), np.ones(5) / 5.0, "same")
        context[name] += 0.5 * float(context[name].std()) * shake
    model = fit_refinement2020([replace(record, context=context)])
    for name in ("Jx", "Jz", "b"):
        assert model.instants[name].mean is None, name
        assert "motors explain only" in model.instants[name].reason or "degenerate" in model.instants[name].reason
