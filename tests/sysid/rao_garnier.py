"""Rao and Garnier 2002: a fast lightly damped mode beside a slow one, non-minimum phase, simulated by SciPy."""

import numpy as np
from scipy.signal import lsim, max_len_seq

NUM, DEN = [-6400.0, 1600.0], [1.0, 5.0, 408.0, 416.0, 1600.0]
STEP, SAMPLES = 0.01, 7161


def inputs(hold: int) -> np.ndarray:
    """Return a binary sequence whose values stay for so many samples."""
    return np.repeat(max_len_seq(10)[0] * 2.0 - 1.0, hold)[:SAMPLES]


def response(u: np.ndarray) -> np.ndarray:
    """Respond to an input that is held from sample to sample, from rest."""
    return np.asarray(lsim((NUM, DEN), u, np.arange(len(u)) * STEP, interp=False)[1])


def rao_garnier(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the input of the paper, and the output with white noise at 10 dB."""
    u = inputs(7)
    y = response(u)
    return u, y + np.random.default_rng(seed).standard_normal(SAMPLES) * y.std() / np.sqrt(10.0)
