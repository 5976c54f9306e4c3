"""What a model leaves over, learned: ridge regression of its errors on the start and on the inputs since.

Features, all in units of the record: velocity and rates in body axes, the direction of gravity in the body, the inputs
over the horizon, products that physics suggests, and, with a memory, what the model missed in the time before the
start. Where attitude is an input, where the thrust points over the horizon is a feature too. Targets are the model's
errors at every sample up to the horizon, in the axes of the body at the start turned upright.

The inputs since the start tell of the motion also what the controller saw of it: that is right for predicting records,
and wrong for asking what other inputs would do. The correction is therefore off unless asked for, and not part of the
free run. `learning.learn_correction` makes one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from sysid.records.experiment import Floats
from sysid.records.filtering import lfilter
from sysid.rigid_body.six_dof.body_record import BodyRecord


@dataclass(frozen=True, slots=True)
class Observer:
    """Memory of the mean of what is missing."""

    #: s; 0 leaves the part out.
    force_memory: float = 0.5
    torque_memory: float = 0.3
    #: Of the vertical force, s; None: as of the others. A battery lasts a flight, gusts and trim do not.
    lift_memory: float | None = None


def pushes(observer: Observer, missed: Floats, dt: float) -> Floats:
    """Mean of what was missed (N, 6) before each sample, (N, 6)."""
    out = missed.copy()
    lift = observer.force_memory if observer.lift_memory is None else observer.lift_memory
    parts = ((slice(0, 2), observer.force_memory), (slice(2, 3), lift), (slice(3, 6), observer.torque_memory))
    for columns, memory in parts:
        if memory <= 0.0:
            out[:, columns] = 0.0
            continue
        keep = float(np.exp(-dt / memory))
        known = lfilter([1.0 - keep], [1.0, -keep], np.r_[0.0, np.ones(len(missed) - 1)])
        # The past is short at first: a second of it is a mean, one sample is not.
        mean = lfilter([1.0 - keep], [1.0, -keep], missed[:, columns]) / np.maximum(known, 1e-12)[:, None]
        out[:, columns] = mean * (np.arange(len(missed)) * dt > min(1.0, memory))[:, None]
    return out


@dataclass(frozen=True, slots=True, kw_only=True)
class CorrectionRecord:
    """What files hold of a `HorizonCorrection`."""

    horizon_samples: int
    memory_samples: float
    features: int
    gain_percent: Mapping[str, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class HorizonCorrection:
    """Correction of predictions up to a horizon."""

    steps: int  #: Horizon, samples.
    #: Time constant of what is remembered from before the start, samples; 0: only the start and what comes after it.
    memory: float
    weights: Floats  #: shape (F, steps, 12)
    #: shape (F,): Of the features.
    centre: Floats
    width: Floats
    #: By how much errors of held-out records became smaller, by state; states that are not there are not corrected.
    gain_percent: Mapping[str, float]

    def corrected(
        self,
        record: BodyRecord,
        starts: np.ndarray,
        marks: np.ndarray,
        predicted: Floats,
        missed: Floats | None,
        given: bool,
    ) -> Floats:
        """Return predictions (S, M, 18) less their learned errors; marks beyond the horizon stay as they are.

        `missed` (N, 6) is what the model missed (`SixDofModel.missed`); None without a memory.
        """
        inside = np.flatnonzero((marks <= self.steps) & (marks >= 1))
        usable = starts + self.steps < len(record.t)
        if not len(inside) or not usable.any():
            return predicted
        out = predicted.copy()
        rows = np.flatnonzero(usable)
        x = (features(record, starts[rows], self.steps, self.memory, missed, given) - self.centre) / self.width
        upright = upright_axes(record, starts[rows])
        for mark in inside:
            error = x @ self.weights[:, marks[mark] - 1]
            out[rows, mark] = _less(out[rows, mark], error, upright)
        return out

    def record(self) -> CorrectionRecord:
        """Return what files hold of it; the weights are too many to print."""
        return CorrectionRecord(
            horizon_samples=self.steps,
            memory_samples=self.memory,
            features=len(self.centre),
            gain_percent=self.gain_percent,
        )


def upright_axes(record: BodyRecord, starts: np.ndarray) -> Floats:
    """Rotation from the heading at each start to the world, (S, 3, 3): yaw only."""
    rotation = record.states[starts, 6:15].reshape(-1, 3, 3)
    return np.asarray(Rotation.from_euler("z", np.arctan2(rotation[:, 1, :1], rotation[:, 0, :1])).as_matrix())


def features(
    record: BodyRecord, starts: np.ndarray, steps: int, memory: float, missed: Floats | None, given: bool
) -> Floats:
    """Compute the features of each start, (S, F); `missed` as in `HorizonCorrection.corrected`."""
    n = len(record.t)
    state = record.states[starts]
    rotation = state[:, 6:15].reshape(-1, 3, 3)
    velocity = np.einsum("nji,nj->ni", rotation, state[:, 3:6])
    rates, gravity = state[:, 15:], rotation[:, 2, :]
    strength = record.inputs**2 if record.speeds else record.inputs
    now = strength[starts].mean(axis=1, keepdims=True)
    speed = np.linalg.norm(velocity, axis=1, keepdims=True)
    upright = upright_axes(record, starts)
    parts = [
        rates,
        velocity,
        gravity[:, :2],
        rates[:, [1]] * rates[:, [2]],
        rates[:, [0]] * rates[:, [2]],
        rates[:, [0]] * rates[:, [1]],
        speed * velocity,
        speed * gravity[:, :2],
        velocity[:, :2] * velocity[:, 2:],
        velocity * now,
        rates * now,
    ]
    if given:
        # What the air does is along the velocity, whatever the lean: features in the axes of the errors.
        level = np.einsum("nji,nj->ni", upright, state[:, 3:6])
        parts += [level, speed * level, level[:, :2] * level[:, 2:], level * now, now]
        lift = (record.inputs**2).mean(axis=1)
        for step in np.linspace(0, steps, 6).astype(int)[1:]:
            down = np.einsum("nji,nj->ni", upright, record.states[starts + step][:, [8, 11, 14]])
            parts += [down * lift[starts + step, None], down[:, :2]]
    else:
        parts.append(strength[np.minimum(starts[:, None] + np.arange(steps), n - 1)].reshape(len(starts), -1))
    if missed is not None and memory > 0.0:
        slow = _mean(missed, memory)
        for part in (1 / 40, 1 / 16, 1 / 6, 1 / 2.5):
            quick = (_mean(missed, part * memory) - slow)[starts]
            parts.append(np.einsum("nji,nj->ni", upright, quick[:, :3]))
            if not given:
                parts.append(quick[:, 3:])
    parts.append(np.ones((len(starts), 1)))
    return np.ascontiguousarray(np.column_stack(parts))


def _mean(values: Floats, memory: float) -> Floats:
    """Exponentially weighted mean of the past; memory in samples."""
    keep = float(np.exp(-1.0 / memory))
    return np.asarray(lfilter([1.0 - keep], [1.0, -keep], values))


def _less(predicted: Floats, error: Floats, upright: Floats) -> Floats:
    """Subtract errors (S, 12) from states (S, 18)."""
    out = predicted.copy()
    out[:, :3] -= np.einsum("nij,nj->ni", upright, error[:, :3])
    out[:, 3:6] -= np.einsum("nij,nj->ni", upright, error[:, 3:6])
    turned = predicted[:, 6:15].reshape(-1, 3, 3) @ Rotation.from_rotvec(-error[:, 6:9]).as_matrix()
    out[:, 6:15] = turned.reshape(-1, 9)
    out[:, 15:] -= error[:, 9:]
    return out
