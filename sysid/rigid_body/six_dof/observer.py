"""What pushes a craft that its model does not know, from the samples before a start: gusts, a sagging battery, trim.

The model's one-sample error of velocity and rates, over the sample interval, is the acceleration that it misses; its
exponentially weighted mean over the past, up to the start and not beyond, is held over the prediction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.records.experiment import Floats
from sysid.records.filtering import lfilter
from sysid.rigid_body.six_dof._kernels import ahead
from sysid.rigid_body.six_dof.body_record import BodyRecord

#: Length of the past below which nothing is held, s.
_ENOUGH = 1.0


@dataclass(frozen=True, slots=True)
class Observer:
    """Memory of the mean of what is missing."""

    #: s; 0 leaves the part out.
    force_memory: float = 0.5
    torque_memory: float = 0.3
    #: Of the vertical force, s; None: as of the others. A battery lasts a flight, gusts and trim do not.
    lift_memory: float | None = None


def missed_accelerations(
    theta: Floats, drives: Floats, wind: Floats, record: BodyRecord, substeps: int, given: bool
) -> Floats:
    """Accelerations (world) and angular accelerations (body) that the model missed up to each sample, (N, 6).

    Parameters
    ----------
    drives : ndarray, shape (N, 8 + e)
    wind : ndarray, shape (N, 3)
    """
    n, dt = len(record.t), record.dt
    starts = np.arange(n - 1, dtype=np.int64)
    one = ahead(theta, drives, wind, np.zeros((n - 1, 6)), record.states, starts, np.array([1]), dt, substeps, given)[
        :, 0
    ]
    missed = np.zeros((n, 6))
    missed[1:, :3] = (record.states[1:, 3:6] - one[:, 3:6]) / dt
    missed[1:, 3:] = (record.states[1:, 15:] - one[:, 15:]) / dt
    return missed


def pushes(observer: Observer, missed: Floats, dt: float) -> Floats:
    """Mean of what was missed before each sample, (N, 6).

    Parameters
    ----------
    missed : ndarray, shape (N, 6)
    """
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
        out[:, columns] = mean * (np.arange(len(missed)) * dt > min(_ENOUGH, memory))[:, None]
    return out
