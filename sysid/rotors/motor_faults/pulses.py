"""A motor that gives less for moments, as with a dry solder joint or a loose plug."""

from __future__ import annotations

from collections import Counter

import numpy as np

from logparse import Vehicle
from sysid.rotors.motor_faults.fault import SURE, MotorFault, output_left
from sysid.rotors.motor_faults.moments import FEWEST, Moments
from sysid.rotors.motor_faults.windows import Remainder, spread

#: Lengths of pulses [s], and the least loss of one.
_LENGTHS, _PULSE = (0.3, 0.5, 0.8, 1.2, 2.0), 0.25
#: Loss and score of a pulse that stands alone.
_PLAIN, _SURER = 0.5, 20.0
#: Score over that of the surest window of the wrong sign.
_ABOVE = 1.5
#: Time in which a motor recovers [s], and the part of the loss that may be left then.
_RECOVERS, _LEFT = 2.0, 0.5
#: Time within which pulses are one, s.
_JOIN = 0.6


def find_pulses(moments: Moments, vehicle: Vehicle) -> list[MotorFault]:
    """Find the moments in which a motor gave less, and gave its thrust again within two seconds."""
    if len(moments.t) < FEWEST:
        return []
    left, t, chance = Remainder.of(moments, lag=True), moments.t, 0.0
    ahead = round(_RECOVERS / moments.step)
    found: list[MotorFault] = []
    for length in _LENGTHS:
        size = max(round(length / moments.step), 3)
        if len(t) < 10 * size:
            continue
        first = np.arange(len(t) - size + 1)
        sums = [np.convolve(residual, np.ones(size), "valid") for residual in left.residuals]
        fits = left.fits([spread(each) ** 2 / size for each in sums], first, first + size)
        whole = (t[size - 1 :] - t[: len(first)] < 1.5 * size * moments.step)[:, None]
        less = fits.alone(1.0) & whole & (fits.gain >= SURE**2) & (fits.loss >= _PULSE) & (fits.loss <= 1.3)
        # The motor gives its thrust again soon after the window.
        later = np.vstack([fits.loss[size:], np.full((size + ahead, fits.loss.shape[1]), np.inf)])
        least = np.lib.stride_tricks.sliding_window_view(later, ahead, axis=0).min(axis=-1)[: len(first)]
        pulses = less & (least < _LEFT * fits.loss)
        # A motor that gives less looks like its counterpart that gives more: only what is not the former is chance.
        beside = (np.convolve(less.any(axis=1), np.ones(4 * size + 1), "same") > 0.5)[:, None]
        more = fits.alone(-1.0) & whole & (fits.loss <= -_PULSE) & ~beside
        chance = max(chance, float(np.sqrt(np.max(fits.gain, where=more, initial=0.0))))
        for row, column in zip(*np.nonzero(pulses), strict=True):
            loss, score = float(min(fits.loss[row, column], 1.0)), float(np.sqrt(fits.gain[row, column]))
            rise = moments.pwm[row : row + size, column].mean() - np.median(moments.pwm[:, column])
            found.append(
                MotorFault(
                    motor=vehicle.motors[column].number,
                    kind="pulse",
                    t=float(t[row]),
                    end=float(t[row + size - 1]),
                    loss=loss,
                    sigma=loss / score,
                    output=output_left(float(moments.thrust[row : row + size, column].mean()), loss, vehicle),
                    score=score,
                    evidence=f"its output rises by {rise:.0f} µs",
                )
            )
    apart: list[MotorFault] = []
    for one in sorted(found, key=lambda each: -each.score):
        if one.score >= _ABOVE * chance and all(one.t > of.end + _JOIN or one.end < of.t - _JOIN for of in apart):
            apart.append(one)
    # Once is chance, twice a pattern, unless it is plain.
    counts = Counter(one.motor for one in apart)
    plain = [one.loss >= _PLAIN and one.score >= _SURER for one in apart]
    named = [one for one, each in zip(apart, plain, strict=True) if each or counts[one.motor] > 1]
    return sorted(named, key=lambda one: one.t)
