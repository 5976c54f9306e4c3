"""What a model with six degrees of freedom leaves over: the forces and torques that it misses, and what it predicts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from sysid.records.experiment import Experiment, Floats, horizon_steps, require_alike
from sysid.rigid_body.six_dof.body_record import BodyRecord
from sysid.rigid_body.six_dof.model import SixDofModel
from sysid.statistics.residuals import ResidualTest, examine_residuals

#: Accelerations in body axes (forward, right, down) and their units.
CHANNELS = (
    ("force forward", "m/s^2"),
    ("force right", "m/s^2"),
    ("force down", "m/s^2"),
    ("torque in roll", "rad/s^2"),
    ("torque in pitch", "rad/s^2"),
    ("torque in yaw", "rad/s^2"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Missed:
    """An acceleration of the body that the model misses from one sample to the next."""

    name: str
    unit: str
    rms: float
    whole: float  #: Spread of the acceleration itself.
    test: ResidualTest | None  #: None for records too short to test.


@dataclass(frozen=True, slots=True, kw_only=True)
class PredictedStates:
    """A record beside its prediction from every measured state some time before."""

    record: str
    horizon: float  #: s
    t: Floats  #: shape (N,): s.
    #: shape (N, 6): Position north, east, up [m], and roll, pitch, yaw [rad].
    measured: Floats
    predicted: Floats


def missed_motion(model: SixDofModel, experiments: Experiment | Sequence[Experiment]) -> tuple[Missed, ...]:
    """Test what the model misses one sample ahead, in body axes, for colour and for dependence on the inputs."""
    bare = model.with_observer(None)
    records = [bare.record(experiment) for experiment in require_alike(experiments)]
    missed = [_in_body(record, bare.missed(record))[1:] for record in records]
    whole = [_in_body(record, _accelerations(record))[1:] for record in records]
    inputs = [record.inputs[1:] for record in records]
    count = 3 if model.attitude_given else len(CHANNELS)
    return tuple(
        Missed(
            name=name,
            unit=unit,
            rms=float(np.sqrt(np.mean(np.concatenate([each[:, at] for each in missed]) ** 2))),
            whole=float(np.std(np.concatenate([each[:, at] for each in whole]))),
            test=examine_residuals(name, [each[:, at] for each in missed], inputs, model.kinds.names),
        )
        for at, (name, unit) in enumerate(CHANNELS[:count])
    )


def predict_record(model: SixDofModel, experiment: Experiment, horizon: float) -> PredictedStates | None:
    """Predict every sample from the state measured `horizon` seconds before; None for too short a record."""
    record = model.record(experiment)
    steps = horizon_steps(horizon, record.dt)
    if len(record.t) < 3 * steps:
        return None
    starts = np.arange(len(record.t) - steps)
    predicted = model.ahead(record, starts, np.array([steps]))[:, 0]
    return PredictedStates(
        record=experiment.name,
        horizon=horizon,
        t=record.t[steps:],
        measured=_shown(record.states[steps:]),
        predicted=_shown(predicted),
    )


def _in_body(record: BodyRecord, accelerations: Floats) -> Floats:
    """Turn accelerations in world axes into body axes; angular ones are there already."""
    rotation = record.states[:, 6:15].reshape(-1, 3, 3)
    return np.hstack([np.einsum("nji,nj->ni", rotation, accelerations[:, :3]), accelerations[:, 3:]])


def _accelerations(record: BodyRecord) -> Floats:
    """Return the changes of velocity and rates up to each sample, over the sample interval."""
    moved = np.hstack([record.states[:, 3:6], record.states[:, 15:]])
    return np.vstack([np.zeros((1, 6)), np.diff(moved, axis=0) / record.dt])


def _shown(states: Floats) -> Floats:
    """Position north, east, up and roll, pitch, yaw of states."""
    yaw, pitch, roll = Rotation.from_matrix(states[:, 6:15].reshape(-1, 3, 3)).as_euler("ZYX").T
    return np.column_stack([states[:, :2], -states[:, 2], roll, pitch, np.unwrap(yaw)])
