"""The wind that a craft feels, from its motion and a model of its drag."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sysid.records.experiment import Experiment, ExperimentError, Floats
from sysid.rigid_body.six_dof._kernels import ahead
from sysid.rigid_body.six_dof.body_record import drives
from sysid.rigid_body.six_dof.correction import upright_axes
from sysid.rigid_body.six_dof.model import SixDofModel, substeps

#: Length of the runs that are compared, s; attitude is measured throughout.
RUN_SECONDS = 0.2

#: Passes of Gauss-Newton, and the step of differences, m/s.
_PASSES, _STEP = 12, 0.5

#: Limit of a wind that is believed, m/s, and the spread of what is known of it before.
_STRONGEST, _PRIOR = 40.0, 15.0


@dataclass(frozen=True, slots=True, kw_only=True)
class WindTrack:
    """Wind by time."""

    t: Floats  #: shape (B,): Middle of each window, s.
    wind: Floats  #: shape (B, 2): North and east, m/s, as the air moves.
    sigma: Floats  #: shape (B, 2): From the scatter within each window.
    mean: Floats  #: shape (2,): Of the whole record at once.
    mean_sigma: Floats  #: shape (2,)


def estimate_trim(model: SixDofModel, still: Experiment) -> Floats:
    """Return the horizontal acceleration that a model misses in still air, forward and right, m/s^2, shape (2,).

    A level that is off by a degree, or a thrust that leans otherwise than on the records fitted, pushes like 0.17 m/s^2
    of drag, which is a wind of half a metre per second on a usual quadrotor. It is the zero of `estimate_wind`: the
    mean over the same runs, so that still air is no wind.

    Parameters
    ----------
    model : SixDofModel
    still : Experiment
        Flown without wind in the same set-up as those whose wind is asked for.
    """
    record = model.record(still)
    steps = max(round(RUN_SECONDS / record.dt), 1)
    starts = np.arange(len(record.t) - steps, dtype=np.int64)
    drive, none = drives(record, model.kinds, model.shape), np.zeros((len(starts), 6))
    air, marks, dt = np.zeros((len(record.t), 3)), np.array([steps]), record.dt
    found = ahead(model.theta, drive, air, none, record.states, starts, marks, dt, substeps(dt), True)
    missed = (record.states[starts + steps, 3:6] - found[:, 0, 3:6]) / (steps * dt)
    return np.asarray(np.einsum("nji,nj->ni", upright_axes(record, starts), missed)[:, :2].mean(axis=0))


def estimate_wind(
    model: SixDofModel, experiment: Experiment, window: float = 1.0, trim: Floats | None = None
) -> WindTrack:
    """Estimate the horizontal wind of a record with a model whose drag is known.

    Short runs from measured states are compared in horizontal velocity; the wind of a window is what makes their errors
    least (Gauss-Newton; drag is all but linear in the wind).

    Parameters
    ----------
    model : SixDofModel
        Fitted on records of known wind, or of much speed through the air.
    experiment : Experiment
    window : float
        s.
    trim : ndarray, shape (2,), optional
        Of `estimate_trim`, forward and right, m/s^2; it is not taken for drag.

    Raises
    ------
    ExperimentError
        When the record is shorter than a window.
    """
    record = model.record(experiment)
    steps = max(round(RUN_SECONDS / record.dt), 1)
    per_window = max(round(window / record.dt), steps)
    count = (len(record.t) - steps) // per_window
    if count < 1:
        raise ExperimentError(f"{record.name}: a record of {record.t[-1] - record.t[0]:.1f} s shows no wind")
    starts = np.arange(count * per_window, dtype=np.int64)
    drive = drives(record, model.kinds, model.shape)
    marks, push = np.array([steps]), np.zeros((len(starts), 6))
    if trim is not None:
        push[:, :3] = upright_axes(record, starts)[:, :, :2] @ trim

    def errors(wind: Floats) -> Floats:
        """Errors of horizontal velocity, (runs, 2), with the wind of every window, (B, 2)."""
        air = np.zeros((len(record.t), 3))
        air[: len(starts), :2] = np.repeat(wind, per_window, axis=0)
        found = ahead(model.theta, drive, air, push, record.states, starts, marks, record.dt, substeps(record.dt), True)
        return np.asarray((found[:, 0, 3:5] - record.states[starts + steps, 3:5]) / (steps * record.dt))

    tracks: list[tuple[Floats, Floats]] = []
    for blocks in (1, count):
        wind = np.zeros((count, 2)) if blocks == 1 else np.repeat(tracks[0][0], count, axis=0)
        owner = np.repeat(np.arange(count) if blocks > 1 else np.zeros(count, dtype=int), per_window)
        tracks.append(_solve(errors, wind, owner, blocks, steps))
    (mean, mean_sigma), (wind, sigma) = tracks
    middle = record.t[starts.reshape(count, per_window)].mean(axis=1)
    return WindTrack(t=middle, wind=wind, sigma=sigma, mean=mean[0], mean_sigma=mean_sigma[0])


def _solve(
    errors: Callable[[Floats], Floats], wind: Floats, owner: np.ndarray, blocks: int, steps: int
) -> tuple[Floats, Floats]:
    """Gauss-Newton for every block at once; winds and standard errors, (blocks, 2)."""
    value = np.array([wind[np.flatnonzero(owner[:: len(owner) // len(wind)] == b)[0]] for b in range(blocks)])
    spread = len(wind) // blocks
    information = np.zeros((blocks, 2, 2))
    for _ in range(_PASSES):
        base = errors(np.repeat(value, spread, axis=0))
        slopes = np.empty((*base.shape, 2))
        for k in range(2):
            moved = value.copy()
            moved[:, k] += _STEP
            slopes[..., k] = (errors(np.repeat(moved, spread, axis=0)) - base) / _STEP
        information = np.zeros((blocks, 2, 2))
        gradient, square, number = np.zeros((blocks, 2)), np.zeros(blocks), np.bincount(owner, minlength=blocks)
        np.add.at(information, owner, np.einsum("nij,nik->njk", slopes, slopes))
        np.add.at(gradient, owner, np.einsum("nij,ni->nj", slopes, base))
        np.add.at(square, owner, np.sum(base**2, axis=1))
        noise = square / np.maximum(2 * number, 1)
        # Runs overlap: neighbours share their noise.
        held = information / noise[:, None, None] / steps + np.eye(2) / _PRIOR**2
        step = np.linalg.solve(held, -(gradient / noise[:, None] / steps + value / _PRIOR**2)[..., None])[..., 0]
        value = np.clip(value + np.clip(step, -6.0, 6.0), -_STRONGEST, _STRONGEST)
        if np.abs(step).max() < 1e-3:
            break
    return value, np.sqrt(np.linalg.inv(held).diagonal(axis1=1, axis2=2))
