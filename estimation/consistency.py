"""Consistency of a trajectory: innovations against chi-square, errors against truth and sigma."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.special import chdtri as chi2_isf

from core.attitude import continuous, error_rotation
from estimation.filter import Filtered
from estimation.observations import KIND_NAMES
from estimation.trajectory import Trajectory

#: Groups of error states that are judged together, by columns of `Trajectory.sigma`.
GROUPS: Mapping[str, tuple[str, ...]] = {
    "position": ("p_n", "p_e", "p_d"),
    "velocity": ("v_n", "v_e", "v_d"),
    "attitude": ("phi_n", "phi_e", "phi_d"),
}


#: Of one sensor: count of accepted scalars, refused, nis (mean of nu^2 / s), its 95 % bounds lower and upper for
#: independent innovations, and sigma (median 1-sigma of the white noise of a sample, SI).
SensorStatistics = Mapping[str, float]


def innovation_statistics(segments: list[Filtered]) -> dict[str, SensorStatistics]:
    """Mean normalised innovation squared of each sensor with its 95 % bounds, and how much was refused."""
    kinds = np.concatenate([s.observations.scalar_kind for s in segments])
    innovation = np.concatenate([s.innovation for s in segments])
    inverse = np.concatenate([s.inverse_variance for s in segments])
    variance = np.concatenate([s.white_scale[s.observations.scalar_kind] * s.observations.variance for s in segments])
    statistics: dict[str, SensorStatistics] = {}
    for kind, name in enumerate(KIND_NAMES):
        mine = kinds == kind
        accepted = mine & (inverse > 0.0)
        count = int(np.count_nonzero(accepted))
        if not mine.any():
            continue
        statistics[name] = {
            "count": count,
            "refused": int(np.count_nonzero(mine)) - count,
            "nis": float(np.mean(innovation[accepted] ** 2 * inverse[accepted])) if count else float("nan"),
            "lower": float(chi2_isf(max(count, 1), 0.975) / max(count, 1)),
            "upper": float(chi2_isf(max(count, 1), 0.025) / max(count, 1)),
            "sigma": float(np.sqrt(np.median(variance[mine]))),
        }
    return statistics


def errors(trajectory: Trajectory, truth: pd.DataFrame) -> pd.DataFrame:
    """Truth less estimate at the truth's times, as error states.

    Parameters
    ----------
    trajectory : Trajectory
    truth : DataFrame
        Columns of the canonical `truth` table (any of its groups may be NaN), relative to the trajectory's origin.

    Returns
    -------
    DataFrame
        Columns of `SIGMA_COLUMNS`; attitude errors as rotations about NED axes, rad.
    """
    t = trajectory.states.index.to_numpy(float)
    # Not across a hole: there the trajectory says nothing.
    after = np.clip(np.searchsorted(t, truth.index.to_numpy(float)), 1, len(t) - 1)
    near = (t[after] - t[after - 1] < 2.5 * np.median(np.diff(t))) & (truth.index >= t[0]) & (truth.index <= t[-1])
    inside = truth[near]
    at = inside.index.to_numpy(float)
    result = pd.DataFrame(index=inside.index)
    for column in (*GROUPS["position"], *GROUPS["velocity"]):
        result[column] = inside[column].to_numpy(float) - np.interp(at, t, trajectory.states[column].to_numpy(float))
    phi = error_rotation(
        _interpolate_quat(at, t, trajectory.states), inside[["q_w", "q_x", "q_y", "q_z"]].to_numpy(float)
    )
    for k, column in enumerate(GROUPS["attitude"]):
        result[column] = phi[:, k]
    return result


def _interpolate_quat(at: np.ndarray, t: np.ndarray, states: pd.DataFrame) -> np.ndarray:
    """Attitude between output rows, by normalised linear interpolation."""
    quat = continuous(states[["q_w", "q_x", "q_y", "q_z"]].to_numpy(float))
    mixed = np.column_stack([np.interp(at, t, column) for column in quat.T])
    return np.asarray(mixed / np.linalg.norm(mixed, axis=1, keepdims=True))


@dataclass(frozen=True, slots=True)
class TrajectoryErrors:
    """RMS errors of a trajectory against truth: m, m/s, rad."""

    horizontal_position: float
    vertical_position: float
    horizontal_velocity: float
    vertical_velocity: float
    tilt: float
    yaw: float


def compare(trajectory: Trajectory, truth: pd.DataFrame) -> TrajectoryErrors:
    """Compare a trajectory with truth; see `errors`."""
    return summarize(errors(trajectory, truth))


def summarize(error: pd.DataFrame) -> TrajectoryErrors:
    """RMS of a table of error states, over the rows that are known."""

    def rms(*columns: str) -> float:
        squared = (error[list(columns)].to_numpy(float) ** 2).sum(axis=1)
        return float(np.sqrt(np.nanmean(squared)))

    return TrajectoryErrors(
        rms("p_n", "p_e"), rms("p_d"), rms("v_n", "v_e"), rms("v_d"), rms("phi_n", "phi_e"), rms("phi_d")
    )


def nees(trajectory: Trajectory, truth: pd.DataFrame) -> dict[str, float]:
    """Mean normalised estimation error squared per degree of freedom: 1 where sigmas mean what they say.

    Position, velocity and attitude each against their 3 x 3 covariance block.
    """
    return nees_of(trajectory, errors(trajectory, truth))


def nees_of(trajectory: Trajectory, error: pd.DataFrame) -> dict[str, float]:
    """Compute `nees` of errors that are known already, of the groups of which some row is known."""
    covariance = trajectory.covariance
    t = trajectory.states.index.to_numpy(float)
    row = np.clip(np.searchsorted(t, error.index.to_numpy(float)), 0, len(t) - 1)
    result = {}
    for k, (name, columns) in enumerate(GROUPS.items()):
        e = error[list(columns)].to_numpy(float)
        known = np.isfinite(e).all(axis=1)
        if not known.any():
            continue
        block = covariance[row[known], k].astype(np.float64)
        weighted = np.linalg.solve(block, e[known][:, :, None])[:, :, 0]
        result[name] = float(np.mean((e[known] * weighted).sum(axis=1)) / 3.0)
    return result
