"""The 24 transfer functions of Elhesasy 2024, table A1, and records simulated with them.

Signs lost in print are restored: two terms without a sign between them had a minus; exponents of ten are negative.
Whether leading numerator coefficients had one cannot be told; they are taken as positive. Simulated by SciPy, not by
the code under test.
"""

import numpy as np
from scipy.signal import cont2discrete, lfilter

from sysid import Experiment

#: For each output and motor: numerator and denominator, highest power of s first, PWM in us to metres.
TABLE_A1 = {
    "x": (
        ([0.03763, 0.002489, -0.001584, 0.0001155], [1, 0.6445, 0.5608, 0.08863, 0.01788, 0.001963]),
        ([0.006834, -0.002947, 0.0002309, -5.883e-06], [1, 0.1561, 0.3549, 0.0314, 0.004891, 0.0003112]),
        ([0.002853, 0.0003496, -0.0003795, 1.622e-05], [1, 0.1433, 0.3097, 0.02573, 0.003972, 0.0002574]),
        ([0.008742, 0.004984, -0.0002634, 9.384e-07], [1, 0.1215, 0.3774, 0.007844, 0.004491, 2.069e-05]),
        ([0.003381, -0.0004579, 0.0001445, -1.811e-05], [1, 0.0637, 0.5037, 0.01239, 0.03836, 2.315e-06]),
        ([0.005546, -9.939e-05, 0.0001855, -9.776e-06], [1, 0.1817, 0.4151, 0.01623, 0.01876, 3.792e-05]),
        ([0.003118, 0.000201, -8.806e-05, 3.771e-07], [1, 0.3431, 0.3228, 0.1096, 0.009678, 0.003016]),
        ([0.03252, 0.002262, 0.0009105, 3.706e-05], [1, 1.289, 0.7775, 0.547, 0.02208, 0.01494]),
    ),
    "y": (
        ([0.004774, 0.0004801, -0.0006251, 4.01e-05], [1, 0.183, 0.1968, 0.03112, 0.007083, 0.0009654]),
        ([0.03762, -0.005889, 0.001507, -0.0001432], [1, 1.223, 0.3459, 0.189, 0.01474, 0.005842]),
        ([0.004894, 0.001171, -0.0002954, 5.677e-06], [1, 0.64, 0.1353, 0.05182, 0.003813, 0.0007058]),
        ([0.003143, 0.001571, -0.0006078, 2.056e-05], [1, 0.09584, 0.3482, 0.02375, 0.01813, 0.001071]),
        ([0.009232, -0.00176, 0.001969, -6.105e-05], [1, 0.3486, 0.3259, 0.09574, 0.009572, 0.001842]),
        ([0.01741, -0.0009259, 0.0005982, 1.107e-06], [1, 1.638, 0.1645, 0.1609, 0.005497, 0.002847]),
        ([0.05653, 0.007174, -0.001785, -5.354e-06], [1, 1.27, 0.3704, 0.1245, 0.01474, 0.002413]),
        ([0.003189, -0.0004852, 9.507e-05, -4.88e-07], [1, 0.4673, 0.09011, 0.01618, 0.001274, 8.676e-05]),
    ),
    "z": (
        ([0.004539, 0.001265, -0.001198, 0.000185], [1, 0.4254, 0.4546, 0.163, 0.0325, 0.003681]),
        ([0.0009036, 0.0001257, -5.012e-05, 1.77e-06], [1, 0.1076, 0.5491, 0.01299, 0.02888, 0.0003198]),
        ([0.004021, 0.0006801, -7.302e-05, -1.04e-05], [1, 1.175, 0.733, 0.3635, 0.04381, 0.01292]),
        ([0.001273, -0.0008118, 0.0003682, -4.376e-05], [1, 0.3127, 0.4214, 0.1158, 0.02064, 0.002061]),
        ([0.001381, 0.0005894, -0.0003129, 2.359e-05], [1, 0.4434, 0.3674, 0.1123, 0.02669, 0.003242]),
        ([0.000354, -0.001099, 7.059e-05, -3.945e-06], [1, 0.1835, 0.3114, 0.03359, 0.009652, 4.099e-05]),
        ([0.002768, 0.00159, -0.0001924, 6.031e-06], [1, 0.5096, 0.5482, 0.05477, 0.02011, 0.0004455]),
        ([0.006486, -0.001106, 0.001834, -0.0001821], [1, 0.9811, 0.4612, 0.3733, 0.02799, 0.008418]),
    ),
}

#: White noise of the outputs, m.
NOISE = 0.05


def held(g: tuple[list[float], list[float]], u: np.ndarray, dt: float) -> np.ndarray:
    """Respond to an input that is held from sample to sample."""
    numerator, denominator, _ = cont2discrete(g, dt, "zoh")
    return lfilter(numerator[0], denominator, u)


def record(seed: int, number: int, outputs: str = "xyz") -> tuple[Experiment, np.ndarray]:
    """Simulate 180 s at 10 Hz from rest, with eight correlated inputs.

    Returns the record, with noise, of a number in the set of this seed, and its outputs without, shape (1800, p).
    """
    samples, dt = 1800, 0.1
    rng = np.random.default_rng([seed, number])
    u = lfilter([1.0], [1.0, -0.9], rng.standard_normal((samples, 8)) @ (np.eye(8) + 0.5), axis=0)
    u = 50.0 * u / u.std(axis=0)
    t = np.arange(samples) * dt
    clean = np.column_stack([sum(held(g, u[:, j], dt) for j, g in enumerate(TABLE_A1[output])) for output in outputs])
    experiment = Experiment.from_arrays(
        t,
        1500.0 + u,
        clean + NOISE * rng.standard_normal(clean.shape),
        name=f"set {seed}, record {number}",
        output_names=tuple(outputs),
        input_trim=np.full(8, 1500.0),
    )
    return experiment, clean
