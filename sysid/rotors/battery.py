"""Resistance of a battery and its wiring, by how the voltage sags under the current of a flight."""

from __future__ import annotations

import numpy as np

from core.parameter import Parameter
from sysid.records.experiment import Floats
from sysid.statistics.covariance import long_run_variance

_UNIT = "ohm"


def sag_resistance(t: Floats, voltage: Floats, current: Floats) -> Parameter:
    """Estimate the resistance that the voltage sags by when the current changes.

    The open-circuit voltage falls with the charge drawn and relaxes slowly, which polynomials of charge and time take
    up. Noise of the current sensor would make the resistance too small; the current one sample before shares the
    current but not that noise, and serves as instrument (Wooldridge 2010, section 5.1). Errors are correlated over
    seconds (Newey and West 1987).

    Shapes: `t` (n,); `voltage`, `current` (n,).
    """
    known = np.isfinite(t) & np.isfinite(voltage) & np.isfinite(current)
    t, voltage, current = t[known], voltage[known], current[known]
    if len(t) < 60:
        return Parameter(None, None, _UNIT, "voltage and current were not logged together")
    if float(np.ptp(current)) <= 0.0 or float(np.ptp(voltage)) <= 0.0:
        return Parameter(None, None, _UNIT, "voltage or current does not change: no sensor measures it")
    charge = np.concatenate(([0.0], np.cumsum(np.diff(t) * 0.5 * (current[1:] + current[:-1]))))[1:]
    clock = (t[1:] - t[0]) / (t[-1] - t[0])
    drawn = charge / max(float(np.max(np.abs(charge))), 1e-9)
    slow = np.linalg.qr(np.column_stack([np.ones(len(clock)), clock, clock**2, clock**3, drawn, drawn**2]))[0]

    def fast(values: Floats) -> Floats:
        return np.asarray(values - slow @ (slow.T @ values))

    sag, load, before = -fast(voltage[1:]), fast(current[1:]), fast(current[:-1])
    power = float(before @ load)
    # White noise alone is as likely as not to repeat itself, by one part in the root of the number of samples.
    if power <= 5.0 * float(np.linalg.norm(before) * np.linalg.norm(load)) / np.sqrt(len(load)):
        return Parameter(None, None, _UNIT, "the current hardly changes for longer than its noise")
    resistance = float(before @ sag) / power
    # Noise may be correlated over three seconds.
    spread = long_run_variance(before * (sag - resistance * load), 3.0 / float(np.median(np.diff(t))))
    sigma = float(np.sqrt(len(load) * spread)) / power
    if not resistance > 0.0 or sigma > resistance / 3.0:
        return Parameter(None, None, _UNIT, "the voltage does not follow the current")
    return Parameter(resistance, sigma, _UNIT)
