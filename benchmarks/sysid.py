"""How fast and how well transfer functions are found: Rao-Garnier, and problems of the size of Elhesasy 2024."""

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from scipy.signal import lfilter, lsim, max_len_seq

from sysid import Experiment, fit_transfer_functions
from sysid.response import discretise
from sysid.sections import denominators

#: Rao and Garnier 2002: a fast lightly damped mode beside a slow one, non-minimum phase.
NUM, DEN = [-6400.0, 1600.0], [1.0, 5.0, 408.0, 416.0, 1600.0]
STEP, SAMPLES, SEEDS = 0.01, 7161, 20


def run() -> list[tuple[str, str, str, str, str]]:
    return [*rao_garnier(), *paper_size()]


def rao_garnier() -> list[tuple[str, str, str, str, str]]:
    """Fit 20 seeds at 10 dB and judge the free run on a clean record with another input."""
    records = [_rao_garnier_record(seed) for seed in range(SEEDS)]
    fresh = _inputs(SAMPLES, 8)
    clean = _response(fresh)
    test = Experiment.from_arrays(np.arange(SAMPLES) * STEP, fresh, clean, input_trim=[0.0], output_trim=[0.0])
    truth = np.array([*NUM, *DEN[1:]])
    fit_transfer_functions(records[:1], 4, 1)  # compiles
    fits, errors, deviations, seconds = [], [], [], []
    for seed, record in enumerate(records):
        begun = time.process_time()
        model = fit_transfer_functions([record], 4, 1, seed=seed)
        seconds.append(time.process_time() - begun)
        function = model.transfer_functions["y1"]["u1"]
        errors.append(np.concatenate([function.num, function.den[1:]]) - truth)
        deviations.append(function.standard_deviation)
        fits.append(_fit_percent(clean, model.simulate(test)[:, 0]))
    ratio = np.sqrt(np.mean(np.square(errors), axis=0)) / np.mean(deviations, axis=0)
    ours = float(np.median(seconds))
    quality = f"{np.mean(fits):.2f} %, least {min(fits):.2f} %"
    failures = f"{sum(fit < 95.0 for fit in fits)} of {SEEDS}"
    peer = _pysib(records[0], fresh, clean)
    other, factor = "pysib not installed", "-"
    if peer is not None:
        other, factor = f"{peer[0]:.2f} s, fit {peer[1]:.1f} %", f"{peer[0] / ours:.0f}"
    return [
        ("Rao-Garnier, 10 dB, 20 seeds: fit on clean fresh data", quality, "-", "-", "99.0 %"),
        ("Rao-Garnier: failures (fit below 95 %)", failures, "-", "-", "0"),
        ("Rao-Garnier: RMSE over claimed standard error, worst", f"{ratio.max():.2f}", "-", "-", "1.25"),
        ("Rao-Garnier: time for a fit", f"{1e3 * ours:.0f} ms", other, factor, "60 ms, ratio 100"),
    ]


def paper_size() -> list[tuple[str, str, str, str, str]]:
    """Eight inputs and three outputs, five poles and three zeros, 10 Hz: one record, and ten jointly."""
    records = [_octocopter_record(seed, 2000) for seed in range(10)]
    begun = time.process_time()
    fit_transfer_functions(records[:1])
    one = time.process_time() - begun
    begun = time.process_time()
    model = fit_transfer_functions(records[:9])
    joint = time.process_time() - begun
    test = records[9]
    error = np.sqrt(np.mean((model.simulate(test) - test.y)[30:] ** 2, axis=0))
    floor = max(report.rmse for report in model.reports.values())
    return [
        ("8 inputs, 3 outputs, 5/3, own denominators, N = 2000", f"{one:.2f} s", "-", "-", "2 s"),
        ("the same, joint fit on 9 records", f"{joint:.1f} s", "-", "-", "10 s"),
        ("joint fit: worst training RMSE (noise 0.05 m)", f"{floor:.4f} m", "-", "-", "0.051 m"),
        ("joint fit: free run on another record, worst axis (with noise)", f"{error.max():.3f} m", "-", "-", "0.058 m"),
    ]


def _inputs(samples: int, hold: int) -> np.ndarray:
    return np.repeat(max_len_seq(10)[0] * 2.0 - 1.0, hold)[:samples]


def _response(u: np.ndarray) -> np.ndarray:
    return np.asarray(lsim((NUM, DEN), u, np.arange(len(u)) * STEP, interp=False)[1])


def _rao_garnier_record(seed: int) -> Experiment:
    u = _inputs(SAMPLES, 7)
    y = _response(u)
    noise = np.random.default_rng(seed).standard_normal(SAMPLES) * y.std() / np.sqrt(10.0)
    return Experiment.from_arrays(
        np.arange(SAMPLES) * STEP, u, y + noise, name=f"seed {seed}", input_trim=[0.0], output_trim=[0.0]
    )


def _octocopter_record(seed: int, samples: int) -> Experiment:
    """Make a record of eight correlated inputs and three outputs with modes like those of the paper's table A1."""
    rng = np.random.default_rng(1000 + seed)
    u = lfilter([1.0], [1.0, -0.9], rng.standard_normal((samples, 8)) @ (np.eye(8) + 0.5), axis=0)
    u /= u.std(axis=0)
    modes = np.random.default_rng(0)
    outputs = []
    for _ in range(3):
        theta = np.log([0.5, 0.3, 2.0, 0.5, 0.1]) + 0.3 * modes.standard_normal((8, 5))
        states = discretise(denominators(theta)[0], 0.1, "zoh").forced(u, range(8), sensitivities=False)
        y = np.einsum("tkm,km->t", states[:, :4], modes.standard_normal((4, 8)))
        outputs.append(y + 0.05 * rng.standard_normal(samples))
    return Experiment.from_arrays(
        np.arange(samples) * 0.1,
        1500.0 + 50.0 * u,
        np.column_stack(outputs),
        name=f"record {seed}",
        output_names=("x", "y", "z"),
        input_trim=np.full(8, 1500.0),
    )


def _fit_percent(y: np.ndarray, predicted: np.ndarray) -> float:
    return 100.0 * (1.0 - float(np.linalg.norm(y - predicted) / np.linalg.norm(y - y.mean())))


def _pysib(record: Experiment, fresh: np.ndarray, clean: np.ndarray) -> tuple[float, float] | None:
    """Seconds and fit of pysib's discrete-time output-error estimator on the same record; None when not installed."""
    try:
        import pysib
    except ImportError:
        return None
    begun = time.process_time()
    with _quiet():
        _, model = pysib.oe(record.u[:, 0], record.y[:, 0], 4, 4, 1)
    seconds = time.process_time() - begun
    return seconds, _fit_percent(clean, lfilter(np.ravel(model["B"]), np.ravel(model["F"]), fresh))


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep a compiled library's progress off the terminal."""
    sys.stdout.flush()
    kept = os.dup(1)
    with Path(os.devnull).open("w") as nothing:
        os.dup2(nothing.fileno(), 1)
        try:
            yield
        finally:
            os.dup2(kept, 1)
            os.close(kept)
