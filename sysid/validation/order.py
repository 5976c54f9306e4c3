"""Choosing the number of poles and zeros, as Elhesasy 2024 (section 5) iterates it, judged by flight time held back.

Every order is fitted to a part of the records and judged by its free run on the rest. Akaike's and the Bayesian
criterion stand beside it for comparison: they take residuals for white, which wind makes them not, and so lean towards
high orders; they have no say in the recommendation.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd

from logparse import Finding, Severity
from sysid.records.experiment import Experiment, ExperimentError, require_alike
from sysid.transfer_functions.pem import fit_transfer_functions
from sysid.transfer_functions.response import INITIAL_SECONDS
from sysid.transfer_functions.transfer_function import TransferFunctionModel
from sysid.validation.assessment import validate
from sysid.validation.purposes import MARGIN
from sysid.validation.report import OrderRow, OrderScan

#: (poles, zeros) that are tried, simplest first, so that a time limit costs the largest ones.
ORDERS = ((1, 0), (2, 0), (2, 1), (3, 1), (3, 2), (4, 2), (4, 3), (5, 3), (5, 4), (6, 4))

#: Part of each record that is fitted when there are too few records to hold whole ones back.
SEEN = 0.7

#: Called with a stage in words and the part done so far, 0 to 1.
Progress = Callable[[str, float], None]


def scan_orders(
    experiments: Experiment | Sequence[Experiment],
    orders: Sequence[tuple[int, int]] = ORDERS,
    structure: str = "per_input",
    *,
    time_limit: float = 120.0,
    progress: Progress | None = None,
) -> OrderScan:
    """Fit every order to a part of the records and judge it on the rest.

    Parameters
    ----------
    experiments : Experiment or sequence of Experiment
        With three or more every third is held back, otherwise the last 30 % of each.
    orders : sequence of (int, int)
        Poles and zeros, in the order in which they are tried.
    structure
        As for `fit_transfer_functions`.
    time_limit : float
        s, for all orders together; those not reached are named in a finding.
    progress : callable, optional
        ``progress(stage, fraction)``.

    Raises
    ------
    ExperimentError
        When there is too little data to hold any back, or to fit any order.
    """
    records = require_alike(experiments)
    seen, held_out = _divide(records)
    report = progress or (lambda stage, fraction: None)
    deadline = time.monotonic() + time_limit
    rows: list[OrderRow] = []
    findings: list[Finding] = []
    skipped: dict[str, str] = {}
    for number, (poles, zeros) in enumerate(orders):
        label = f"{poles} poles, {zeros} zeros"
        left = deadline - time.monotonic()
        if left <= 0.0:
            skipped[label] = "the time was up"
            continue
        report(label, number / len(orders))
        try:
            model = fit_transfer_functions(
                seen, poles, zeros, structure, starts=2, time_limit=left / (len(orders) - number)
            )
        except ExperimentError as error:
            if not rows and number == len(orders) - 1:
                raise
            skipped[label] = str(error)
            continue
        rows += _judge(model, seen, held_out)
    report("scanned", 1.0)
    if not rows:
        raise ExperimentError(f"no order could be fitted: {next(iter(skipped.values()))}")
    if skipped:
        findings.append(
            Finding(
                "fit-not-converged",
                Severity.INFO,
                f"orders not tried: {'; '.join(f'{label} ({why})' for label, why in skipped.items())}",
                "allow more time (--time-limit)",
            )
        )
    recommended, reason = recommend(pd.DataFrame(rows))
    return OrderScan(
        rows=tuple(rows),
        recommended=recommended,
        reason=reason,
        held_out=tuple(record.name for record in held_out),
        findings=tuple(findings),
    )


def recommend(table: pd.DataFrame) -> tuple[tuple[int, int] | None, str]:
    """Recommend the simplest order that is as good as the best on the part held back.

    All outputs count alike: each error is taken relative to that of always predicting the mean, and the geometric mean
    of these is compared, so that an axis that hardly moved does not decide alone. A gain of less than
    `sysid.validation.purposes.MARGIN` is chance.
    """
    groups = {
        (int(rows["poles"].iloc[0]), int(rows["zeros"].iloc[0])): rows
        for _, rows in table.groupby(["poles", "zeros"], sort=False)
    }
    score = {
        order: float(np.exp(np.log(rows["rmse_held_out"] / rows["rmse_mean"]).mean())) for order, rows in groups.items()
    }
    size = {order: int(rows["parameters"].max()) for order, rows in groups.items()}
    best = min(score, key=lambda order: score[order])
    criteria = {
        name: min(groups, key=lambda order: float(groups[order][name.lower()].sum())) for name in ("AIC", "BIC")
    }
    said = ", ".join(f"{name} prefers {_label(order)}" for name, order in criteria.items())
    if not score[best] < 1.0 - MARGIN:
        return None, (
            f"No order is recommended: on the part held back even the best ({_label(best)}) errs {score[best]:.3g} "
            f"times as much as always predicting the mean, so that the order is not what is wrong; {said}."
        )
    good = [order for order in score if score[order] <= (1.0 + MARGIN) * score[best]]
    chosen = min(good, key=lambda order: (size[order], score[order]))
    achieved = f"the error on the part held back is {score[chosen]:.2f} of what always predicting the mean gives"
    why = (
        "the least of all"
        if chosen == best
        else f"within {100 * MARGIN:.0f} % of the least ({score[best]:.2f}, {_label(best)}, {size[best]} coefficients) "
        f"with {size[chosen]} coefficients"
    )
    return chosen, f"{_label(chosen)} are recommended: {achieved}, {why}; {said}."


def _label(order: tuple[int, int]) -> str:
    poles, zeros = order
    return f"{poles} pole{'s' if poles != 1 else ''} and {zeros} zero{'s' if zeros != 1 else ''}"


def _divide(records: Sequence[Experiment]) -> tuple[list[Experiment], list[Experiment]]:
    if len(records) >= 3:
        return [r for k, r in enumerate(records) if k % 3 != 2], list(records[2::3])
    if min(record.duration for record in records) * (1.0 - SEEN) < 4.0 * INITIAL_SECONDS:
        shortest = 4.0 * INITIAL_SECONDS / (1.0 - SEEN)
        raise ExperimentError(
            "too little data to hold any back for judging orders: give three flights or more, or "
            f"{shortest:.0f} s of one"
        )
    parts = [record.split(SEEN) for record in records]
    return [seen for seen, _ in parts], [held_out for _, held_out in parts]


def _judge(model: TransferFunctionModel, seen: Sequence[Experiment], held_out: Sequence[Experiment]) -> list[OrderRow]:
    table = validate(model, held_out, horizons=()).table
    samples = sum(len(record.t) for record in seen)
    rows = []
    for output in model.output_names:
        fit, held = model.reports[output], table[table["output"] == output]
        loss = samples * math.log(max(fit.rmse, 1e-300) ** 2)
        rows.append(
            OrderRow(
                poles=model.poles,
                zeros=model.zeros,
                output=output,
                parameters=fit.parameters,
                rmse=fit.rmse,
                aic=loss + 2.0 * fit.parameters,
                bic=loss + fit.parameters * math.log(samples),
                rmse_held_out=float(held["rmse"].mean()),
                rmse_mean=float(held["rmse_mean"].mean()),
                condition=fit.condition,
                undetermined=fit.undetermined,
                converged=fit.converged,
                seconds=fit.seconds,
            )
        )
    return rows
