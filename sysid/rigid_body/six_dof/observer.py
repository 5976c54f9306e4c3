"""How long what pushes a craft beside its model is remembered: gusts, a sagging battery, trim."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid.records.experiment import Experiment, ExperimentError, Floats, horizon_steps, require_alike
from sysid.rigid_body.six_dof.model import Observer, SixDofModel

#: Horizontal, vertical, and all of a position.
_PARTS = (slice(0, 2), slice(2, 3), slice(0, 3))

#: Memories of an observer that are tried, s, and starts of each record that they are tried on.
_MEMORIES, _STARTS = (1.5, 3.0, 6.0, 12.0, 24.0, 48.0), 300


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
    steps = horizon_steps(horizon, records[0].dt)
    records = [record for record in records if len(record.t) > 2 * steps]
    if not records:
        raise ExperimentError(f"no record is longer than twice the horizon of {horizon:g} s")

    def errors(observer: Observer) -> Floats:
        """Mean errors of position, horizontally, vertically and in all."""
        watching, total = stranger.with_observer(observer), np.zeros(3)
        for record in records:
            starts = np.linspace(steps // 2, len(record.t) - steps - 1, min(_STARTS, steps)).astype(np.int64)
            found = watching.ahead(record, starts, np.array([steps]))[:, 0, :3]
            left = found - record.states[starts + steps, :3]
            total += [float(np.mean(np.linalg.norm(left[:, part], axis=1))) for part in _PARTS]
        return total

    memories = np.array([0.0, *_MEMORIES])
    level, height, _ = memories[np.argmin([errors(Observer(memory, 0.0)) for memory in memories], axis=0)].tolist()
    turn = 0.0
    if not model.attitude_given:
        turn = min(memories.tolist(), key=lambda memory: errors(Observer(level, memory, height))[2])
    best = Observer(level, turn, height)
    return model.with_observer(None if best == Observer(0.0, 0.0, 0.0) else best)
