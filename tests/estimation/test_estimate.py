"""The strapdown estimate judged by simulated truth and by its own covariance, and what it makes of poor input."""

import numpy as np
import pandas as pd
import pytest

from estimation import SENSOR_ERROR_COLUMNS, SIGMA_COLUMNS, STATE_COLUMNS, SensorNoise, compare, errors, estimate, nees
from logparse import MissingDataError, Tables
from tests.estimation.simulated_flight import Sensors, each, fly, later


@pytest.fixture(scope="module")
def flight():
    return fly(0, duration=100.0)


@pytest.fixture(scope="module")
def trajectory(flight):
    return estimate(flight.tables)


def test_trajectory_has_the_promised_columns(trajectory, flight):
    # The craft of this flight has no range finder, so nothing is said of the ground.
    names = [name for name in SENSOR_ERROR_COLUMNS if name != "h_terrain"]
    assert list(trajectory.states.columns) == [*STATE_COLUMNS, *names]
    assert list(trajectory.sigma.columns) == [*SIGMA_COLUMNS, *names]
    assert trajectory.method == "strapdown"
    # Likelihood knows the lag of either sensor to some milliseconds on 100 s of flight.
    assert trajectory.diagnostics["lags"] == pytest.approx({"mag": 0.0, "gps": 0.0, "baro": 0.0}, abs=0.02)
    assert trajectory.findings == ()
    steps = np.diff(trajectory.states.index.to_numpy())
    np.testing.assert_allclose(steps, 0.02, atol=1e-9)
    assert np.isfinite(trajectory.states.to_numpy()).all()
    variance = np.diagonal(trajectory.covariance, axis1=2, axis2=3).reshape(-1, 9)
    np.testing.assert_allclose(np.sqrt(variance), trajectory.sigma[[*SIGMA_COLUMNS]].to_numpy(), rtol=1e-9)


def test_rates_and_forces_are_free_of_bias(trajectory, flight):
    """A bias left in the accelerometer would show in the mean force along the body's axes."""
    true = flight.biases.reindex(trajectory.states.index, method="nearest")
    for column in ("b_gx", "b_gy", "b_gz", "b_ax", "b_ay", "b_az"):
        error = (trajectory.states[column] - true[column]).iloc[1000:]
        assert np.sqrt(np.mean((error / trajectory.sigma[column].iloc[1000:]) ** 2)) < 3.0


def test_the_time_of_the_imu_is_shifted_by_its_filter(flight, trajectory):
    """Without the parameters the delay is not known, and turning with 11 ms of lag costs attitude."""
    blind = estimate(flight.tables.changed(parameters={}))
    assert trajectory.diagnostics["gyro_delay"] == pytest.approx(0.01125, rel=1e-3)
    assert blind.diagnostics["gyro_delay"] == 0.0
    assert compare(trajectory, flight.settled()).tilt < compare(blind, flight.settled()).tilt


def test_an_outage_is_bridged(flight):
    gps = flight.tables.gps
    cut = estimate(flight.tables.changed(gps=gps[(gps.index < 50.0) | (gps.index > 70.0)]))
    error = errors(cut, flight.truth)
    inside = error[(error.index > 50.0) & (error.index < 70.0)]
    assert np.hypot(inside["p_n"], inside["p_e"]).max() < 3.0
    assert [f.id for f in cut.findings] == ["position-unknown"]


def test_a_glitch_leaves_no_trace(flight, trajectory):
    gps = flight.tables.gps.copy()
    gps.loc[60.0:63.0, "lat"] += 15.0 / 6.37e6
    glitched = estimate(flight.tables.changed(gps=gps))
    clean = compare(trajectory, flight.settled()).horizontal_position
    assert compare(glitched, flight.settled()).horizontal_position == pytest.approx(clean, rel=0.01)
    assert [f.id for f in glitched.findings] == ["sensor-doubtful"]
    assert glitched.findings[0].evidence["start"] == pytest.approx(60.0, abs=0.3)


