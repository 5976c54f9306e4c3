"""Records simulated with known transfer functions, by SciPy and not by the code under test."""

import numpy as np
from scipy.signal import lfilter, lsim

from sysid import Experiment

#: A fast well-damped and a slow lightly damped system, two zeros and one: numerators and denominators in seconds.
TRUE = {
    "y1": (([2.0, 1.0], [1.0, 1.6, 4.0, 1.2]), ([-0.6, 0.9], [1.0, 0.9, 1.5, 0.5])),
    "y2": (([0.5, -0.8], [1.0, 2.1, 2.0, 0.9]), ([1.5, 0.3], [1.0, 1.2, 3.0, 0.8])),
}


def motion(rng: np.random.Generator, samples: int, inputs: int = 2) -> np.ndarray:
    """Random inputs as a controller gives them: correlated in time, unit variance; shape (samples, inputs)."""
    u = lfilter([1.0], [1.0, -0.8], rng.standard_normal((samples, inputs)), axis=0)
    return u / u.std(axis=0)


def simulated_record(
    seed: int,
    samples: int = 1500,
    dt: float = 0.1,
    noise: float = 0.05,
    offset: float = 0.0,
    from_rest: bool = True,
    systems=TRUE,
    hold: str = "zoh",
) -> Experiment:
    """Simulate `systems` with white noise; not from rest, the record begins in the middle of a longer motion."""
    rng = np.random.default_rng(seed)
    extra = 0 if from_rest else 300
    u = motion(rng, samples + extra, len(next(iter(systems.values()))))
    t = np.arange(samples + extra) * dt
    y = np.column_stack(
        [sum(lsim(g, u[:, j], t, interp=hold == "foh")[1] for j, g in enumerate(row)) for row in systems.values()]
    )
    y = y + offset + noise * rng.standard_normal(y.shape)
    return Experiment.from_arrays(
        t[extra:] - t[extra],
        1500.0 + 50.0 * u[extra:],
        y[extra:],
        name=f"record {seed}",
        input_trim=np.full(u.shape[1], 1500.0),
        output_names=list(systems),
    )
