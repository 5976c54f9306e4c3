"""Under which law of drag flights are likeliest, and what the choice leaves open."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.records.experiment import Floats
from sysid.rigid_body.methods.filter_error import FilterErrorFit, Prior, fit_filter_error
from sysid.rigid_body.motion._rigid_kernels import AXIS_DRAG, ROTOR_DRAG
from sysid.rigid_body.motion.body_motion import SHARED, Motion
from sysid.transfer_functions.search import Progress

#: Laws of drag in the order of preference.
LAWS = (ROTOR_DRAG, ROTOR_DRAG | AXIS_DRAG, 0, AXIS_DRAG)


def fit_best_law(
    motions: Sequence[Motion], prior: Prior, start: Floats, deadline: float, report: Progress
) -> tuple[FilterErrorFit, int]:
    """Fit by filter error under every law of drag; return the likeliest.

    All are compared under the disturbances of the first. Laws that can hardly be told from the best may each be the
    true one: the covariance is that of their mixture, the mean of theirs and of what they find otherwise.
    """
    report("gusts", 0.0)
    first = fit_filter_error(motions, start, prior, LAWS[0], deadline=deadline)
    fits = {LAWS[0]: first}
    for number, other in enumerate(LAWS[1:], start=1):
        report("gusts, another law of drag", 0.6 * number / len(LAWS))
        if time.monotonic() > deadline:
            return replace(first, converged=False), LAWS[0]
        rival = min(fit.cost for fit in fits.values())
        fits[other] = fit_filter_error(
            motions, first.values, prior, other, disturbances=first.disturbances, rival=rival, deadline=deadline
        )
    law = min(fits, key=lambda each: fits[each].cost)
    best = fits[law]
    chances = {other: _chance(best, fit) for other, fit in fits.items()}
    weights = {other: chance / sum(chances.values()) for other, chance in chances.items()}
    mixed = np.zeros_like(best.covariance)
    for other, fit in fits.items():
        off = (fit.values - best.values)[:SHARED]
        mixed[:SHARED, :SHARED] += weights[other] * np.outer(off, off)
        mixed += 0.0 if other == law else weights[other] * fit.covariance
    if law != LAWS[0]:
        report("gusts", 0.6)
        best = fit_filter_error(motions, best.values, prior, law, deadline=deadline)
    return replace(best, covariance=weights[law] * best.covariance + mixed), law


def _chance(best: FilterErrorFit, other: FilterErrorFit) -> float:
    """Weigh a law against the best by how far their clusters' costs differ, in standard deviations (Vuong 1989)."""
    differences = other.costs - best.costs
    scatter = float(np.sqrt(len(differences)) * differences.std())
    return float(np.exp(-0.5 * (differences.sum() / scatter) ** 2)) if scatter > 0.0 else 1.0