def test_other_sensors_make_good_what_is_missing(flight):
    """Each sensor's absence is told, and costs only what it alone knew."""
    for name in ("mag", "baro"):
        result = estimate(flight.tables.changed(**{name: None}))
        assert [(f.id, f.evidence["what"]) for f in result.findings] == [("not-logged", name)]
        error = compare(result, flight.settled())
        assert error.horizontal_velocity < 0.1
        assert np.degrees(error.yaw) < 1.0
    assert "b_baro" not in result.states


def test_heading_without_magnetometer_or_autopilot_comes_from_movement():
    flight = fly(6, duration=80.0, heading=2.9)
    result = estimate(flight.tables.changed(mag=None, attitude=None))
    assert result.diagnostics["yaw_source"] == ["movement"]
    assert np.degrees(compare(result, flight.settled()).yaw) < 1.0


def test_without_gps_the_sigma_says_that_position_drifts(flight):
    result = estimate(flight.tables.changed(gps=None))
    assert [f.id for f in result.findings] == ["not-logged"]
    last = errors(result, flight.truth).iloc[-1]
    sigma = result.sigma.iloc[-1]
    assert sigma["p_n"] > 20.0
    assert abs(last["p_n"]) < 5.0 * sigma["p_n"]
    # Height is still the barometer's.
    assert sigma["p_d"] < 2.0


def test_a_log_that_starts_in_the_air(flight):
    result = estimate(later(flight.tables, 30.0).changed(attitude=None))
    assert result.diagnostics["aligned_still"] == [False]
    error = compare(result, flight.settled(35.0))
    assert error.horizontal_velocity < 0.1
    assert np.degrees(error.tilt) < 0.3


def test_a_craft_that_never_moves():
    """Heading rests on hard iron of some degrees that nothing can tell from heading: 2 uT of 21 uT are 5 degrees."""
    ratios = []
    for seed in range(40, 44):
        still = fly(seed, duration=40.0, still=40.0)
        result = estimate(still.tables)
        error = errors(result, still.settled(5.0))
        for column in ("v_n", "v_e", "v_d", "p_d"):
            assert np.abs(error[column]).max() < 4.0 * result.sigma[column].max()
        assert np.degrees(result.sigma["phi_d"].median()) > 3.0
        ratios.append(error["phi_d"].mean() / result.sigma["phi_d"].median())
    # Four headings, one throw of hard iron each: the mean of their squares should be 1 +- 0.7. Relinearised forces
    # still feign a little knowledge of heading; rows of the magnetometer at the latest heading made it 5.
    assert 0.2 < np.mean(np.square(ratios)) < 3.0


def test_nan_bursts_are_holes(flight):
    rng = np.random.default_rng(0)
    imu, gps = flight.tables.imu.copy(), flight.tables.gps.copy()
    for _ in range(15):
        at = rng.integers(0, len(imu) - 30)
        imu.iloc[at : at + rng.integers(1, 25), rng.integers(0, 6)] = np.nan
    gps.iloc[100:120, gps.columns.get_loc("lat")] = np.nan
    gps.iloc[200:230, gps.columns.get_loc("v_n")] = np.nan
    result = estimate(flight.tables.changed(imu=imu, gps=gps))
    assert np.isfinite(result.states.to_numpy()).all()
    assert compare(result, flight.settled()).horizontal_velocity < 0.15
    assert nees(result, flight.settled())["velocity"] < 3.0


def test_a_clock_jump_splits_the_log(flight):
    """The boot clock jumps by 300 s: two segments, no rows between them, one origin."""

    def jumped(table):
        t = table.index.to_numpy()
        return table.set_axis(pd.Index(np.where(t < 50.0, t, t + 300.0), name="t"))

    tables = each(flight.tables, jumped)
    valid = tables.gps["t_valid"].to_numpy()
    tables = tables.changed(gps=tables.gps.assign(t_valid=np.where(valid < 50.0, valid, valid + 300.0)))
    result = estimate(tables)
    assert [f.id for f in result.findings] == ["log-gaps"]
    t = result.states.index
    assert not ((t > 51.0) & (t < 349.0)).any()
    assert compare(result, jumped(flight.settled())).horizontal_velocity < 0.1


