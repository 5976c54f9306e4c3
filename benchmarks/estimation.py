"""Trajectory estimation: speed against filterpy, accuracy against EKF3 in the simulator's logs."""

import time
from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
import pandas as pd

from benchmarks._measure import Row, cpu, readable, row
from benchmarks.trust import airborne_truth, errors_from
from core.attitude import quat_from_euler
from estimation import Trajectory, estimate
from estimation._kernels import ForwardPass
from estimation.alignment import align
from estimation.filter import FilterSegment, assemble
from estimation.filter import run as filter_forward
from estimation.observations import observe
from estimation.place import LocalFrame, World, world_field
from estimation.smoother import smooth
from estimation.states import SIZE, SensorNoise
from estimation.timing import InertialSignal
from logparse import FlightLog, Tables
from tests.estimation.simulated_flight import PLACE, Sensors, fly

MEASURES = {
    "horizontal position, m": ("p_n", "p_e"),
    "vertical position, m": ("p_d",),
    "horizontal velocity, m/s": ("v_n", "v_e"),
    "vertical velocity, m/s": ("v_d",),
    "tilt, deg": ("phi_n", "phi_e"),
    "yaw, deg": ("phi_d",),
}


def problem_of(tables: Tables, rate: float) -> Callable[[], FilterSegment]:
    """Lay out the whole log, as `estimate` does after tuning."""
    noise = SensorNoise()
    frame = LocalFrame.at(PLACE)
    signal = InertialSignal.of(tables.imu, tables.parameters, (noise.gyro, noise.accel))
    start = align(tables, tables.imu, frame, world_field(PLACE, {}, None).ned, noise)
    observations = observe(tables, frame, noise)
    outputs = np.arange(1.0, signal.stop - 1.0, 1.0 / rate)
    world = World(frame.gravity, frame.earth_rate)
    return lambda: assemble(signal, observations, outputs, start.x, start.P, world, noise)


def forward_and_back(lay_out: Callable[[], FilterSegment]) -> Callable[[], object]:
    def work() -> object:
        problem = lay_out()
        return smooth(problem, filter_forward(problem))

    return work


def filterpy_seconds(problem: FilterSegment, result: ForwardPass) -> float:
    """Time filterpy on the same nodes, with the same F, Q, H and R given for nothing."""
    from filterpy.kalman import KalmanFilter

    steps = []
    for node, T in enumerate(result.transition_time):
        F = np.eye(SIZE)
        S, C = result.transition_velocity[node], result.transition_rotation[node]
        F[0:3, 3:6] = T * np.eye(3)
        F[3:6, 6:9] = -np.array([[0.0, -S[2], S[1]], [S[2], 0.0, -S[0]], [-S[1], S[0], 0.0]])
        F[3:6, 12:15] = F[6:9, 9:12] = -C
        updates = []
        o = problem.observations
        for group in range(problem.steps.node_group[node], problem.steps.node_group[node + 1]):
            for m in range(o.start[group], o.start[group + 1]):
                H = np.zeros((1, SIZE))
                np.add.at(H[0], result.column[m], result.value[m])
                updates.append((np.array([[result.innovation[m]]]), o.variance[m], H))
        steps.append((F, np.diag(T * problem.noise.random_walks() + 1e-9), updates))
    start = time.process_time()
    kf = KalmanFilter(dim_x=SIZE, dim_z=1)
    kf.P = problem.P.copy()
    P = []
    for F, Q, updates in steps:
        kf.predict(F=F, Q=Q)
        for z, R, H in updates:
            kf.update(z, R=R, H=H)
        P.append(kf.P.copy())
    kf.rts_smoother(np.zeros((len(P), SIZE)), np.array(P), [s[0] for s in steps], [s[1] for s in steps])
    return time.process_time() - start


