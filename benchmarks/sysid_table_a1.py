"""Own denominators from blind starts: table A1 of Elhesasy 2024 as truth, ten records, ten sets of them."""

import numpy as np

from benchmarks._measure import Row, cpu, listed, row, timed
from sysid import fit_transfer_functions
from tests.sysid.table_a1 import NOISE, record

SETS, RECORDS, FRESH = 10, 10, 3


def run() -> list[Row]:
    """Count the sets whose fit leaves the noise only, and whose free run on fresh records errs by less than 0.03 m."""
    training, validation, seconds = [], [], []
    for seed in range(SETS):
        records = [record(seed, number)[0] for number in range(RECORDS)]
        fresh = [record(seed, RECORDS + number) for number in range(FRESH)]
        model, spent = timed(lambda: fit_transfer_functions(records, time_limit=600.0, seed=seed))  # noqa: B023
        seconds.append(spent)
        training.append([report.rmse for report in model.reports.values()])
        validation.append(
            np.sqrt(np.mean([(model.simulate(experiment) - clean) ** 2 for experiment, clean in fresh], axis=(0, 1)))
        )
    one = cpu(lambda: fit_transfer_functions(records[:1]))
    left, wrong = np.array(training), np.array(validation)
    good = (left < 1.02 * NOISE) & (wrong < 0.03)
    rows = [
        row(
            f"table A1, own denominators from blind starts, {output}: noise floor and free run reached",
            f"{good[:, i].sum()} of {SETS}",
            goal=">= 10 of 10",
        )
        for i, output in enumerate("xyz")
    ]
    return [
        *rows,
        row(
            "table A1: training RMSE (noise 0.05 m), worst set of x, y, z",
            listed(left.max(axis=0), ".4f"),
            goal="0.051 m",
        ),
        row(
            "table A1: free run on fresh records against the truth, worst set of x, y, z",
            listed(wrong.max(axis=0), ".3f"),
            goal="0.03 m",
        ),
        row("table A1: CPU time of a fit of three outputs", f"{np.median(seconds):.0f} s", goal="< 15 s"),
        row("... to one record", f"{one:.2f} s", goal="< 0.7 s"),
    ]