def test_start_and_stop_cut_the_same_trajectory(flight, trajectory):
    part = estimate(flight.tables, start=40.0, stop=60.0, rate=10.0)
    assert part.states.index[0] == pytest.approx(40.0)
    assert part.states.index[-1] == pytest.approx(60.0)
    whole = trajectory.states.reindex(part.states.index, method="nearest")
    assert np.abs(part.states["v_n"] - whole["v_n"]).max() < 1e-3
    with pytest.raises(ValueError, match="no IMU samples between"):
        estimate(flight.tables, start=1e5)


@pytest.mark.parametrize("rate", [25.0, 200.0])
def test_any_imu_rate(rate):
    flight = fly(2, duration=60.0, sensors=Sensors(imu_rate=rate))
    error = compare(estimate(flight.tables), flight.settled())
    assert error.horizontal_velocity < 0.08
    assert np.degrees(error.tilt) < 0.2


def test_nothing_to_estimate_from_is_said_with_what_to_set(flight):
    with pytest.raises(MissingDataError, match="log IMU and GPS"):
        estimate(Tables())
    with pytest.raises(MissingDataError, match="too short"):
        estimate(flight.tables.changed(imu=flight.tables.imu.iloc[:40]))


def test_each_segment_takes_its_own_imu(flight):
    """The first IMU has a hole in flight, and after it shakes loose: the second one carries that part, unmixed."""
    rng = np.random.default_rng(4)
    imu = flight.tables.imu
    loose = imu + (imu.index.to_numpy() > 50.0)[:, None] * rng.normal(0.0, [0.2] * 3 + [3.0] * 3, imu.shape)

    def with_hole(table):
        return table[(table.index < 50.0) | (table.index > 53.0)]

    tables = flight.tables.changed(imu=with_hole(loose), further={"imu": (with_hole(imu),)})
    result = estimate(tables)
    assert result.diagnostics["imu"] == [0, 1]
    assert sorted(f.id for f in result.findings) == ["log-gaps", "sensor-doubtful"]
    whole = estimate(tables.changed(further={"imu": (imu,)}))
    assert whole.diagnostics["imu"] == [1]
    assert [f.id for f in whole.findings] == ["sensor-doubtful"]
    assert compare(whole, flight.settled()).horizontal_velocity < 0.06


def test_what_was_learned_of_the_sensors_survives_a_hole():
    """After a hole of four seconds the biases are known far better than at the start of a log."""
    flight = fly(7, duration=100.0)
    imu = flight.tables.imu
    result = estimate(flight.tables.changed(imu=imu[(imu.index < 80.0) | (imu.index > 84.0)]), smooth=False)
    after = result.sigma[result.sigma.index < 84.5].iloc[-1]
    prior = SensorNoise()
    for column, first in (("b_gx", prior.gyro_bias), ("b_ax", prior.accel_bias), ("b_mx", prior.hard_iron)):
        assert after[column] < 0.4 * first
    true = flight.biases.loc[84.5:85.0, "b_ax"].mean()
    assert abs(result.states.loc[84.5:85.0, "b_ax"].mean() - true) < 4.0 * after["b_ax"]


def test_the_plain_filter_knows_no_future(flight, trajectory):
    """Cut short, it gives the same rows; the smoother is better and surer."""
    plain = estimate(flight.tables, smooth=False)
    assert (
        compare(trajectory, flight.settled()).horizontal_velocity < compare(plain, flight.settled()).horizontal_velocity
    )
    assert (plain.sigma["v_n"] > 0.99 * trajectory.sigma["v_n"]).all()
    assert nees(plain, flight.settled())["velocity"] < 1.5
    assert compare(plain, flight.settled()).horizontal_velocity < 0.15
