"""Acceptance on logs of the firmware in its own simulator, with truth in the log: the autopilot's EKF3 is to be beaten.

Position truth there is relative to where the simulator started, the estimates to the EKF's origin: the constant between
the two is not judged. Only airborne time counts.
"""

import numpy as np
import pytest

from benchmarks.estimation import pooled, squares_of
from benchmarks.trust import airborne_truth, errors_from
from core.attitude import matrix_from_quat
from core.units import STANDARD_GRAVITY
from estimation import errors, estimate
from logparse import read_log
from tests.paths import SITL

needs_logs = pytest.mark.skipif(not SITL.is_dir(), reason="needs the shared logs in ../shared/logs/sitl")


@pytest.fixture(scope="module")
def judged(sitl):
    """RMS errors pooled over one log in six, by measure: of the smoother, of the plain filter and of EKF3.

    `benchmarks estimation` has them over all logs.
    """
    return pooled(sitl(path.stem) for path in sorted(SITL.glob("*.BIN"))[::6])


@needs_logs
@pytest.mark.slow
def test_smoother_and_plain_filter_beat_the_autopilots_filter(judged):
    """Pooled over the logs: better everywhere, the smoother at most at 0.6 times its error in velocity and attitude."""
    ratio = judged["smoother"] / judged["EKF3"]
    assert (ratio < 1.0).all(), ratio
    assert (ratio.drop(["horizontal position, m", "vertical position, m"]) < 0.6).all(), ratio
    # Even without the future.
    assert (judged["plain filter"] < judged["EKF3"]).all(), judged


@needs_logs
@pytest.mark.slow
def test_telemetry_is_near_the_truth_of_the_matching_log():
    truth = airborne_truth(read_log(SITL / "quad06_auto.BIN"))
    trajectory = estimate(read_log(SITL / "quad06_auto.tlog").tables)
    assert trajectory.method == "low-rate"
    assert np.sqrt(squares_of(errors_from(trajectory, truth), {"place": ("p_n", "p_e", "p_d")})["place"]) < 0.12
    states = trajectory.states
    R = matrix_from_quat(states[["q_w", "q_x", "q_y", "q_z"]].to_numpy())
    acceleration = np.einsum("nij,nj->ni", R, states[["f_x", "f_y", "f_z"]].to_numpy())
    acceleration[:, 2] += STANDARD_GRAVITY
    velocity = truth[["v_n", "v_e", "v_d"]].dropna()
    true = np.gradient(velocity.to_numpy(), velocity.index.to_numpy(), axis=0)
    differences = np.column_stack([np.interp(velocity.index, states.index, column) for column in acceleration.T])
    assert np.sqrt(np.mean((differences - true) ** 2, axis=0)).max() < 0.17


@pytest.mark.slow
def test_the_receivers_lag_is_found_under_chirps(unpacked):
    """A fix that a lag moved out of the window outweighed the lag: 17 ms were taken for 0, and height NEES was 16."""
    log = read_log(unpacked("pairs/octa8_g2"))
    trajectory = estimate(log.tables, rate=10.0)
    assert trajectory.diagnostics["lags"]["gps"] == pytest.approx(-0.017, abs=0.004)
    error = errors(trajectory, airborne_truth(log))["p_d"].dropna()
    error -= error.median()
    sigma = np.interp(error.index, trajectory.sigma.index, trajectory.sigma["p_d"])
    assert np.sqrt(np.mean((error / sigma) ** 2)) < 1.5
