"""Joint fits whose records are held by other processes: the same model, and little that travels."""

import multiprocessing
import pickle
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from functools import partial

import numpy as np
import pytest
from scipy.signal import lfilter

from sysid import Experiment, fit_closed_loop, fit_transfer_functions
from sysid.transfer_functions.reduction import Spread
from sysid.transfer_functions.response import discretise
from sysid.transfer_functions.sections import denominators

COUNT, SAMPLES, STEP = 6, 800, 0.1


class Counting(Executor):
    """Does the work here, from pickles as another process would get it, and counts what travels."""

    def __init__(self):
        self.sent, self.returned, self.calls = 0, 0, 0

    def submit(self, work, /, *args):
        message = pickle.dumps((work, args))
        work, args = pickle.loads(message)
        result = work(*args)
        job = Future()
        job.set_result(result)
        self.sent, self.returned, self.calls = (
            self.sent + len(message),
            self.returned + len(pickle.dumps(result)),
            self.calls + 1,
        )
        return job


def load(path, names):
    with np.load(path) as stored:
        return Experiment.from_arrays(
            np.arange(len(stored["u"])) * STEP,
            stored["u"],
            stored["y"],
            name=path.stem,
            input_names=names,
            output_names=names[: stored["y"].shape[1]],
        )


def write(path, number, samples):
    """Write a record of two inputs and two outputs with modes of their own, noise and an offset."""
    rng = np.random.default_rng([5, number])
    u = lfilter([1.0], [1.0, -0.9], rng.standard_normal((samples, 2)), axis=0)
    y = []
    for column in range(2):
        theta = np.log([[0.8, 0.4], [2.0, 0.3]]) + 0.2 * column
        states = discretise(denominators(theta)[0], STEP, "zoh").forced(u, range(2), sensitivities=False)
        y.append(states[:, 0] @ [1.0, -0.7] + 0.2 * number + 0.05 * rng.standard_normal(samples))
    np.savez(path, u=u, y=np.column_stack(y))


@pytest.fixture(scope="module")
def sources(tmp_path_factory):
    folder = tmp_path_factory.mktemp("records")
    result = []
    for number in range(COUNT):
        path = folder / f"record{number}.npz"
        write(path, number, SAMPLES - 10 * number)
        result.append(partial(load, path, ("x", "y")))
    return tuple(result)


@pytest.fixture(scope="module")
def records(sources):
    return [source() for source in sources]


def coefficients(model):
    functions = [f for row in model.transfer_functions.values() for f in row.values()]
    return np.concatenate([np.concatenate([f.num, f.den]) for f in functions])


def deviations(model):
    functions = [f for row in model.transfer_functions.values() for f in row.values()]
    return np.concatenate([f.standard_deviation for f in functions if f.covariance is not None])


OPTIONS = {
    "common": {"structure": "common"},
    "own, integrators": {"structure": "per_input", "integrators": 1, "ridge": 1e-4},
    "delays": {"structure": "common", "delays": None, "longest_delay": 0.3, "ridge": 1e-3},
}


@pytest.mark.parametrize("case", OPTIONS)
def test_records_elsewhere_give_the_model_of_records_here(sources, records, case):
    executor = Counting()
    here = fit_transfer_functions(records, 2, 0, **OPTIONS[case])
    there = fit_transfer_functions(records, 2, 0, **OPTIONS[case], spread=Spread(executor, sources, 2))
    assert executor.calls
    same(there, here)


def test_records_in_two_processes_give_the_model_of_one(sources, records):
    here = fit_transfer_functions(records, 2, 0, "common")
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as executor:
        spread = Spread(executor, sources, 2)
        # Processes may take long to start where many run.
        there = fit_transfer_functions(records, 2, 0, "common", time_limit=1e5, spread=spread)
    same(there, here)


def same(there, here):
    np.testing.assert_allclose(coefficients(there), coefficients(here), rtol=2e-4, atol=1e-6)
    np.testing.assert_allclose(deviations(there), deviations(here), rtol=2e-3, atol=1e-9)
    for output, report in here.reports.items():
        assert there.reports[output].rmse == pytest.approx(report.rmse, rel=1e-8)
        assert there.reports[output].ridge == report.ridge
    for name, states in here.initial_states.items():
        for output, values in states.items():
            np.testing.assert_allclose(there.initial_states[name][output], values, rtol=1e-2, atol=1e-3)


@pytest.mark.parametrize("shares", [1, 3, 20])
def test_shares_do_not_matter(sources, records, shares):
    whole = fit_transfer_functions(records, 2, 0, "common", spread=Spread(Counting(), sources, 2))
    divided = fit_transfer_functions(records, 2, 0, "common", spread=Spread(Counting(), sources, shares))
    np.testing.assert_allclose(coefficients(divided), coefficients(whole), rtol=1e-5, atol=1e-8)


def test_a_closed_loop_can_be_spread(sources, records):
    here = fit_closed_loop(records)
    there = fit_closed_loop(records, spread=Spread(Counting(), sources, 2))
    np.testing.assert_allclose(coefficients(there), coefficients(here), rtol=1e-4, atol=1e-6)


def test_what_travels_does_not_grow_with_the_records(tmp_path):
    """A step sends poles and settings and returns normal equations: of ten times longer records no more."""
    traffic = []
    for factor in (1, 10):
        sources = []
        for number in range(2):
            path = tmp_path / f"{factor}-{number}.npz"
            write(path, number, 2500 * factor)
            sources.append(partial(load, path, ("x", "y")))
        executor = Counting()
        fit_transfer_functions([source() for source in sources], 2, 0, "common", spread=Spread(executor, sources, 1))
        assert executor.calls
        traffic.append((executor.sent + executor.returned) / executor.calls)
    assert traffic[1] < 1.2 * traffic[0] < 6000.0
