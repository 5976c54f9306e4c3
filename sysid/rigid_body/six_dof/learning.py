"""Learn what a model leaves over: how long an observer remembers, and corrections that held-out records gain from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from sysid.records.experiment import Experiment, ExperimentError, Floats, horizon_steps, require_alike
from sysid.rigid_body.six_dof.correction import HorizonCorrection, Observer, features, upright_axes
from sysid.rigid_body.six_dof.model import SixDofModel
from sysid.rigid_body.six_dof.shooting import state_errors

_STATES = ("position", "velocity", "attitude", "rates")


def choose_observer(model: SixDofModel, experiments: Experiment | Sequence[Experiment], horizon: float) -> SixDofModel:
    """Return the model with the observer that predicts positions of its training records best, or with none.

    A short memory follows gusts, a long one averages noise, and which is better depends on the air, the sensors and how
    far ahead is asked for. Horizontal and vertical forces are chosen by their own errors, then torques.

    Parameters
    ----------
    model : SixDofModel
    experiments : Experiment or sequence of Experiment
    horizon : float
        s.

    Raises
    ------
    ExperimentError
        When no record is twice as long as the horizon.
    """
    stranger = model.as_for_a_stranger()
    records = [model.record(experiment) for experiment in require_alike(experiments)]
    if len(records) == 1 and not records[0].speeds:
        # One record has one load and one battery, and does not show what an observer is for: another has others,
        # of which thrust at the same command differs by a tenth.
        stranger = replace(stranger, shape=replace(stranger.shape, charges={records[0].name: 1.1}))
    steps = horizon_steps(horizon, records[0].dt)
    records = [record for record in records if len(record.t) > 2 * steps]
    if not records:
        raise ExperimentError(f"no record is longer than twice the horizon of {horizon:g} s")

    def errors(observer: Observer) -> Floats:
        """Mean errors of position, horizontally, vertically and in all."""
        watching, total = stranger.with_observer(observer), np.zeros(3)
        for record in records:
            starts = np.linspace(steps // 2, len(record.t) - steps - 1, min(300, steps)).astype(np.int64)
            predicted = watching.ahead(record, starts, np.array([steps]))[:, 0, :3]
            left = predicted - record.states[starts + steps, :3]
            parts = (left[:, :2], left[:, 2:], left)
            total += [float(np.mean(np.linalg.norm(part, axis=1))) for part in parts]
        return total

    memories = np.array([0.0, 1.5, 3.0, 6.0, 12.0, 24.0, 48.0])
    level, height, _ = memories[np.argmin([errors(Observer(memory, 0.0)) for memory in memories], axis=0)].tolist()
    turn = 0.0
    if not model.attitude_given:
        turn = min(memories.tolist(), key=lambda memory: errors(Observer(level, memory, height))[2])
    best = Observer(level, turn, height)
    return model.with_observer(None if best == Observer(0.0, 0.0, 0.0) else best)


def learn_correction(
    model: SixDofModel,
    experiments: Experiment | Sequence[Experiment],
    horizon: float,
    memory: float = 0.0,
    ridge: float = 1e-3,
) -> SixDofModel:
    """Return the model with a correction of what it leaves over, learned from its training records.

    Records are left out in turn, in groups of neighbours; a state is corrected only if its errors become smaller by 1
    percent at least on most of them. Without such a state the model is returned as it is.

    Parameters
    ----------
    model : SixDofModel
    experiments : Experiment or sequence of Experiment
        Two or more.
    horizon : float
        s; predictions up to it are corrected.
    memory : float
        Time constant of what is remembered from before the start, s. With one the model also gets an observer of this
        memory, which holds what it missed. 0: only the start and the inputs since then.
    ridge : float
        Of features scaled to unit variance, over their number of samples.

    Raises
    ------
    ExperimentError
        When there is only one record, or nothing is longer than the horizon.
    """
    records = require_alike(experiments)
    if len(records) < 2:
        raise ExperimentError("a correction is kept if records that it was not learned from gain: give two at least")
    if memory > 0.0:
        model = model.with_observer(Observer(memory, 0.0 if model.attitude_given else memory))
    model = model.with_correction(None)
    steps = horizon_steps(horizon, model.record(records[0]).dt)
    stranger = model.as_for_a_stranger()
    total = sum(max(len(record.t) - steps - 1, 0) for record in records)
    if total < 4 * steps:
        raise ExperimentError(f"{total} samples are too few to learn corrections of {horizon:g} s")
    table, goals, remembered = [], [], 0.0
    # Errors of all runs together take 8 bytes each.
    every = max(total // min(60_000, 40_000_000 // (12 * steps)), 1)
    for experiment in records:
        record = model.record(experiment)
        remembered = memory / record.dt
        starts = np.arange(0, max(len(record.t) - steps - 1, 0), every)
        missed = stranger.missed(record) if memory > 0.0 else None
        table.append(features(record, starts, steps, remembered, missed, model.attitude_given))
        measured = record.states[starts[:, None] + np.arange(1, steps + 1)]
        errors = state_errors(stranger.ahead(record, starts, np.arange(1, steps + 1)), measured)
        upright = upright_axes(record, starts)
        for part in (slice(0, 3), slice(3, 6)):
            errors[..., part] = np.einsum("nji,nmj->nmi", upright, errors[..., part])
        goals.append(errors.reshape(len(starts), steps, 4, 3))
    states = (0, 1) if model.attitude_given else (0, 1, 2, 3)
    gains = gains_of_order(table, goals, states, ridge)
    kept = {_STATES[state]: gain for state, gain in zip(states, gains, strict=True) if gain > 1.0}
    if not kept:
        return model
    x, goal = np.concatenate(table), np.concatenate(goals)
    centre, width = _scaling(x)
    weights = np.zeros((x.shape[1], steps, 12))
    for state in states:
        if _STATES[state] in kept:
            weights[:, :, 3 * state : 3 * state + 3] = _solve((x - centre) / width, goal[:, :, state], ridge)
    return model.with_correction(
        HorizonCorrection(
            steps=steps, memory=remembered, weights=weights, centre=centre, width=width, gain_percent=kept
        )
    )


def gains_of_order(
    table: Sequence[Floats], goals: Sequence[Floats], states: Sequence[int], ridge: float
) -> list[float]:
    """By how many percent errors of records left out become smaller, in the median of them; by state.

    Not of the record that gains least: of flights in five winds the strongest and the calm, left out, are beyond what
    the others know and lose, while flights within are predicted twice as well.

    Shapes: each of `table` (S, F), of `goals` (S, steps, states, 3).
    """
    every = max(sum(map(len, table)) // 15_000, 1)
    gains = np.zeros((len(table), len(states)))
    for out in np.array_split(np.arange(len(table)), min(4, len(table))):
        known = [k for k in range(len(table)) if k not in out]
        x = np.concatenate([table[k][::every] for k in known])
        centre, width = _scaling(x)
        for at, state in enumerate(states):
            weights = _solve((x - centre) / width, np.concatenate([goals[k][::every, :, state] for k in known]), ridge)
            for k in out:
                truth = goals[k][::every, :, state]
                left = truth - np.tensordot((table[k][::every] - centre) / width, weights, axes=1)
                before = np.linalg.norm(truth, axis=2).sum()
                gains[k, at] = 1.0 - np.linalg.norm(left, axis=2).sum() / max(float(before), 1e-12)
    return [float(value) for value in 100.0 * np.median(gains, axis=0)]


def _scaling(x: Floats) -> tuple[Floats, Floats]:
    """Mean and spread of features; those of the constant are 0 and 1."""
    centre, width = x.mean(axis=0), np.maximum(x.std(axis=0), 1e-9)
    centre[-1], width[-1] = 0.0, 1.0
    return centre, width


def _solve(x: Floats, goal: Floats, ridge: float) -> Floats:
    """Weights (F, steps, 3) of errors (S, steps, 3); runs that err more than usual count less, as in `shooting`."""
    target = goal.reshape(len(goal), -1)
    count = np.ones(len(x))
    for last in (False, False, True):
        weighted = x * count[:, None]
        lhs = weighted.T @ x
        lhs[np.diag_indices_from(lhs)] += ridge * count.sum() * np.r_[np.ones(x.shape[1] - 1), 1e-6]
        solution = cho_solve(cho_factor(lhs), weighted.T @ target)
        if last:
            break
        left = np.linalg.norm((target - x @ solution).reshape(goal.shape), axis=2).mean(axis=1)
        count = 1.0 / np.maximum(left, 0.3 * max(float(np.median(left)), 1e-12))
        count /= count.mean()
    return np.asarray(solution.reshape(x.shape[1], *goal.shape[1:]))
