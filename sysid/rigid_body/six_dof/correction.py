"""What a model leaves over, learned: ridge regression of its errors on the start and on the inputs since.

Features, all in units of the record: velocity and rates in body axes, the direction of gravity in the body, the inputs
at every sample of the horizon, products that physics suggests, and, with a memory, rates and inputs before the start.
Targets are the model's errors at every sample up to the horizon, in the axes of the body at the start turned upright.
Runs that err more than usual count less, as in `shooting`.

The inputs since the start tell of the motion also what the controller saw of it: that is right for predicting records,
and wrong for asking what other inputs would do. The correction is therefore off unless asked for, and not part of the
free run.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.transform import Rotation

from sysid.records.experiment import Floats
from sysid.rigid_body.six_dof.body_record import BodyRecord
from sysid.rigid_body.six_dof.shooting import state_errors

#: Reweighting passes, and the part of the usual error below which all runs count alike.
_PASSES, _FLOOR = 3, 0.3


@dataclass(frozen=True, slots=True, kw_only=True)
class HorizonCorrection:
    """Correction of predictions up to a horizon."""

    steps: int  #: Horizon, samples.
    memory: int  #: Samples before the start that are looked at; 0: the start and what comes after it only.
    weights: Floats  #: shape (F, steps, 12)
    #: shape (F,): Of the features.
    centre: Floats
    width: Floats
    #: By how much errors of held-out records became smaller when it was learned without them.
    gain_percent: float = float("nan")

    def corrected(self, record: BodyRecord, starts: np.ndarray, marks: np.ndarray, predicted: Floats) -> Floats:
        """Return predictions less their learned errors; marks beyond the horizon stay as they are.

        Parameters
        ----------
        record : BodyRecord
        starts : ndarray, shape (S,)
        marks : ndarray, shape (M,)
        predicted : ndarray, shape (S, M, 18)
        """
        inside = np.flatnonzero((marks <= self.steps) & (marks >= 1))
        usable = starts + self.steps <= len(record.t)
        if not len(inside) or not usable.any():
            return predicted
        out = predicted.copy()
        rows = np.flatnonzero(usable)
        x = (features(record, starts[rows], self.steps, self.memory) - self.centre) / self.width
        upright = upright_axes(record, starts[rows])
        for mark in inside:
            error = x @ self.weights[:, marks[mark] - 1]
            out[rows, mark] = _less(out[rows, mark], error, upright)
        return out

    def to_dict(self) -> dict[str, Any]:
        """Return what it is, for JSON; the weights are too many to print."""
        return {
            "horizon_samples": self.steps,
            "memory_samples": self.memory,
            "features": len(self.centre),
            "gain_percent": None if np.isnan(self.gain_percent) else self.gain_percent,
        }


def upright_axes(record: BodyRecord, starts: np.ndarray) -> Floats:
    """Rotation from the heading at each start to the world, (S, 3, 3): yaw only."""
    rotation = record.states[starts, 6:15].reshape(-1, 3, 3)
    return np.asarray(Rotation.from_euler("z", np.arctan2(rotation[:, 1, :1], rotation[:, 0, :1])).as_matrix())


def features(record: BodyRecord, starts: np.ndarray, steps: int, memory: int) -> Floats:
    """Features of each start, (S, F)."""
    n = len(record.t)
    state = record.states[starts]
    rotation = state[:, 6:15].reshape(-1, 3, 3)
    velocity = np.einsum("nji,nj->ni", rotation, state[:, 3:6])
    rates, gravity = state[:, 15:], rotation[:, 2, :]
    strength = record.inputs**2 if record.speeds else record.inputs
    strength = strength / max(float(np.mean(np.abs(strength))), 1e-12)
    now = strength[starts].mean(axis=1, keepdims=True)
    speed = np.linalg.norm(velocity, axis=1, keepdims=True)
    window = strength[np.minimum(starts[:, None] + np.arange(steps), n - 1)].reshape(len(starts), -1)
    parts = [
        rates,
        velocity,
        gravity[:, :2],
        window,
        rates[:, [1]] * rates[:, [2]],
        rates[:, [0]] * rates[:, [2]],
        rates[:, [0]] * rates[:, [1]],
        speed * velocity,
        speed * gravity[:, :2],
        velocity[:, :2] * velocity[:, 2:],
        velocity * now,
        rates * now,
    ]
    if memory:
        back = np.maximum(starts[:, None] - np.arange(2, memory + 1, 2), 0)
        parts += [record.states[back, 15:].reshape(len(starts), -1), strength[back].reshape(len(starts), -1)]
        far = back[:, ::5]
        turned = np.einsum("nmij,nmi->nmj", record.states[far, 6:15].reshape(*far.shape, 3, 3), record.states[far, 3:6])
        parts.append(turned.reshape(len(starts), -1))
    parts.append(np.ones((len(starts), 1)))
    return np.ascontiguousarray(np.column_stack(parts))


def _targets(record: BodyRecord, starts: np.ndarray, steps: int, predicted: Floats) -> Floats:
    """Errors of predictions in the axes of the heading at the start, (S, steps, 12)."""
    measured = record.states[starts[:, None] + np.arange(1, steps + 1)]
    errors = state_errors(predicted, measured)
    upright = upright_axes(record, starts)
    errors[..., :3] = np.einsum("nji,nmj->nmi", upright, errors[..., :3])
    errors[..., 3:6] = np.einsum("nji,nmj->nmi", upright, errors[..., 3:6])
    return errors


def _less(predicted: Floats, error: Floats, upright: Floats) -> Floats:
    """Subtract errors (S, 12) from states (S, 18)."""
    out = predicted.copy()
    out[:, :3] -= np.einsum("nij,nj->ni", upright, error[:, :3])
    out[:, 3:6] -= np.einsum("nij,nj->ni", upright, error[:, 3:6])
    turned = predicted[:, 6:15].reshape(-1, 3, 3) @ Rotation.from_rotvec(-error[:, 6:9]).as_matrix()
    out[:, 6:15] = turned.reshape(-1, 9)
    out[:, 15:] -= error[:, 9:]
    return out


def learn(
    records: Sequence[BodyRecord],
    predictions: Sequence[tuple[np.ndarray, Floats]],
    steps: int,
    memory: int,
    ridge: float,
) -> HorizonCorrection:
    """Learn a correction.

    Parameters
    ----------
    records : sequence of BodyRecord
    predictions : sequence of (ndarray (S,), ndarray (S, steps, 18))
        Starts of each record and what the model predicts from there.
    steps, memory : int
        Samples.
    ridge : float
        Of features scaled to unit variance, over their number of samples.
    """
    table = [features(record, starts, steps, memory) for record, (starts, _) in zip(records, predictions, strict=True)]
    goals = [
        _targets(record, starts, steps, predicted).reshape(len(starts), -1)
        for record, (starts, predicted) in zip(records, predictions, strict=True)
    ]
    stacked, goal = np.concatenate(table), np.concatenate(goals)
    centre, width = stacked.mean(axis=0), np.maximum(stacked.std(axis=0), 1e-9)
    centre[-1], width[-1] = 0.0, 1.0  # the constant
    x = (stacked - centre) / width
    weights = np.zeros((x.shape[1], steps, 12))
    by_state = goal.reshape(len(goal), steps, 4, 3)
    for state in range(4):
        target = by_state[:, :, state].reshape(len(goal), -1)
        count = np.full(len(goal), 1.0)
        for at in range(_PASSES):
            weighted = x * count[:, None]
            lhs = weighted.T @ x
            lhs[np.diag_indices_from(lhs)] += ridge * count.sum() * np.r_[np.ones(x.shape[1] - 1), 1e-6]
            solution = cho_solve(cho_factor(lhs), weighted.T @ target)
            if at < _PASSES - 1:
                left = np.linalg.norm((target - x @ solution).reshape(len(x), steps, 3), axis=2).mean(axis=1)
                count = 1.0 / np.maximum(left, _FLOOR * np.median(left))
                count /= count.mean()
        weights[:, :, 3 * state : 3 * state + 3] = solution.reshape(-1, steps, 3)
    return HorizonCorrection(steps=steps, memory=memory, weights=weights, centre=centre, width=width)
