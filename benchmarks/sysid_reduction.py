"""What a Gauss-Newton step over many records costs, and what travels when other processes hold them."""

import pickle
import time
from concurrent.futures import Executor, Future
from dataclasses import replace
from functools import partial

import numpy as np

from benchmarks.sysid import octocopter_record
from sysid import Experiment
from sysid.transfer_functions.reduction import Cut, Elsewhere, Spread
from sysid.transfer_functions.sections import resolvable_band
from sysid.transfer_functions.separable import Problem, nonlinear_system, solve

#: Records, and samples of each: a minute at 10 Hz, as most flights of sample_logs/.
COUNTS, SAMPLES = (10, 100, 1000), 600

#: Different records among them; more would only be more to simulate.
DIFFERENT = 10


class _Here(Executor):
    """Does the work of one other process in this one, and counts what would have travelled."""

    def __init__(self) -> None:
        self.bytes = 0

    def submit(self, work, /, *args):  # type: ignore[no-untyped-def]
        message = pickle.dumps((work, args))
        work, args = pickle.loads(message)
        result = work(*args)
        self.bytes += len(message) + len(pickle.dumps(result))
        job: Future = Future()
        job.set_result(result)
        return job


def _record(number: int) -> Experiment:
    return octocopter_record(number % DIFFERENT, SAMPLES)


def run() -> list[tuple[str, str, str, str, str]]:
    """Take one step of eight inputs with five poles and three zeros each, own denominators."""
    theta = np.log([0.5, 0.3, 2.0, 0.5, 0.1]) + 0.1 * np.random.default_rng(0).standard_normal((8, 5))
    rows = []
    for count in COUNTS:
        executor = _Here()
        spread = Spread(executor, tuple(partial(_record, number) for number in range(count)), 1)
        problem = Problem(
            inputs=(),
            outputs=(),
            group=tuple(range(8)),
            order=5,
            numerators=4,
            dt=0.1,
            hold="zoh",
            band=resolvable_band(0.1 * SAMPLES, 0.1),
            ridge=1e-3,
            initial=1e-3,
            elsewhere=Elsewhere(spread, Cut(0, tuple(range(8)), np.full(8, 50.0), 5.0), (SAMPLES,) * count),
        )
        solve(problem, theta)  # the process loads its records
        executor.bytes, begun = 0, time.process_time()
        point = solve(problem, theta)
        nonlinear_system(replace(problem, ridge=1e-3), point)
        seconds = time.process_time() - begun
        rows.append(
            (
                f"a Gauss-Newton step over {count} records of {SAMPLES} samples, 8 inputs, 5/3: CPU per record",
                f"{1e3 * seconds / count:.1f} ms",
                "-",
                "-",
                "alike",
            )
        )
        rows.append(
            (
                f"the same, travelling to and from one share of {count} records",
                f"{executor.bytes / 1e3:.0f} kB",
                "-",
                "-",
                "alike",
            )
        )
    return rows
