"""A motor that lacks a part of its thrust from some moment on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from logparse import Vehicle
from sysid.rotors.motor_faults.fault import SMALLEST, SURE, MotorFault, output_left
from sysid.rotors.motor_faults.moments import MEMORY, Moments
from sysid.rotors.motor_faults.windows import ALIKE, ONE_MOTOR, Remainder, variances_of

#: Shortest time before and after a step [s].
_BEFORE, _AFTER = 3.0, 0.4
#: Chance that noise makes as large a score by itself. Shortly after the take-off noise is hardly known: its variance
#: then comes from as many independent pieces as there were times `MEMORY` before the change, and Student's
#: distribution asks for more than `SURE` in the first 18 s.
_BY_CHANCE = 1e-4
#: The same score with the change itself still in the noise.
_LIKELY = 3.0
#: Time around the change in which it must show by itself [s], with this score and this part of the whole loss: a slow
#: failure is no step (erlerobot 11-2-2015_112 in the middle of its 40 s).
_AROUND, _SHARP, _SHARE = 8.0, 5.0, 0.5


def find_step(moments: Moments, vehicle: Vehicle) -> MotorFault | None:
    """Find the lasting loss that explains most; None where none is sure."""
    left, t, rows = Remainder.of(moments), moments.t, np.arange(len(moments.t))
    allowed = (t >= t[0] + _BEFORE) & (t <= t[-1] - _AFTER)
    variances = variances_of(left.residuals, moments)
    # Noise before a change is known contains the change itself: what is likely is found first, then judged without it.
    for sure, one_motor in ((_LIKELY, 0.5 * ONE_MOTOR), (SURE, ONE_MOTOR)):
        fits = left.fits(variances, rows, np.full_like(rows, len(rows)))
        gain = np.where(allowed[:, None] & (fits.loss > SMALLEST), fits.gain, 0.0)
        row, column = (int(k) for k in np.unravel_index(int(np.argmax(gain)), gain.shape))
        loss, score = float(fits.loss[row, column]), float(np.sqrt(gain[row, column]))
        # A maximum at the first time that is allowed belongs to something before it, such as the take-off.
        if score < sure or loss > 1.5 or fits.part[row, column] < one_motor or not allowed[max(row - 2, 0)]:
            return None
        variances = variances_of(left.without(row, column, loss), moments)
    if score < -scipy.special.stdtrit((t[row] - t[0]) / MEMORY, _BY_CHANCE) or not _sharp(moments, row, column, loss):
        return None
    # A pulse is no lasting loss, however large: half of the time later the motor must lack as much.
    later = moments.part((rows < row) | (rows >= (row + len(rows)) // 2))
    if Remainder.of(later).fits(variances, rows[[row]], np.array([len(later.t)])).loss[0, column] < _SHARE * loss:
        return None
    size, sigma = _size(left, variances, row, column)
    numbers, alike = [motor.number for motor in vehicle.motors], gain[row] > ALIKE * gain[row, column]
    beside = round(_AROUND / moments.step)
    before, after = (np.median(moments.pwm[a:b, column]) for a, b in ((max(row - beside, 0), row), (row, row + beside)))
    return MotorFault(
        motor=numbers[column],
        kind="step",
        t=float(0.5 * (t[row - 1] + t[row])),
        end=float(t[-1]),
        loss=size,
        sigma=sigma,
        output=output_left(moments.thrust[row:, column].mean(), size, vehicle),
        score=score,
        evidence=f"its output goes from {before:.0f} to {after:.0f} µs (medians of {_AROUND:.0f} s)",
        alternatives=tuple(number for k, number in enumerate(numbers) if alike[k] and k != column),
    )


def _sharp(moments: Moments, row: int, column: int, loss: float) -> bool:
    """Return whether a change shows in the seconds around it, for the same motor before all others.

    Wind, heat and batteries change moments slowly; motors fail at once.
    """
    near = np.abs(moments.t - moments.t[row]) <= _AROUND
    part, first = moments.part(near), row - int(np.argmax(near))
    left = Remainder.of(part)
    whole = left.fits([1.0] * len(part.factors), np.array([first]), np.array([len(part.t)]))
    variances = variances_of(left.without(first, column, float(whole.loss[0, column])), part)
    fits = left.fits(variances, np.array([first]), np.array([len(part.t)]))
    gain = np.where(fits.loss[0] > 0.0, fits.gain[0], 0.0)
    return bool(gain[column] >= max(_SHARP**2, 0.98 * gain.max()) and fits.loss[0, column] >= _SHARE * loss)


def _size(left: Remainder, variances: Sequence[float], row: int, column: int) -> tuple[float, float]:
    """Estimate the size of a loss whose time and motor are known, and its standard deviation.

    The motor's output answers to the same gusts that disturb the moments, so that regressing on it is biased; the step
    in time does not, and serves as instrument (Wooldridge 2010, section 5.1).
    """
    later = np.where(np.arange(len(left.moments.t)) >= row, 1.0, 0.0)
    asked, seen, through, noise = left.moments.thrust[:, column], 0.0, 0.0, 0.0
    for residual, basis, variance, factors in zip(
        left.residuals, left.bases, variances, left.moments.factors, strict=True
    ):
        instrument, weight = later - basis @ (basis.T @ later), factors[column] / variance
        seen += weight * float(instrument @ residual)
        through += weight * factors[column] * float(instrument @ (asked * later))
        noise += weight**2 * variance * float(instrument @ instrument)
    return float(np.clip(seen / through, 0.0, 1.0)), float(np.sqrt(noise) / abs(through))
