"""The telemetry path: accuracy on simulated truth, and its smoother against filterpy's."""

import numpy as np
import pandas as pd
import pytest
from filterpy.kalman import KalmanFilter
from scipy.interpolate import Akima1DInterpolator

from estimation import Trajectory, compare, errors, estimate
from estimation.lowrate import DISTURBANCE, EKF_LASTING, filter_telemetry, transitions
from estimation.states import SensorNoise
from estimation.telemetry import SIZE, Measured, steady_heights
from tests.estimation.simulated_flight import Sensors, fly


def thinned(table, step):
    """Keep one row per `step` seconds, as a telemetry stream does."""
    t = table.index.to_numpy()
    return table[np.concatenate([[True], np.diff(np.floor(t / step)) > 0])]


@pytest.fixture(scope="module")
def flight():
    # A good receiver: what is judged here is the filter.
    return fly(1, duration=90.0, sensors=Sensors(gps_error=(0.05, 0.05, 0.1), gps_white=0.01, gps_speed=0.1))


@pytest.fixture(scope="module")
def telemetry(flight):
    t = flight.tables
    return t.changed(
        imu=None, mag=None, attitude=thinned(t.attitude, 0.25), gps=thinned(t.gps, 0.25), baro=thinned(t.baro, 0.5)
    )


@pytest.fixture(scope="module")
def trajectory(telemetry) -> Trajectory:
    return estimate(telemetry, rate=20.0)


def test_telemetry_at_four_hertz(flight, trajectory):
    assert trajectory.method == "low-rate"
    assert [f.id for f in trajectory.findings] == ["not-logged"]
    rms = compare(trajectory, flight.truth[flight.truth.index > 10.0])
    assert rms.horizontal_position < 0.12
    assert rms.horizontal_velocity < 0.15
    error = errors(trajectory, flight.truth[flight.truth.index > 10.0])
    sigma = trajectory.sigma.reindex(error.index, method="nearest")
    # The position error is one throw of the GPS's, which hardly wanders in 90 s; velocity errors are many.
    for column, bound in (("p_n", 3.0), ("p_e", 3.0), ("v_n", 1.3), ("v_e", 1.3), ("v_d", 1.3)):
        assert np.sqrt(np.mean((error[column] / sigma[column]) ** 2)) < bound


@pytest.mark.parametrize("share", [0.02, 0.15])
def test_barometer_spikes_change_less_than_a_sigma(telemetry, trajectory, share):
    """A barometer of an old log jumped to 210 m; without a gate the craft had 90 m/s."""
    baro = telemetry.baro.copy()
    struck = np.random.default_rng(5).choice(len(baro), max(3, round(share * len(baro))), replace=False)
    baro.iloc[[*struck, 0], baro.columns.get_loc("alt")] = 210.0
    spiked = estimate(telemetry.changed(baro=baro), rate=20.0)
    for column in ("p_n", "p_e", "p_d", "v_n", "v_e", "v_d"):
        change = (spiked.states[column] - trajectory.states[column]).abs()
        assert (change < trajectory.sigma[column]).all(), column
    assert ("sensor-doubtful" in [f.id for f in spiked.findings]) == (share > 0.05)


@pytest.mark.parametrize("climb_known", [True, False])
def test_bursts_of_some_metres_are_told_from_hops_by_their_edges(climb_known):
    """Readings off by 2 to 10 m for some seconds, some bursts over others, moved the speed by 4 to 19 sigmas."""
    rng = np.random.default_rng(3)
    t = np.arange(0.0, 120.0, 0.5)
    hops = np.clip(np.abs((t % 30.0) - 15.0) - 8.0, 0.0, 4.0) * 1.5
    alt = pd.Series(hops + rng.normal(0.0, 0.1, t.size), t)
    climb = pd.Series(np.gradient(hops, t), t) if climb_known else None
    assert steady_heights(alt, pd.Series(dtype=float), climb).all()
    hit = np.zeros(t.size, bool)
    for first, length, size in ((30, 3, -8.0), (42, 5, 9.5), (44, 6, 2.5), (150, 2, 4.0), (208, 6, -2.5)):
        alt.iloc[first : first + length] += size
        hit[first : first + length] = True
    assert (steady_heights(alt, pd.Series(dtype=float), climb) == ~hit).all()


def test_a_receiver_that_contradicts_itself_is_named(telemetry):
    """Telemetry had no NIS: a receiver off by many times its stated accuracy passed silently."""
    rng = np.random.default_rng(4)
    gps = telemetry.gps.copy()
    for column in ("v_n", "v_e", "v_d"):
        gps[column] += rng.normal(0.0, 4.0 * gps["s_acc"].to_numpy(), len(gps))
    findings = [f for f in estimate(telemetry.changed(gps=gps), rate=10.0).findings if f.id == "sensor-doubtful"]
    assert [f.evidence["sensor"] for f in findings] == ["gps_position"]
    assert findings[0].evidence["nis"] > 2.0


