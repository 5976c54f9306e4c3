"""Predictions of the whole state by horizon, what they are worth, and the forces and torques that a model misses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from core.summary import Summarised
from core.table import Table
from sysid.records.experiment import Experiment, Floats, horizon_steps, require_alike
from sysid.rigid_body.six_dof.body_record import BodyRecord
from sysid.rigid_body.six_dof.model import SixDofModel
from sysid.rigid_body.six_dof.shooting import state_errors
from sysid.statistics.residual_test import ResidualTest
from sysid.statistics.residuals import examine_residuals

#: States that are judged, with their units.
STATES = {"position": "m", "velocity": "m/s", "attitude": "rad", "rates": "rad/s"}


@dataclass(frozen=True, slots=True, kw_only=True)
class StateErrors:
    """Errors of predictions to one horizon on one record, RMS of norms."""

    record: str
    horizon: float  #: s
    state: str  #: ``position`` [m], ``velocity`` [m/s], ``attitude`` [rad], ``rates`` [rad/s].
    model: float  #: Of the model.
    held: float  #: Of the state that stays.
    carried_on: float | None  #: Of constant velocity, for position.


@dataclass(frozen=True, slots=True, kw_only=True)
class StateVerdict:
    """How far ahead a state is predicted better than by the simplest means."""

    state: str
    unit: str
    useful: bool  #: Whether the model is better at any horizon.
    #: The longest horizon at which it is, else the longest that was judged, s; None when the records are too short.
    horizon: float | None
    #: There, mean over records of the RMS of the model, and of the better of a state that stays and constant velocity.
    model: float | None
    simple: float | None

    @property
    def sentence(self) -> str:
        """The verdict in words."""
        if self.horizon is None:
            return f"{self.state}: not judged, the records are too short"
        warning = "" if self.useful else "do not use it: "
        ahead = f"{self.model:.3g} {self.unit} {self.horizon:g} s ahead"
        return f"{self.state}: {warning}{ahead}, against {self.simple:.3g} {self.unit} without a model"


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class StateValidation(Summarised):
    """Errors of every state, horizon and record, and a verdict for each state."""

    errors: tuple[StateErrors, ...]
    verdicts: tuple[StateVerdict, ...]

    @property
    def table(self) -> pd.DataFrame:
        """The errors as rows."""
        return pd.DataFrame([asdict(error) for error in self.errors])

    def summary(self) -> dict[str, str]:
        """Return how far ahead each state is predicted."""
        return {verdict.state: verdict.sentence.removeprefix(f"{verdict.state}: ") for verdict in self.verdicts}

    def _repr_html_(self) -> str:
        """Return the table and the verdicts for a notebook."""
        return Table.from_frame(self.table).html() + "".join(f"<p>{verdict.sentence}</p>" for verdict in self.verdicts)


def validate_states(model: SixDofModel, experiments: Experiment | Sequence[Experiment]) -> StateValidation:
    """Judge predictions of the whole state on records that the model has not seen.

    Parameters
    ----------
    model : SixDofModel
    experiments : Experiment or sequence of Experiment

    Returns
    -------
    StateValidation
        RMS errors of the model 0.1 to 2 s ahead, beside those of a state that stays and of constant velocity.

    Raises
    ------
    MissingDataError
        When a record has other inputs than the model, or motion is missing.
    """
    errors = [error for record in require_alike(experiments) for error in _errors_by_horizon(model, record)]
    verdicts = tuple(_verdict(state, unit, errors) for state, unit in STATES.items())
    return StateValidation(errors=tuple(errors), verdicts=verdicts)


def _errors_by_horizon(model: SixDofModel, experiment: Experiment) -> list[StateErrors]:
    """RMS errors of every state at every horizon that fits into the record."""
    record = model.record(experiment)
    marks = [max(round(horizon / record.dt), 1) for horizon in (0.1, 0.25, 0.5, 1.0, 2.0)]
    marks = sorted({mark for mark in marks if mark < len(record.t) // 2})
    if not marks:
        return []
    every = max(len(record.t) // 2000, 1)
    starts = np.arange(0, len(record.t) - marks[-1], every)
    predicted = model.ahead(record, starts, np.array(marks))
    out: list[StateErrors] = []
    for k, mark in enumerate(marks):
        truth = record.states[starts + mark]
        ours = _rms(state_errors(predicted[:, k], truth))
        held = _rms(state_errors(record.states[starts], truth))
        moved = record.states[starts].copy()
        moved[:, :3] += mark * record.dt * moved[:, 3:6]
        carried = _rms(state_errors(moved, truth))
        out += [
            StateErrors(
                record=experiment.name,
                horizon=float(mark * record.dt),
                state=state,
                model=ours[at],
                held=held[at],
                carried_on=carried[at] if state == "position" else None,
            )
            for at, state in enumerate(STATES)
        ]
    return out


def _rms(errors: np.ndarray) -> list[float]:
    # A model that runs away is as bad as the largest number that can be written.
    held = np.nan_to_num(np.clip(errors, -1e6, 1e6), nan=1e6)
    squares = (held.reshape(len(errors), 4, 3) ** 2).sum(axis=2).mean(axis=0)
    return [float(value) for value in np.sqrt(squares)]


def _verdict(state: str, unit: str, errors: Sequence[StateErrors]) -> StateVerdict:
    """Find the longest horizon at which the model beats the simplest means."""
    rows = [error for error in errors if error.state == state]
    if not rows:
        return StateVerdict(state=state, unit=unit, useful=False, horizon=None, model=None, simple=None)
    judged = []
    for horizon in sorted({row.horizon for row in rows}):
        here = [row for row in rows if row.horizon == horizon]
        ours = float(np.mean([row.model for row in here]))
        simple = float(np.mean([min(row.held, row.carried_on or row.held) for row in here]))
        judged.append((horizon, ours, simple))
    good = [row for row in judged if row[1] < 0.9 * row[2]]
    horizon, ours, simple = (good or judged)[-1]
    return StateVerdict(state=state, unit=unit, useful=bool(good), horizon=horizon, model=ours, simple=simple)


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
    bare = model.with_observer(None).with_correction(None)
    records = [bare.record(experiment) for experiment in require_alike(experiments)]
    missed = [_in_body(record, bare.missed(record))[1:] for record in records]
    whole = [_in_body(record, _accelerations(record))[1:] for record in records]
    inputs = [record.inputs[1:] for record in records]
    channels = [(f"force {side}", "m/s^2") for side in ("forward", "right", "down")]
    if not model.attitude_given:
        channels += [(f"torque in {axis}", "rad/s^2") for axis in ("roll", "pitch", "yaw")]
    return tuple(
        Missed(
            name=name,
            unit=unit,
            rms=float(np.sqrt(np.mean(np.concatenate([flight[:, at] for flight in missed]) ** 2))),
            whole=float(np.std(np.concatenate([flight[:, at] for flight in whole]))),
            test=examine_residuals(name, [flight[:, at] for flight in missed], inputs, model.kinds.names),
        )
        for at, (name, unit) in enumerate(channels)
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
