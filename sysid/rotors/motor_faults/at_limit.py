"""A motor that stands at its limit before the end, while the craft turns as if it gave less."""

from __future__ import annotations

import numpy as np

from logparse import Vehicle
from sysid.rotors.motor_faults.fault import SMALLEST, SURE, MotorFault, output_left
from sysid.rotors.motor_faults.moments import FEWEST, OF_A_FALL, Moments
from sysid.rotors.motor_faults.windows import spread

#: Time before the end in which outputs at their limit are read, and the shortest that tells, s.
LAST, _SHORTEST = 10.0, 1.0
#: Part of that time for which the motor is at its limit, and that over the next motor's. A craft without lift left has
#: several there (erlerobot 7-9-2014_24), one that is flown hard another every second (erlerobot 26-11-2014_181).
_LIMITED, _BEYOND = 0.25, 2.0
#: Loss of a motor at its limit, and part of all moments that it must explain: 0.41 to 0.96 and 0.51 to 0.99 where one
#: failed. One that works harder in all of a flight lacks 0.26 more at full throttle and 45 deg (peterbarker 1.BIN).
_LOSS_AT_LIMIT, _EXPLAINED = 0.3, 0.4
#: Time over which gusts are one, s.
_GUST = 0.5


def find_at_limit(moments: Moments, vehicle: Vehicle) -> MotorFault | None:
    """Find the motor that stands at its limit before the end while the craft turns as if it gave less."""
    t, half = moments.t, len(moments.t) // 2
    usual, last = slice(half), moments.t > moments.t[-1] - LAST
    if half < FEWEST or not moments.limited[last].any():
        return None
    size = max(round(_GUST / moments.step), 1)
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
