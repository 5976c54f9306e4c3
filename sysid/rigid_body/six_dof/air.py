"""The wind that a craft feels, from its motion and a model of its drag.

A craft that leans into the wind is held by thrust, so that a battery which is fuller than those of the records fitted
looks like wind: 5 % of thrust at 17 degrees of lean are 0.14 m/s^2. The thrust of every window is therefore sought
together with its wind; height tells it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sysid.records.experiment import Experiment, ExperimentError, Floats
from sysid.rigid_body.six_dof._kernels import ahead
from sysid.rigid_body.six_dof.body_record import BodyRecord, drives
from sysid.rigid_body.six_dof.correction import upright_axes
from sysid.rigid_body.six_dof.model import SixDofModel, substeps

#: Length of the windows of the wind, and of a trim, s: manoeuvres, during which the model errs this way and that, are
#: shorter than these.
WIND_SECONDS, TRIM_SECONDS = 1.0, 5.0

#: Standard deviation of the horizontal acceleration that all of a record may miss, m/s^2: by a law of drag that does
#: not hold at every speed, and by a level that is off by 0.3 deg where no trim is given. In a tunnel, flown by two
#: controllers, known winds of 0 to 12 m/s were 0.2 m/s off with a trim, 0.25 without; 0.1 m/s^2 are 0.24 m/s there.
_LAW, _LEVEL = 0.1, 0.05

#: What is sought of a window, two horizontal numbers and the thrust over the model's: known before, and its spread.
_Sought = tuple[Floats, Floats]

#: North and east, m/s, or forward and right, m/s^2; thrust as `fit.FAMILIES` has it of a battery's charge.
_WIND: _Sought = np.array([0.0, 0.0, 1.0]), np.array([15.0, 15.0, 0.1])
_TRIM: _Sought = np.array([0.0, 0.0, 1.0]), np.array([1.0, 1.0, 0.1])

#: Parts of a spread: step of differences, longest step of the search, and what is believed.
_DIFFERENCE, _STRIDE, _FARTHEST = 0.05, 0.4, 4.0


@dataclass(frozen=True, slots=True, kw_only=True)
class WindTrack:
    """Wind by time."""

    t: Floats  #: shape (B,): Middle of each window, s.
    wind: Floats  #: shape (B, 2): North and east, m/s, as the air moves.
    sigma: Floats  #: shape (B, 2): From the scatter within each window, and what the model misses of drag and level.
    mean: Floats  #: shape (2,): Of the whole record at once.
    mean_sigma: Floats  #: shape (2,)


def estimate_trim(model: SixDofModel, still: Experiment) -> Floats:
    """Return the horizontal acceleration that a model misses in still air, forward and right, m/s^2, shape (2,).

    A level that is off by a degree, or a thrust that leans otherwise than on the records fitted, pushes like 0.17 m/s^2
    of drag, which is a wind of half a metre per second on a usual quadrotor. It is the zero of `estimate_wind`. Windows
    unlike the others do not count: the air of a tunnel still moves for a while after its fans stopped.

    Parameters
    ----------
    model : SixDofModel
    still : Experiment
        Flown without wind in the same set-up as those whose wind is asked for.

    Raises
    ------
    ExperimentError
        When the record is shorter than a window.
    """
    runs = _runs(model, still, TRIM_SECONDS)
    values, _, _ = _solve(
        lambda sought: runs.errors(np.zeros((len(sought), 2)), sought[:, :2], sought[:, 2]), runs, _TRIM
    )
    return np.array([_usual(column) for column in values[:, :2].T])


def _usual(values: Floats) -> float:
    """Mean of the values that are near their median."""
    away = np.abs(values - np.median(values))
    # Three standard deviations, in median distances.
    return float(values[away <= 4.4 * np.median(away) + 1e-12].mean())


def estimate_wind(model: SixDofModel, experiment: Experiment, trim: Floats | None = None) -> WindTrack:
    """Estimate the horizontal wind of a record with a model whose drag is known.

    Short runs from measured states are compared in velocity; the wind and the thrust of a window are what makes their
    errors least (Gauss-Newton; drag is all but linear in the wind).

    Parameters
    ----------
    model : SixDofModel
        Fitted on records of known wind, or of much speed through the air.
    experiment : Experiment
    trim : ndarray, shape (2,), optional
        Of `estimate_trim`, forward and right, m/s^2; it is not taken for drag.

    Raises
    ------
    ExperimentError
        When the record is shorter than a window.
    """
    runs = _runs(model, experiment, WIND_SECONDS)
    lean = np.zeros(2) if trim is None else trim

    def errors(sought: Floats) -> Floats:
        return runs.errors(sought[:, :2], np.broadcast_to(lean, (len(sought), 2)), sought[:, 2])

    missed = _LAW if trim is not None else float(np.hypot(_LAW, _LEVEL))
    whole, whole_covariance, by_wind = _solve(errors, runs, _WIND, blocks=1)
    values, covariance, _ = _solve(errors, runs, _WIND, first=whole[0])
    feigned = np.diag(np.linalg.pinv(by_wind[0] @ by_wind[0].T)) * missed**2
    return WindTrack(
        t=runs.record.t[runs.starts.reshape(runs.windows, -1)].mean(axis=1),
        wind=values[:, :2],
        sigma=np.sqrt(covariance.diagonal(axis1=1, axis2=2)[:, :2] + feigned),
        mean=whole[0, :2],
        mean_sigma=np.sqrt(np.diag(whole_covariance[0])[:2] + feigned),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Runs:
    """Short runs of one record, in windows."""

    model: SixDofModel
    record: BodyRecord
    drive: Floats  #: shape (N, 8 + e)
    starts: np.ndarray  #: shape (R,)
    steps: int  #: Samples of a run.
    windows: int

    def errors(self, wind: Floats, lean: Floats, thrust: Floats) -> Floats:
        """Errors of acceleration, (R, 3), with the wind, lean (B, 2) and thrust (B,) of every window."""
        record, runs = self.record, len(self.starts)
        size = runs // self.windows
        air, push, drive = np.zeros((len(record.t), 3)), np.zeros((runs, 6)), self.drive.copy()
        air[:runs, :2] = np.repeat(wind, size, axis=0)
        push[:, :3] = np.einsum(
            "nij,nj->ni", upright_axes(record, self.starts)[:, :, :2], np.repeat(lean, size, axis=0)
        )
        over = np.append(np.repeat(thrust, size), np.full(len(drive) - runs, thrust[-1]))
        drive[:, 0] *= over
        drive[:, 7] *= over
        if not record.speeds:
            drive[:, 6] *= np.sqrt(over)
        marks, dt = np.array([self.steps]), record.dt
        found = ahead(self.model.theta, drive, air, push, record.states, self.starts, marks, dt, substeps(dt), True)
        return np.asarray((found[:, 0, 3:6] - record.states[self.starts + self.steps, 3:6]) / (self.steps * dt))


def _runs(model: SixDofModel, experiment: Experiment, window: float) -> _Runs:
    record = model.record(experiment)
    steps = max(round(0.2 / record.dt), 1)
    size = max(round(window / record.dt), steps)
    windows = (len(record.t) - steps) // size
    if windows < 1:
        raise ExperimentError(f"{record.name}: a record of {record.t[-1] - record.t[0]:.1f} s shows no wind")
    return _Runs(
        model=model,
        record=record,
        drive=drives(record, model.kinds, model.shape),
        starts=np.arange(windows * size, dtype=np.int64),
        steps=steps,
        windows=windows,
    )


def _solve(
    errors: Callable[[Floats], Floats], runs: _Runs, sought: _Sought, blocks: int = 0, first: Floats | None = None
) -> tuple[Floats, Floats, Floats]:
    """Gauss-Newton for every window at once, or for all as one block.

    Returns values, (blocks, 3), their covariances, (blocks, 3, 3), and the mean of the horizontal acceleration's slopes
    by the first two, (blocks, 2, 2).
    """
    blocks = blocks or runs.windows
    spread = runs.windows // blocks
    owner = np.repeat(np.arange(blocks), len(runs.starts) // blocks)
    number = np.bincount(owner, minlength=blocks)
    mean, sigma = sought
    value = np.tile(mean if first is None else first, (blocks, 1))
    for _ in range(12):
        base = errors(np.repeat(value, spread, axis=0))
        slopes = np.empty((*base.shape, 3))
        for k, step in enumerate(_DIFFERENCE * sigma):
            moved = value.copy()
            moved[:, k] += step
            slopes[..., k] = (errors(np.repeat(moved, spread, axis=0)) - base) / step
        information, gradient, square = np.zeros((blocks, 3, 3)), np.zeros((blocks, 3)), np.zeros(blocks)
        np.add.at(information, owner, np.einsum("nij,nik->njk", slopes, slopes))
        np.add.at(gradient, owner, np.einsum("nij,ni->nj", slopes, base))
        np.add.at(square, owner, np.sum(base**2, axis=1))
        # Runs overlap: neighbours share their noise.
        noise = square / (3 * number) * runs.steps
        held = information / noise[:, None, None] + np.diag(sigma**-2.0)
        slope = gradient / noise[:, None] + (value - mean) / sigma**2
        move = np.clip(np.linalg.solve(held, -slope[..., None])[..., 0], -_STRIDE * sigma, _STRIDE * sigma)
        value = np.clip(value + move, mean - _FARTHEST * sigma, mean + _FARTHEST * sigma)
        if np.abs(move / sigma).max() < 1e-4:
            break
    by_sought = np.zeros((blocks, 2, 2))
    np.add.at(by_sought, owner, slopes[:, :2, :2] / number[owner, None, None])
    # What a model misses in a manoeuvre lasts as long as a window: one window is one error.
    together = len(runs.starts) / runs.windows / runs.steps
    return value, np.asarray(np.linalg.inv(held) * together), by_sought
