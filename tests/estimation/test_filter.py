"""The compiled filter and smoother against filterpy on the same matrices; in pieces as in one."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from scipy.interpolate import CubicSpline

from estimation import _kernels, estimate, strapdown
from estimation._splines import along_spline
from estimation.alignment import align
from estimation.filter import assemble, matched_scale, run
from estimation.observations import observe
from estimation.place import LocalFrame, World, world_field
from estimation.smoother import new_adjoint, smooth, smooth_piece
from estimation.states import SIZE, SensorNoise
from estimation.timing import InertialSignal
from tests.estimation.simulated_flight import PLACE, Sensors, fly

#: Times of samples are taken as exact here: filterpy does not know of noise that grows with speed,
#: nor of ground that changes with it.
NOISE = SensorNoise(gps_jitter=0.0, baro_jitter=0.0, mag_jitter=0.0, range_jitter=0.0, terrain_walk=0.0)


def posed(tables, outputs):
    """Return a function that poses the problem of a flight with rows at these times [s]."""
    frame = LocalFrame.at(PLACE)
    signal = InertialSignal.of(tables.imu, tables.parameters, (NOISE.gyro, NOISE.accel))
    start = align(tables, tables.imu, frame, world_field(PLACE, {}, None).ned, NOISE)
    observations, world = observe(tables, frame, NOISE), World(frame.gravity, frame.earth_rate)
    return lambda: assemble(signal, observations, outputs, start.x, start.P, world, NOISE)


@pytest.fixture(scope="module")
def problem():
    flight = fly(3, duration=24.0, sensors=Sensors(second_gps=True, range_finder=0.05))
    return posed(flight.tables, np.arange(1.0, 23.0, 0.5))()


def test_what_a_piece_leaves_to_the_next_is_symmetric(problem):
    """Rounding that piled up over pieces made the covariance of flights of more than 80 minutes none any more."""
    result, adjoint = run(problem), new_adjoint()
    smooth_piece(problem, result, adjoint)
    assert np.array_equal(result.last_covariance, result.last_covariance.T)
    assert adjoint[1].any()
    assert np.array_equal(adjoint[1], adjoint[1].T)


def transition(result, node):
    """F of one node, written out from the definition of the error state."""
    F = np.eye(SIZE)
    T, S, C = result.transition_time[node], result.transition_velocity[node], result.transition_rotation[node]
    F[0:3, 3:6] = T * np.eye(3)
    F[3:6, 6:9] = -np.array([[0.0, -S[2], S[1]], [S[2], 0.0, -S[0]], [-S[1], S[0], 0.0]])
    F[3:6, 12:15] = -C
    F[6:9, 9:12] = -C
    F[19:24, 19:24] *= np.diag(np.exp(-T / NOISE.wander_times()))
    return F


def process_noise(problem, T, node):
    subs = slice(problem.steps.node_sub[node], problem.steps.node_sub[node + 1])
    q = T * NOISE.random_walks() * (np.diag(problem.P) > 0.0)
    q[6:9] += problem.steps.sub_noise[subs, 0].sum()
    q[3:6] += problem.steps.sub_noise[subs, 1].sum()
    gone = 1.0 - np.exp(-2.0 * T / NOISE.wander_times())
    q[19:24] += gone * np.diag(problem.P)[19:24]
    return np.diag(q)


@pytest.fixture(scope="module")
def oracle(problem):
    """Covariances, injected corrections and (F, Q) of every node, by filterpy."""
    result = run(problem)
    kf = KalmanFilter(dim_x=SIZE, dim_z=1)
    kf.P = problem.P.copy()
    P, injected, Fs, Qs = [], [], [], []
    o = problem.observations
    for node in range(len(problem.t)):
        F = transition(result, node)
        Q = process_noise(problem, result.transition_time[node], node)
        kf.x = np.zeros((SIZE, 1))
        kf.predict(F=F, Q=Q)
        for group in range(problem.steps.node_group[node], problem.steps.node_group[node + 1]):
            for m in range(o.start[group], o.start[group + 1]):
                if result.inverse_variance[m] == 0.0:
                    continue
                H = np.zeros((1, SIZE))
                np.add.at(H[0], result.column[m], result.value[m])
                S = float((H @ kf.P @ H.T)[0, 0]) + o.variance[m]
                # Huber's bound, the one thing that filterpy does not have.
                S = max(S, result.innovation[m] ** 2 / 9.0)
                assert result.inverse_variance[m] == pytest.approx(1.0 / S, rel=1e-7)
                R = S - float((H @ kf.P @ H.T)[0, 0])
                before = kf.x.copy()
                kf.update(np.array([[result.innovation[m]]]) + H @ before, R=R, H=H)
                np.testing.assert_allclose(result.gain[m], kf.K[:, 0], rtol=1e-5, atol=1e-9)
        P.append(kf.P.copy())
        injected.append(kf.x[:, 0].copy())
        Fs.append(F)
        Qs.append(Q)
    return result, np.array(P), np.array(injected), Fs, Qs


def test_forward_covariance_is_filterpys(problem, oracle):
    result, P, *_ = oracle
    for node, row in enumerate(problem.steps.node_out):
        if row >= 0:
            scale = np.sqrt(np.outer(np.diag(P[node])[:9], np.diag(P[node])))
            assert np.abs((result.rows[row] - P[node][:9]) / scale).max() < 1e-6


def test_smoother_is_rauch_tung_striebel(problem, oracle):
    """Modified Bryson-Frazier gives what the RTS recursion gives, for states and covariance."""
    result, P, injected, Fs, Qs = oracle
    smoothed = smooth(problem, result)
    # filterpy's method (not the function of the same name) pairs the F that leads to a node with that node.
    _, P_smoothed, gains, _ = KalmanFilter(dim_x=SIZE, dim_z=1).rts_smoother(np.zeros((len(P), SIZE)), P, Fs, Qs)
    correction = np.zeros(SIZE)
    for node in range(len(P) - 1, -1, -1):
        if node < len(P) - 1:
            correction = gains[node] @ (correction + injected[node + 1])
        row = problem.steps.node_out[node]
        if row < 0:
            continue
        sd = np.sqrt(np.diag(P_smoothed[node]))
        moved = smoothed.x[row, :6] - result.x[row, :6]
        assert np.abs((moved - correction[:6]) / sd[:6]).max() < 1e-3
        for block, covariance in enumerate(smoothed.covariance[row]):
            own = slice(3 * block, 3 * block + 3)
            scale = np.outer(sd[own], sd[own])
            np.testing.assert_allclose(covariance / scale, P_smoothed[node][own, own] / scale, atol=2e-4)
        if row % _kernels.SLOW_EVERY == 0:
            np.testing.assert_allclose(np.sqrt(smoothed.slow_variance[row]), sd[9:], rtol=1e-3)


def test_matched_scale_finds_how_noisy_a_sensor_is(problem):
    """Told that the GPS velocity is four times as good as it is, the innovations tell the truth (variance 16 times)."""
    o = problem.observations
    boast = np.where(o.scalar_kind == _kernels.GPS_VELOCITY, o.variance / 16.0, o.variance)
    boasting = replace(problem, observations=replace(o, variance=boast))
    boasting = replace(boasting, white_scale=matched_scale(boasting, run(boasting)))
    scale = matched_scale(boasting, run(boasting))[_kernels.GPS_VELOCITY]
    # 24 s hold 360 innovations: the median of their squares is known to a tenth or so.
    assert 10.0 < scale < 25.0


def test_memory_does_not_hold_the_covariance_of_every_imu_sample():
    """Ten times the IMU samples with the same rows out cost what the samples themselves take, not their covariances."""

    def peak(imu_rate):
        flight = fly(3, duration=30.0, sensors=Sensors(imu_rate=imu_rate))
        pose = posed(flight.tables, np.arange(1.0, 29.0, 0.1))
        tracemalloc.start()
        problem = pose()
        smooth(problem, run(problem))
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return most, len(flight.tables.imu)

    (slow, few), (fast, many) = peak(50.0), peak(500.0)
    covariance = 8 * SIZE**2
    assert (fast - slow) / (many - few) < 0.1 * covariance


@pytest.mark.parametrize("smooth", [True, False])
def test_pieces_do_not_show(monkeypatch, smooth):
    """Six pieces give what one gives, but for the nodes that their edges add (transitions are of first order)."""
    flight = fly(7, duration=40.0, sensors=Sensors(second_gps=True, range_finder=0.05))
    whole = estimate(flight.tables, rate=10.0, smooth=smooth)
    monkeypatch.setattr(strapdown, "PIECE", 64)
    pieces = estimate(flight.tables, rate=10.0, smooth=smooth)
    assert len(pieces.states) > 5 * 64
    apart = np.abs(pieces.states - whole.states)[whole.sigma.columns.intersection(whole.states.columns)]
    assert (apart / whole.sigma[apart.columns]).to_numpy().max() < 0.01
    np.testing.assert_allclose(pieces.sigma, whole.sigma, rtol=0.01)
    np.testing.assert_allclose(
        pieces.diagnostics["log_likelihood"], whole.diagnostics["log_likelihood"], rtol=0.0, atol=0.5
    )
    in_pieces, known = pieces.diagnostics["innovations"], whole.diagnostics["innovations"]
    assert {name: row["count"] for name, row in in_pieces.items()} == {
        name: row["count"] for name, row in known.items()
    }


def test_spline_is_scipys():
    """Values and integrals of uneven samples, and of a window of them far enough from its ends."""
    rng = np.random.default_rng(0)
    t, y = np.cumsum(rng.uniform(0.001, 0.004, 600)), rng.normal(size=(600, 3))
    at = np.sort(rng.uniform(t[0] - 0.001, t[-1] + 0.001, 900))
    spline = CubicSpline(t, y, bc_type="natural")
    np.testing.assert_allclose(along_spline(t, y, at, False), spline(at), rtol=0.0, atol=1e-12)
    areas = np.diff(spline.antiderivative()(at), axis=0)
    np.testing.assert_allclose(along_spline(t, y, at, True), areas, rtol=0.0, atol=1e-14)
    window, inside = slice(200, 400), at[(at > t[240]) & (at < t[359])]
    np.testing.assert_allclose(along_spline(t[window], y[window], inside, False), spline(inside), rtol=0.0, atol=1e-12)
