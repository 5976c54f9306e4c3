"""Which measurements the smoother may fuse: each is judged by all the others, past and future.

A gate on innovations knows the past only: after a wrong start it refuses what would have put the state right. So
nothing is refused at first, outliers only pull less (`_kernels._log_density`). The smoother then says how far each
reading lies from what all the others say; the farthest are left out, and the log is smoothed again with a narrower
gate, until the gate is that of `SensorNoise` and nothing changes (graduated non-convexity: Yang et al. 2020). What was
left out is judged anew each time and may come back. Moments at which the IMU itself disagrees are treated likewise
(`shocks`).
"""

import numpy as np

from estimation import _kernels
from estimation.faults.shocks import NARROWING
from estimation.observations import Observations

#: Passes over a log at most. Each narrows the gate eightfold, so that more serve readings on the gate's edge only.
PASSES = 6


def admit(observations: Observations, deletion: np.ndarray, gate: float) -> np.ndarray:
    """Choose the groups of measurements for the next pass, shape (g,)."""
    if len(observations.t) == 0:
        return observations.admitted
    worst = np.sqrt(np.maximum.reduceat(np.append(deletion, 0.0), observations.start[:-1]))
    worst[np.diff(observations.start) == 0] = 0.0
    level = np.full(_kernels.KINDS, gate)
    for kind in range(_kernels.KINDS):
        mine = (observations.kind == kind) & observations.admitted
        if mine.any():
            level[kind] = max(gate, float(worst[mine].max()) / NARROWING)
    limit = np.where(observations.admitted, level[observations.kind], gate)
    return np.asarray(worst <= limit)
