"""filterpy's filter over the nodes of a stretch of telemetry, and the recursion that smooths it back."""

import numpy as np
import scipy
from filterpy.kalman import KalmanFilter

from estimation.lowrate.measurements import SIZE, Measured
from estimation.states import SensorNoise
from estimation.timing import TICK

#: Correlation time of the acceleration that attitude does not tell, s: horizontally (drag and gusts, twice) and
#: vertically (climbs).
TIMES = (3.0, 3.0, 1.0)
#: Correlation time of the GPS error here, s. Velocities at telemetry rate are too coarse to tell a wander of the GPS
#: over minutes from a wander of the craft, so it is held to be nearly constant: known in size, not in course. Heights
#: have the barometer to tell them from (`SensorNoise.gps_height_time`), where there is one.
GPS_ERROR_TIME = 1000.0
#: What lasts of its velocity's error: 1-sigma at least, m/s, and for how long, s. Taken for white, an error of 0.1 m/s
#: over minutes outvoted a receiver by 80 m.
EKF_LASTING, EKF_TIME = 0.2, 30.0
#: Readings of the barometer whose median is its height at the start: any one may be a spike.
FIRST_HEIGHTS = 9
#: So many nodes at a time, for the sake of memory.
PIECE = 1000


def filter_telemetry(
    t: np.ndarray,
    thrust: scipy.interpolate.Akima1DInterpolator,
    measured: list[Measured],
    gps_sigma: np.ndarray,
    noise: SensorNoise,
    driven: np.ndarray,
    *,
    smoothed: bool = True,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Run filterpy's filter over the nodes, and smooth back: x (n, 16), P (n, 16, 16), and the nis of each row."""
    kf = KalmanFilter(dim_x=SIZE, dim_z=1, dim_u=3)
    kf.x = np.zeros((SIZE, 1))
    first = next((m for m in measured if len(m.z) >= 5), measured[0])
    kf.x[:3, 0] = first.z[:3]
    offsets = [m for m in measured if len(m.z) == 1 and m.admitted]
    if offsets:
        kf.x[12, 0] = np.median([m.z[0] for m in offsets[:FIRST_HEIGHTS]]) + first.z[2]
    kf.P = np.diag(
        np.concatenate([np.full(3, 10.0), np.full(3, 10.0), driven[0, :3], gps_sigma, [10.0], driven[0, 3:]]) ** 2
    )
    nodes = nodes_of(t, measured)
    x, P = np.empty((len(t), SIZE)), np.empty((len(t), SIZE, SIZE))
    nis = np.full(len(measured), np.nan)
    prior_x, prior_P = np.empty_like(x), np.empty_like(P)
    pieces = [slice(begin, begin + PIECE + 1) for begin in range(0, len(t) - 1, PIECE)]
    steps = (
        step for piece in pieces for step in zip(*transitions(t[piece], driven[piece], gps_sigma, noise), strict=True)
    )
    # Mean input of each step by Simpson's rule.
    edge = np.clip(t, thrust.x[0], thrust.x[-1])
    at, middle = thrust(edge), thrust(0.5 * (edge[1:] + edge[:-1]))
    mean_push = (at[:-1] + 4.0 * middle + at[1:]) / 6.0
    done = 0
    for k in range(len(t)):
        if k:
            F, B, Q = next(steps)
            kf.predict(u=mean_push[k - 1][:, None], F=F, B=B, Q=Q)
        prior_x[k], prior_P[k] = kf.x[:, 0], kf.P
        while done < len(measured) and nodes[done] == k:
            m = measured[done]
            done += 1
            if not m.admitted:
                continue
            kf.update(m.z[:, None], R=np.diag(m.variance), H=m.H)
            nis[done - 1] = np.mean(kf.y[:, 0] ** 2 / np.diag(kf.S))
        x[k], P[k] = kf.x[:, 0], kf.P
    for piece in reversed(pieces) if smoothed else ():
        F, _, _ = transitions(t[piece], driven[piece], gps_sigma, noise)
        gains = np.linalg.solve(prior_P[piece][1:], F @ P[piece][:-1]).transpose(0, 2, 1)
        for k, gain in reversed(list(enumerate(gains, start=piece.start))):
            x[k] += gain @ (x[k + 1] - prior_x[k + 1])
            P[k] += gain @ (P[k + 1] - prior_P[k + 1]) @ gain.T
    return x, P, nis


def transitions(
    t: np.ndarray, driven: np.ndarray, gps_sigma: np.ndarray, noise: SensorNoise
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """F, B and Q from node to node: disturbance and errors of GPS and autopilot are Gauss-Markov, the rest follows."""
    step, driven = np.diff(t), driven[1:]
    n = len(step)
    F, B, Q = np.tile(np.eye(SIZE), (n, 1, 1)), np.zeros((n, SIZE, 3)), np.zeros((n, SIZE, SIZE))
    lasts = np.exp(-step / EKF_TIME)
    lasting = (GPS_ERROR_TIME, GPS_ERROR_TIME, noise.gps_height_time)
    # White noise drives d; steps are short against the correlation time, so the leading terms do.
    powers = step[:, None, None] ** np.array([[5, 4, 3], [4, 3, 2], [3, 2, 1]])
    spread = powers / np.array([[20.0, 8.0, 6.0], [8.0, 3.0, 2.0], [6.0, 2.0, 1.0]])
    for axis, time in enumerate(TIMES):
        p, v, d, e, autopilot = axis, 3 + axis, 6 + axis, 9 + axis, 13 + axis
        a, stay = np.exp(-step / time), np.exp(-step / lasting[axis])
        # Exact integrals of a disturbance that decays with a.
        to_v = time * (1.0 - a)
        to_p = time * (step - to_v)
        F[:, p, v], F[:, p, d], F[:, v, d], F[:, d, d], F[:, e, e] = step, to_p, to_v, a, stay
        B[:, p, axis], B[:, v, axis] = 0.5 * step**2, step
        density = 2.0 * driven[:, axis] ** 2 / time
        Q[:, p : d + 1 : 3, p : d + 1 : 3] = density[:, None, None] * spread
        Q[:, e, e] = (1.0 - stay**2) * gps_sigma[axis] ** 2
        F[:, autopilot, autopilot] = lasts
        Q[:, autopilot, autopilot] = (1.0 - lasts**2) * driven[:, 3 + axis] ** 2
    Q[:, 12, 12] = noise.baro_walk**2 * step
    return F, B, Q


def nodes_of(t: np.ndarray, measured: list[Measured]) -> np.ndarray:
    """Return at which of the times `t` each row was measured; both lie on ticks."""
    return np.searchsorted(np.round(t / TICK), np.round(np.array([m.t for m in measured]) / TICK))