def speed_rows() -> list[Row]:
    """Time ours alone, then the peers on as much of the flight as they do in seconds."""
    rows: list[Row] = []
    long = fly(0, duration=1200.0).tables
    seconds = cpu(forward_and_back(problem_of(long, 50.0)), 3, warm=True)
    rows.append(row("20 min at 50 Hz: filter, smoother, covariance at 50 Hz", f"{seconds:.2f} s", goal="< 0.2 s"))
    whole = cpu(lambda: estimate(long), 3, warm=True)
    rows.append(row("  the same with tuning and tables: estimate()", f"{whole:.2f} s"))
    fast = fly(0, duration=120.0, sensors=Sensors(imu_rate=500.0)).tables
    per_sample = cpu(forward_and_back(problem_of(fast, 10.0)), 3, warm=True) / len(fast.imu)
    rows.append(row("per IMU sample at 500 Hz, forward and back", f"{1e6 * per_sample:.2f} us", goal="< 4 us"))
    # The slow log is all outputs and measurements; in the fast one ours moves the covariance from node to node only.
    for rate in (50.0, 500.0):
        tables = fly(0, duration=30.0, sensors=Sensors(imu_rate=rate)).tables
        ours = cpu(forward_and_back(problem_of(tables, 50.0)), 20, warm=True)
        each_sample = problem_of(tables, rate)()
        theirs = min(filterpy_seconds(each_sample, filter_forward(each_sample)) for _ in range(3))
        what = f"30 s of {rate:.0f} Hz IMU, given the matrices: filterpy"
        rows.append(row(what, f"{ours:.4f} s", f"{theirs:.3f} s", f"{theirs / ours:.0f}", "> 40"))
    return rows


def squares_of(error: pd.DataFrame, measures: dict[str, tuple[str, ...]]) -> dict[str, float]:
    """Mean squares of errors by measure."""
    return {
        name: float(np.nanmean((error[[*columns]].to_numpy(float) ** 2).sum(axis=1)))
        for name, columns in measures.items()
    }


def autopilots(log: FlightLog, like: Trajectory) -> Trajectory | None:
    """Return EKF3's estimate as a trajectory."""
    ekf = log.tables.ekf
    if ekf is None:
        return None
    quat = quat_from_euler(*ekf[["roll", "pitch", "yaw"]].to_numpy(float).T)
    columns = dict(zip(("q_w", "q_x", "q_y", "q_z"), quat.T, strict=True))
    return replace(like, states=ekf.assign(**columns).dropna())


def pooled(flights: Iterable[tuple[FlightLog, Trajectory]]) -> dict[str, pd.Series]:
    """Pool RMS errors of airborne flights by measure: of our smoother, our plain filter and EKF3."""
    squares: dict[str, list[dict[str, float]]] = {"smoother": [], "plain filter": [], "EKF3": []}
    for log, trajectory in flights:
        truth = airborne_truth(log)
        results = (trajectory, estimate(log.tables, smooth=False, rate=10.0), autopilots(log, trajectory))
        for pool, result in zip(squares.values(), results, strict=True):
            pool.append(squares_of(errors_from(result, truth), MEASURES))
    return {name: np.sqrt(pd.DataFrame(pool).mean()) for name, pool in squares.items()}


def accuracy_rows() -> list[Row]:
    """Compare our smoother and our plain filter with EKF3 on the simulator's logs."""
    logs = [log for _, log in readable("sitl/*.BIN") if log.tables.ekf is not None and log.flight is not None]
    if not logs:
        return [row("accuracy on the simulator's logs", "", peer="logs not there")]
    errors, rows = pooled((log, estimate(log.tables)) for log in logs), []
    for name in ("smoother", "plain filter"):
        for measure, us in errors[name].items():
            them = errors["EKF3"][measure]
            unit = 57.29578 if measure.endswith("deg") else 1.0
            target = "< 1" if "position" in measure or name == "plain filter" else "< 0.6"
            what = f"{name} on {len(logs)} logs, EKF3: {measure}"
            rows.append((what, f"{us * unit:.4f}", f"{them * unit:.4f}", f"{us / them:.2f}", target))
    return rows


def run() -> list[Row]:
    return speed_rows() + accuracy_rows()
