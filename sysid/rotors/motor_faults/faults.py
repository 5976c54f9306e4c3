"""Which motor failed in a flight, since when, and how much of its thrust is missing.

Three readings of one equation (`sysid.rotors.motor_faults.moments`), the plainest first:

- *limit*: in the last seconds before the end (a blow, if there is one) one motor stands at its upper limit and the
  others do not, and yet the craft turns as if it gave less than it is asked for. What is usual comes from the flight
  before these seconds. Outputs at their limit after a blow are its result, and are not read.
- *step*: from some moment on until the end one motor lacks a part of its thrust. Time and motor are those with the
  largest likelihood ratio (Page 1955; Basseville and Nikiforov 1993, section 2.4.3, generalised likelihood ratio for a
  change of known shape and unknown size).
- *pulse*: the same in a window of a third of a second to two seconds, after which the motor recovers. How heavy the
  tails of a flight's gusts are it tells itself: no motor gives *more* than it is asked for, so that the surest window
  which says so is chance, and a pulse must stand out above it.

One motor must explain all three moments: wind, a shifting load and a craft that hits something do not pull along one
motor's own column of the mixer. Noise is not white: its variance is the long-run one, with Bartlett weights over three
seconds (Newey and West 1987).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy

from logparse import Tables, Vehicle
from logparse.tables import between
from sysid.records.motor_scaling import commands_for, motor_pwm
from sysid.rotors.motor_faults.moments import (
    ALIKE,
    FEWEST,
    MEMORY,
    OF_A_FALL,
    ONE_MOTOR,
    Moments,
    Remainder,
    read_moments,
    spread,
    variances_of,
)

Kind = Literal["limit", "step", "pulse"]

#: Smallest loss of thrust that is named, and its size in standard deviations.
SMALLEST, SURE = 0.10, 8.0


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorFault:
    """Thrust that one motor did not give."""

    motor: int  #: Number in the autopilot's frame.
    kind: Kind
    t: float  #: When it began, s.
    end: float  #: When it ended, or the last time looked at, s.
    #: Part of the thrust that is missing, 0 to 1, and its standard deviation.
    loss: float
    sigma: float
    #: Part of the output above the lowest PWM that would give the thrust that is left: 0.8 of the output gives about
    #: 0.64 of the thrust.
    output: float
    score: float  #: Loss over its standard deviation in the search, which chooses time and motor.
    evidence: str  #: What of it stands in the log, for a person to check.
    alternatives: tuple[int, ...] = ()  #: Other motors that explain it nearly as well; usually none.


def output_left(thrust: float, loss: float, vehicle: Vehicle) -> float:
    """Return the part of an output above the lowest PWM that would give the thrust that is left."""
    asked, given = (
        float(motor_pwm(commands_for(np.asarray(part * thrust), vehicle.thrust_expo), vehicle)) - vehicle.pwm_min
        for part in (1.0, 1.0 - loss)
    )
    return given / asked if loss < 1.0 else 0.0


#: Time before the end in which outputs at their limit are read, and the shortest that tells, s.
LAST, _SHORTEST = 10.0, 1.0
#: Part of that time for which the motor is at its limit, and that over the next motor's. A craft without lift left has
#: several there (erlerobot 7-9-2014_24), one that is flown hard another every second (erlerobot 26-11-2014_181).
_LIMITED, _BEYOND = 0.25, 2.0
#: Loss of a motor at its limit, and part of all moments that it must explain: 0.41 to 0.96 and 0.51 to 0.99 where one
#: failed. One that works harder in all of a flight lacks 0.26 more at full throttle and 45 deg (peterbarker 1.BIN).
_LOSS_AT_LIMIT, _EXPLAINED = 0.3, 0.4


def find_at_limit(moments: Moments, vehicle: Vehicle) -> MotorFault | None:
    """Find the motor that stands at its limit before the end while the craft turns as if it gave less."""
    t, half = moments.t, len(moments.t) // 2
    usual, last = slice(half), moments.t > moments.t[-1] - LAST
    if half < FEWEST or not moments.limited[last].any():
        return None
    size = max(round(0.5 / moments.step), 1)
    hits, power, whole = np.zeros_like(moments.thrust), np.zeros_like(moments.thrust), np.zeros(len(t))
    for asked, columns, factors in zip(moments.asked, moments.columns, moments.factors, strict=True):
        used = columns[:, OF_A_FALL]
        residual = asked - used @ np.linalg.lstsq(used[usual], asked[usual])[0]
        variance = spread(np.convolve(residual[usual], np.full(size, 1.0 / size), "valid")) ** 2 * size
        hits += factors * moments.thrust * residual[:, None] / variance
        power += (factors * moments.thrust) ** 2 / variance
        whole += residual**2 / variance
    column = int(np.argmax(moments.limited[last].sum(axis=0)))
    hits, power = hits[:, column], np.maximum(power[:, column], 1e-12)
    # Page's sum: since when the motor lacks more than the smallest loss that is named.
    row = half + int(np.argmax(np.cumsum((hits - SMALLEST * power)[half:][::-1])[::-1]))
    late = slice(max(row, int(np.argmax(last))), None)
    seen, of = float(hits[late].sum()), float(power[late].sum())
    loss, part = seen / of, seen**2 / of / max(float(whole[late].sum()), 1e-12)
    limited = moments.limited[late].mean(axis=0)
    others = float(np.delete(limited, column).max())
    if t[-1] - t[row] < _SHORTEST or loss < _LOSS_AT_LIMIT or part < _EXPLAINED or seen < SURE * of**0.5:
        return None
    if limited[column] < max(_LIMITED, _BEYOND * others):
        return None
    quarters = [
        float(h.sum() / p.sum()) for h, p in zip(*(np.array_split(x[late], 4) for x in (hits, power)), strict=True)
    ]
    across = int(np.argmin(moments.factors[:2].T @ moments.factors[:2, column]))
    at_limit = moments.limited[late, column]
    pwm = np.median(moments.pwm[late][at_limit], axis=0)
    numbers = [motor.number for motor in vehicle.motors]
    return MotorFault(
        motor=numbers[column],
        kind="limit",
        t=float(t[row]) - 0.5 * moments.step,
        end=float(t[-1]),
        loss=float(min(loss, 1.0)),
        sigma=float(np.std(quarters, ddof=1)) / 2.0,
        output=output_left(float(moments.thrust[late, column].mean()), float(min(loss, 1.0)), vehicle),
        score=seen / of**0.5,
        evidence=f"its output stands at the limit ({pwm[column]:.0f} µs) for {at_limit.sum() * moments.step:.1f} s of "
        f"the last {t[-1] - t[late][0]:.1f} s, motor {numbers[across]} across is told {pwm[across]:.0f} µs",
    )


#: Chance that noise makes as large a score by itself. Shortly after the take-off noise is hardly known: its variance
#: then comes from as many independent pieces as there were times `MEMORY` before the change, and Student's
#: distribution asks for more than `SURE` in the first 18 s.
_BY_CHANCE = 1e-4
#: Time around the change in which it must show by itself [s], with this score and this part of the whole loss: a slow
#: failure is no step (erlerobot 11-2-2015_112 in the middle of its 40 s).
_AROUND, _SHARP, _SHARE = 8.0, 5.0, 0.5


def find_step(moments: Moments, vehicle: Vehicle) -> MotorFault | None:
    """Find the lasting loss that explains most; None where none is sure."""
    left, t, rows = Remainder.of(moments), moments.t, np.arange(len(moments.t))
    allowed = (t >= t[0] + 3.0) & (t <= t[-1] - 0.4)
    variances = variances_of(left.residuals, moments)
    # Noise before a change is known contains the change itself: what is likely is found first, then judged without it.
    for sure, one_motor in ((3.0, 0.5 * ONE_MOTOR), (SURE, ONE_MOTOR)):
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
    # Wind that changed, or changed in a hole of the log: 5.3 standard deviations in 7-9-2014_24 from 85 s on.
    if size < SURE * sigma:
        return None
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
    faults: list[MotorFault] = []
    for length in _LENGTHS:
        size = max(round(length / moments.step), 3)
        if len(t) < 10 * size:
            continue
        first = np.arange(len(t) - size + 1)
        sums = [np.convolve(residual, np.ones(size), "valid") for residual in left.residuals]
        fits = left.fits([spread(total) ** 2 / size for total in sums], first, first + size)
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
            if rise <= 0.0:
                continue  # what gives less is asked for more; a damaged output of the motor across is not
            faults.append(
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
    for one in sorted(faults, key=lambda fault: -fault.score):
        if one.score >= _ABOVE * chance and all(one.t > of.end + _JOIN or one.end < of.t - _JOIN for of in apart):
            apart.append(one)
    # Once is chance, twice a pattern, unless it is plain.
    counts = Counter(one.motor for one in apart)
    plain = [one.loss >= _PLAIN and one.score >= _SURER for one in apart]
    named = [one for one, sure in zip(apart, plain, strict=True) if sure or counts[one.motor] > 1]
    return sorted(named, key=lambda one: one.t)


#: Time before a landing in which the ground pushes, s; a log has none whose outputs end within `_CUT` seconds of the
#: flight, unless the autopilot said so within `_LANDED` seconds before.
_GROUND, _CUT, _LANDED, _LANDINGS = 2.0, 0.3, 4.0, ("LAND_COMPLETE", "LAND_COMPLETE_MAYBE", "DISARMED")


def find_motor_faults(tables: Tables, vehicle: Vehicle, start: float, stop: float) -> tuple[MotorFault, ...]:
    """Find the motors that did not give what they were asked for in a flight, in the order of time.

    From lift-off to touch-down, crash or the end of the log [s]; a blow in the last seconds before it ends the search.
    Empty also where outputs or rates are too slow or too short to tell. MissingDataError without the frame, the
    outputs of
    all its motors, or the IMU.
    """
    moments = read_moments(tables, vehicle, start, _end(tables, stop))
    if moments is None:
        return ()
    limit, step = find_at_limit(moments, vehicle), find_step(moments, vehicle)
    lasting = limit or step
    if step is not None and lasting is not None and lasting.motor == step.motor:
        # A step tells the time. How much is missing in a fall is what the flight before it says.
        lasting = replace(lasting, t=_suddenly(step, tables, vehicle, moments.step))
    pulses = find_pulses(moments if lasting is None else moments.part(moments.t < lasting.t), vehicle)
    return (*pulses, *([lasting] if lasting else []))


def _suddenly(fault: MotorFault, tables: Tables, vehicle: Vehicle, step: float) -> float:
    """Return when the craft began to turn towards a motor that failed at once, as the gyro's times tell it, s."""
    assert tables.imu is not None
    rates = between(tables.imu, fault.t - step, fault.t + step)[["gyro_x", "gyro_y"]].dropna()
    motor = next(motor for motor in vehicle.motors if motor.number == fault.motor)
    t, towards = rates.index.to_numpy(np.float64), -(rates.to_numpy(np.float64) @ (motor.roll, motor.pitch))
    if len(t) < 4:
        return fault.t
    turned = np.diff(towards)
    first = int(np.argmax(turned >= 0.25 * turned.max()))
    return float(0.5 * (t[first] + t[first + 1]))


def _end(tables: Tables, stop: float) -> float:
    """Return the last time at which motors can be compared, s: before a blow, and before the ground pushes."""
    if tables.motors is None or tables.imu is None or len(tables.motors) < 2:
        return stop
    outputs = tables.motors.index.to_numpy(np.float64)
    last = between(tables.imu, stop - LAST, stop + _CUT)[["accel_x", "accel_y", "accel_z"]]
    blows = last.index[np.linalg.norm(last.to_numpy(np.float64), axis=1) > 30.0]
    if len(blows):
        # No output whose interval the blow is in.
        return min(float(blows[0]) - float(np.median(np.diff(outputs))), stop)
    # A log whose outputs end with the flight was cut, or power was lost, in the air.
    said = tables.events is not None and tables.events["event"].loc[stop - _LANDED :].isin(_LANDINGS).any()
    return stop - _GROUND if said or outputs[-1] > stop + _CUT else stop
