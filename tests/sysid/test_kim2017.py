"""Output error of Kim 2017 on its own craft and on an octocopter, against known truth and the form of its tables."""

from dataclasses import replace

import numpy as np
import pytest

from logparse import MissingDataError
from simulation import kim2017 as paper
from simulation.elhesasy2024 import octocopter
from sysid.records.experiment import ExperimentError
from sysid.records.thrust_curve import Law
from sysid.rotors.kim2017 import fit_kim2017
from tests.sysid.craft_flights import disturbed, flight, without

THRUST = paper.THRUST_COEFFICIENTS[-1]
TORQUE = float(paper.TORQUE_COEFFICIENTS[-1].mean())


def craft():
    """Return the paper's craft at 16 V, its inertia a hundredth of the print (see the seeds: impossible for 2.6 kg)."""
    made = paper.quadcopter(16.0)
    return replace(made, inertia=made.inertia / 100.0)


INERTIA = tuple(np.diag(craft().inertia))
BENCH = {f"m{k + 1}": float(value) for k, value in enumerate(THRUST)} | {"torque": TORQUE}


@pytest.fixture(scope="module")
def quad():
    return flight(craft(), 1)


def test_thrust_of_each_motor_and_mean_torque(quad):
    """Table 6: the stand's coefficients of four unequal motors come back within 2 standard errors and 3 %.

    The paper found them 35 % off and torque four times too large; motors' unequal torques are what bends it.
    """
    model = fit_kim2017([quad], 2.6, inertia=INERTIA, arm=0.4, bench=BENCH)
    table = model.thrust_table()
    assert (np.abs(table["ratio"] - 1.0) < 0.03).all()
    assert (np.abs(table["flight_test"] - table["test_stand"]) < 2.0 * table["sigma"]).all()
    torque = model.torque_table().iloc[0]
    assert torque["test_stand"] == pytest.approx(0.992e-6, rel=0.002)
    assert torque["ratio"] == pytest.approx(1.0, abs=0.03)
    assert list(table.index) == ["m1", "m2", "m3", "m4"]


def test_without_inertia_the_levers_are_fitted_too(quad):
    model = fit_kim2017([quad], 2.6)
    truth = [0.4 * 2.6 / INERTIA[0], 0.4 * 2.6 / INERTIA[1]]
    assert model.lever == pytest.approx(truth, rel=0.005)
    assert [motor.newton for motor in model.per_motor.values()] == pytest.approx(list(THRUST), rel=0.03)
    assert model.torque_per_inertia == pytest.approx(TORQUE / INERTIA[2], rel=0.03)
    assert model.torque is None


def test_residual_simulation_of_another_part(quad):
    """The paper's figure 15: rates of unseen flight from rotor speeds alone, 20 s open loop."""
    model = fit_kim2017([quad], 2.6, inertia=INERTIA, arm=0.4)
    check = model.verify(flight(craft(), 2, duration=20.0))
    assert (check["rmse"][["w_x", "w_y", "w_z"]] < 0.1 * check["rmse_of_mean"][["w_x", "w_y", "w_z"]]).all()
    assert check.loc["z", "rmse"] < check.loc["z", "rmse_of_mean"]


@pytest.fixture(scope="module")
def octo():
    return flight(octocopter(), 1)


def test_eight_motors_driven_by_four_commands_are_not_told_apart(octo):
    model = fit_kim2017([octo], 4.3)
    assert model.common.newton == pytest.approx(1.105e-5, rel=0.03)
    assert not any(value.determined for value in model.per_motor.values())
    assert "independent signals" in model.per_motor["m1"].reason
    assert model.lever[0] == pytest.approx(0.35 * 4.3 / 0.06006, rel=0.01)
    assert model.torque_per_inertia == pytest.approx(1.779e-7 / 0.105, rel=0.03)


def test_esc_numbers_that_are_the_command_are_no_rotor_speeds(octo):
    """ArduPilot's simulator reports command times a constant: thrust must not be taken for its square."""
    command = (octo.u - 1150.0) / 800.0
    context = octo.context.assign(**{f"rotor_speed_{k + 1}": 700.0 * command[:, k] for k in range(8)})
    model = fit_kim2017([replace(octo, context=context)], 4.3)
    assert model.law is Law.COMMAND
    assert model.common.newton == pytest.approx(1.105e-5 * 1050.0**2, rel=0.03)


def test_standard_errors_agree_with_monte_carlo():
    """Twenty times other noise on one flight without drag (which eq. 3 has not); their spread scatters by 16 %."""
    still = replace(octocopter(), drag_linear=(0.0, 0.0, 0.0), drag_area=(0.0, 0.0, 0.0))
    clean = flight(still, 1, noise=0.0)
    models = [fit_kim2017([disturbed(clean, np.random.default_rng(seed))], 4.3) for seed in range(20)]
    levers = np.array([model.lever for model in models])
    claimed = np.sqrt(np.mean([np.square(model.lever_sigma) for model in models], axis=0))
    assert np.std(levers, axis=0, ddof=1) == pytest.approx(claimed, rel=0.35)


def test_bad_input(quad):
    hover = flight(craft(), 3, duration=20.0, strength=0.0)
    model = fit_kim2017([hover], 2.6)
    assert model.torque_per_inertia is None
    assert not any(value.determined for value in model.per_motor.values())
    with pytest.raises(MissingDataError, match="where motor"):
        fit_kim2017([replace(quad, vehicle=None)])
    with pytest.raises(MissingDataError, match="angular rates"):
        fit_kim2017([without(quad, "w_x")])
    with pytest.raises(ExperimentError, match="inertia must be positive"):
        fit_kim2017([quad], 2.6, inertia=(0.0, 1.0, 1.0), arm=0.4)
    wrong = BENCH | {"m2": 5.0e-5}
    assert fit_kim2017([quad], 2.6, bench=wrong).thrust_table().loc["m2", "ratio"] < 0.8