def test_vertical_speed_of_the_wrong_sign_is_turned_round(flight, telemetry):
    """Old firmware sends it so: GPS height and barometer were refused, and a dive at 10 m/s became 29 m/s."""
    truth = flight.truth[["p_n", "p_e", "p_d", "v_n", "v_e", "v_d"]]
    ekf = thinned(truth, 0.25).assign(roll=np.nan, pitch=np.nan, yaw=np.nan)
    result = estimate(telemetry.changed(ekf=ekf.assign(v_d=-ekf["v_d"])), rate=20.0)
    assert [f.id for f in result.findings] == ["not-logged", "sensor-doubtful"]
    error = errors(result, flight.truth[flight.truth.index > 10.0])
    assert error["v_d"].abs().max() < 5.0 * result.sigma["v_d"].max()
    right = estimate(telemetry.changed(ekf=ekf), rate=20.0)
    assert [f.id for f in right.findings] == ["not-logged"]
    pd.testing.assert_frame_equal(result.states, right.states)
    noise = np.random.default_rng(0).normal(0.0, 3.0, len(ekf))
    unrelated = estimate(telemetry.changed(ekf=ekf.assign(v_d=noise - 0.2 * ekf["v_d"])), rate=20.0)
    assert "not used" in next(f.reason for f in unrelated.findings if f.id == "sensor-doubtful")


def test_the_autopilots_velocities_are_used_and_its_positions_fill_holes(flight, telemetry):
    truth = flight.truth[["p_n", "p_e", "p_d", "v_n", "v_e", "v_d"]]
    ekf = thinned(truth, 0.25).assign(roll=np.nan, pitch=np.nan, yaw=np.nan)
    gps = telemetry.gps[(telemetry.gps.index < 40.0) | (telemetry.gps.index > 60.0)]
    result = estimate(telemetry.changed(gps=gps, ekf=ekf), rate=20.0)
    assert result.diagnostics["position_source"] == "GPS fixes and the autopilot's positions"
    error = errors(result, flight.truth.loc[42.0:58.0])
    assert np.hypot(error["p_n"], error["p_e"]).max() < 0.2


def test_smoother_agrees_with_filterpy_where_there_is_no_input():
    """Filterpy's method of the class is right for varying F; ours adds the input, so without one they are the same."""
    rng = np.random.default_rng(0)
    t = np.cumsum(rng.uniform(0.1, 0.3, 60))
    selector = np.zeros((3, SIZE))
    selector[:, 0:3] = selector[:, 9:12] = np.eye(3)
    measured = [
        Measured(when, "gps_position", selector, rng.normal(size=3), np.full(3, 0.04)) for when in np.round(t, 4)
    ]
    baro = np.zeros((1, SIZE))
    baro[0, 2], baro[0, 12] = -1.0, 1.0
    measured.append(Measured(measured[-1].t, "baro", baro, np.array([0.3]), np.array([0.02])))
    nodes = np.array([m.t for m in measured[:-1]])
    idle = Akima1DInterpolator(nodes, np.zeros((len(nodes), 3)))
    gps_sigma = np.array([1.0, 1.0, 1.5])
    disturbance = np.append(DISTURBANCE, np.full(3, EKF_LASTING))
    driven = np.tile(disturbance, (len(nodes), 1))
    x, P, _ = filter_telemetry(nodes, idle, measured, gps_sigma, SensorNoise(), driven)

    kf = KalmanFilter(dim_x=SIZE, dim_z=3)
    kf.x = np.zeros((SIZE, 1))
    kf.x[:3, 0] = measured[0].z
    kf.x[12, 0] = measured[-1].z[0] + measured[0].z[2]
    kf.P = np.diag(np.concatenate([np.full(6, 10.0), disturbance[:3], gps_sigma, [10.0], disturbance[3:]]) ** 2)
    F, _, Q = transitions(nodes, driven, gps_sigma, SensorNoise())
    Fs, Qs = [np.eye(SIZE), *F], [np.zeros((SIZE, SIZE)), *Q]
    xs, Ps = [], []
    for k, m in enumerate(measured[:-1]):
        kf.predict(F=Fs[k], Q=Qs[k])
        kf.update(m.z[:, None], R=np.diag(m.variance), H=m.H)
        if k == len(nodes) - 1:
            kf.update(measured[-1].z[:, None], R=np.diag(measured[-1].variance), H=baro)
        xs.append(kf.x.copy())
        Ps.append(kf.P.copy())
    theirs, their_P, _, _ = kf.rts_smoother(np.array(xs), np.array(Ps), Fs, Qs)
    np.testing.assert_allclose(x, theirs[:, :, 0], atol=1e-8)
    np.testing.assert_allclose(P, their_P, atol=1e-8)
