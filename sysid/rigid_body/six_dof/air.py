"""The wind that a craft feels, from its motion and a model of its drag.

A craft that leans into the wind is held by thrust, so that a battery which is fuller than those of the records fitted
looks like wind: 5 % of thrust at 17 degrees of lean are 0.14 m/s^2. Wind and thrust are therefore followed together by
the filter of `sysid.rigid_body.carried`; height tells the thrust.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.records.experiment import Experiment, ExperimentError, Floats
from sysid.rigid_body.body_motion import OWN, Increments
from sysid.rigid_body.carried import ANY_FLIGHT, ANY_SIGMA, SETTLING_SECONDS, follow, smoothed_wind
from sysid.rigid_body.six_dof._kernels import ahead
from sysid.rigid_body.six_dof.body_record import BodyRecord, drives
from sysid.rigid_body.six_dof.correction import upright_axes
from sysid.rigid_body.six_dof.model import SixDofModel, substeps

#: Of a record before it begins: standard deviations of exponent, thrust over the model's, as `fit.FAMILIES` has it of a
#: battery's charge, and wind, m/s.
_SIGMA = np.array([ANY_SIGMA[0], 0.1, 15.0, 15.0])


@dataclass(frozen=True, slots=True, kw_only=True)
class WindTrack:
    """Wind by time."""

    t: Floats  #: shape (B,): s, every fifth of a second.
    wind: Floats  #: shape (B, 2): North and east, m/s, as the air moves.
    sigma: Floats  #: shape (B, 2): By the smoother, and by what the model misses of drag and level.
    mean: Floats  #: shape (2,): Of the whole record.
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
    record = model.record(still)
    blocks = _increments(model, record, ANY_FLIGHT, np.zeros(2))
    level = upright_axes(record, blocks.edges[:-1])
    missed, thrust = (
        np.einsum("nji,nj->ni", level, change) / blocks.seconds for change in (blocks.missed, blocks.by_flight[:, :, 1])
    )
    size = round(5.0 / blocks.seconds)  # manoeuvres, during which the model errs this way and that, are shorter
    _require(record, len(missed) >= size)
    leans = []
    for window in np.split(np.arange(len(missed) // size * size), len(missed) // size):
        up, by_up = missed[window, 2], thrust[window, 2]
        # What height misses is thrust, which leans with the craft.
        leans.append((missed[window] - up @ by_up / (by_up @ by_up) * thrust[window])[:, :2].mean(axis=0))
    return np.array([_usual(column) for column in np.array(leans).T])


def _usual(values: Floats) -> float:
    """Mean of the values that are near their median."""
    away = np.abs(values - np.median(values))
    # Three standard deviations, in median distances.
    return float(values[away <= 4.4 * np.median(away) + 1e-12].mean())


def estimate_wind(model: SixDofModel, experiment: Experiment, trim: Floats | None = None) -> WindTrack:
    """Estimate the horizontal wind of a record with a model whose drag is known.

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
        When the record is shorter than a second.
    """
    record = model.record(experiment)
    _require(record, record.t[-1] - record.t[0] > 1.0)
    early, lean = record.cut(0, max(round(SETTLING_SECONDS / record.dt), 2)), np.zeros(2) if trim is None else trim

    def blocks_of(own: Floats, *, beginning: bool) -> Increments:
        return _increments(model, early if beginning else record, own, lean)

    states = follow(blocks_of, (ANY_FLIGHT, _SIGMA), np.zeros((0, 0)))
    blocks = blocks_of(states.about, beginning=False)
    wind, covariances = smoothed_wind(states, blocks.seconds)
    to_wind = np.linalg.pinv(blocks.by_flight[:, :2, len(OWN) :].mean(axis=0) / blocks.seconds)
    # What all of a record may miss, m/s^2: by a law of drag that does not hold at every speed, and without a trim by a
    # level that is off by 0.3 deg. In a tunnel, flown by two controllers, known winds of 0 to 12 m/s were 0.2 m/s
    # off with a trim, 0.25 without; 0.1 m/s^2 are 0.24 m/s there.
    missed = 0.1 if trim is not None else float(np.hypot(0.1, 0.05))
    feigned = np.diag(to_wind @ to_wind.T) * missed**2
    noise = np.diag(to_wind @ to_wind.T) * states.wander.horizontal_noise / (record.t[-1] - record.t[0])
    return WindTrack(
        t=record.t[states.edges],
        wind=wind,
        sigma=np.sqrt(covariances.diagonal(axis1=1, axis2=2) + feigned),
        mean=wind.mean(axis=0),
        mean_sigma=np.sqrt(noise + feigned),
    )


def _require(record: BodyRecord, enough: bool) -> None:
    if not enough:
        raise ExperimentError(f"{record.name}: a record of {record.t[-1] - record.t[0]:.1f} s shows no wind")


def _increments(model: SixDofModel, record: BodyRecord, own: Floats, lean: Floats) -> Increments:
    """Compare changes of velocity with the model's about a thrust and a wind, with an unmodelled tilt."""
    dt, drive = record.dt, drives(record, model.kinds, model.shape)
    size = min(max(round(0.2 / dt), 1), len(record.t) - 1)
    edges = np.arange(0, len(record.t), size)
    starts, marks, push = edges[:-1], np.array([size]), np.zeros((len(edges) - 1, 6))
    push[:, :3] = upright_axes(record, starts)[:, :, :2] @ lean

    def change(at: Floats) -> Floats:
        wind, driven = np.zeros((len(record.t), 3)), drive.copy()
        wind[:, :2] = at[len(OWN) :]
        driven[:, [0, 7]] *= at[1]
        if not record.speeds:
            driven[:, 6] *= np.sqrt(at[1])
        run = ahead(model.theta, driven, wind, push, record.states, starts, marks, dt, substeps(dt), True)
        return np.asarray(run[:, 0, 3:6] - record.states[starts, 3:6])

    expected, by_flight = change(own), np.zeros((len(starts), 3, len(own)))
    for k in range(1, len(own)):
        step = 0.05 * _SIGMA[k]
        by_flight[:, :, k] = (change(own + step * np.eye(len(own))[k]) - expected) / step
    missed = np.diff(record.states[edges, 3:6], axis=0) - expected
    return Increments(
        edges=edges, seconds=size * dt, missed=missed, by_craft=np.zeros((len(starts), 3, 0)), by_flight=by_flight
    )
