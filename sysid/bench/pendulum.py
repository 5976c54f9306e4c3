"""Moments of inertia from a bifilar pendulum, after Kim 2017 (section II.D, eq. 18, 19).

The craft hangs from two parallel threads of length L at distance b on either side of the axis, and swings about it with
period T: ``I = m g T^2 b^2 / (4 pi^2 L)``. A simple pendulum on the same threads checks L through g: ``g = L (2 pi /
T)^2``. (Table 1 of the paper prints inertias about a hundred times larger than its L, b and mass can give with any
period of seconds; the formula is right.)
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import msgspec
import numpy as np

from core.robust import robust_sigma
from core.units import STANDARD_GRAVITY
from logparse import Finding
from sysid.bench.table import BenchError, table_warning

#: An inertia whose standard uncertainty exceeds this part of it is not determined.
DETERMINED = 0.5

#: Lengths, masses, times and g of any pendulum, SI: wide enough for all, so narrow that nothing overflows.
RANGE = (1e-6, 1e6)


class BifilarResult(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True, tag_field="kind", tag="bifilar"):
    """Inertia about one axis."""

    axis: str
    inertia: float  #: kg m^2, of the mean period.
    #: Of the inertias of the single repetitions, as in Table 1: how well swings repeat.
    std: float
    variance: float
    #: Standard uncertainty of `inertia`: repetition over the root of their number (or what a stop-watch shows, where
    #: that is larger), mass, lengths and g together.
    sigma: float
    parts: dict[str, float]  #: Relative contributions: ``period``, ``mass``, ``length``, ``distance``, ``gravity``.
    period: float  #: Mean, s.
    repetitions: int  #: Used.
    determined: bool  #: Whether the inertia is known better than to half of it.
    unit: str
    findings: tuple[Finding, ...]
    thread_check: ThreadCheck | None = None


@dataclass(frozen=True, slots=True)
class Threads:
    """How the craft hangs."""

    length: float  #: L of the threads, m.
    distance: float  #: b from the axis to each thread, m.
    #: Standard uncertainties of the ruler, m.
    length_sigma: float = 0.002
    distance_sigma: float = 0.001


def bifilar(
    times: Sequence[float],
    mass: float,
    threads: Threads,
    *,
    oscillations: int = 10,
    mass_sigma: float = 0.005,
    gravity: float = STANDARD_GRAVITY,
    axis: str = "",
) -> BifilarResult:
    """Compute a moment of inertia from timed swings.

    Parameters
    ----------
    times : sequence of float
        Time of `oscillations` swings in each repetition, s.
    mass : float
        kg.
    threads : Threads
    oscillations : int
    mass_sigma : float
        Standard uncertainty of the mass, kg.
    gravity : float
        m/s^2.
    axis : str
        Name for the result.

    Raises
    ------
    BenchError
        When a number is not positive or beyond any pendulum's, an uncertainty is negative, or fewer than two
        repetitions are usable.
    """
    _require_positive(
        {"mass": mass, "thread length": threads.length, "thread distance": threads.distance, "gravity": gravity}
    )
    for name, sigma in {
        "mass": mass_sigma,
        "thread length": threads.length_sigma,
        "thread distance": threads.distance_sigma,
    }.items():
        if not 0.0 <= sigma <= RANGE[1]:
            raise BenchError(f"standard uncertainty of {name} must be 0 or more, not {sigma:g}")
    periods, findings = _periods(times, oscillations, axis)
    factor = mass * gravity * threads.distance**2 / (4.0 * math.pi**2 * threads.length)
    single = factor * periods**2
    period = float(periods.mean())
    inertia = factor * period**2
    repetition = float(periods.std(ddof=1)) / math.sqrt(len(periods))
    parts = {
        # A stop-watch shows 0.01 s: however alike the times are, their mean is known to 1/sqrt(12) of it only.
        "period": 2.0 * max(repetition, 0.01 / math.sqrt(12.0) / oscillations) / period,
        "mass": mass_sigma / mass,
        "length": threads.length_sigma / threads.length,
        "distance": 2.0 * threads.distance_sigma / threads.distance,
        "gravity": 0.001,
    }
    most = mass * (5.0 * threads.distance) ** 2
    if inertia > most:
        findings.append(
            table_warning(
                f"inertia {inertia:.3g} kg m^2 would need all {mass:g} kg to sit more than "
                f"{5.0 * threads.distance:.2g} m from the axis",
                "check that the times are in seconds, and the number of oscillations and the lengths",
                inertia=inertia,
            )
        )
    relative = math.sqrt(sum(part**2 for part in parts.values()))
    if relative > DETERMINED:
        worst = max(parts, key=lambda name: parts[name])
        findings.append(
            table_warning(
                f"the inertia is known to {100.0 * relative:.0f} % only, most of it from the {worst} "
                f"({100.0 * parts[worst]:.0f} %): it is not determined",
                f"measure the {worst} better",
                relative=relative,
                worst=worst,
            )
        )
    return BifilarResult(
        axis=axis,
        inertia=inertia,
        std=float(single.std(ddof=1)),
        variance=float(single.var(ddof=1)),
        sigma=inertia * relative,
        parts=parts,
        period=period,
        repetitions=len(periods),
        determined=relative <= DETERMINED,
        unit="kg m^2",
        findings=tuple(findings),
    )


@dataclass(frozen=True, slots=True)
class ThreadCheck:
    """Gravity by the simple pendulum, and the thread length that true gravity would take."""

    gravity: float  #: m/s^2, from the assumed length.
    length: float  #: m, from true gravity.
    findings: tuple[Finding, ...]
    kind: Literal["thread-check"] = "thread-check"


def check_thread(
    times: Sequence[float], length: float, *, oscillations: int = 10, gravity: float = STANDARD_GRAVITY
) -> ThreadCheck:
    """Check the thread length by a simple pendulum (eq. 18).

    Parameters
    ----------
    times : sequence of float
        Time of `oscillations` swings, s; one is enough.
    length : float
        m, from the suspension to the centre of gravity.
    oscillations : int
    gravity : float
        m/s^2.

    Raises
    ------
    BenchError
        When a number is not positive.
    """
    _require_positive({"thread length": length, "gravity": gravity, "number of oscillations": oscillations})
    _require_positive({f"time {k}": time for k, time in enumerate(times, start=1)})
    if not len(times):
        raise BenchError("no time of the simple pendulum given")
    period = float(np.mean(times)) / oscillations
    measured = length * (2.0 * math.pi / period) ** 2
    true_length = gravity * (period / (2.0 * math.pi)) ** 2
    off = measured / gravity - 1.0
    findings: tuple[Finding, ...] = ()
    if abs(off) > 0.02:
        findings = (
            table_warning(
                f"the simple pendulum gives g = {measured:.2f} m/s^2, {100.0 * off:+.1f} %: the thread is "
                f"{true_length:.3f} m long rather than {length:.3f} m, or swings were miscounted",
                "measure from the suspension to the centre of gravity; inertia errs by as much",
                gravity=measured,
                length=true_length,
            ),
        )
    return ThreadCheck(measured, true_length, findings)


def _require_positive(numbers: dict[str, float]) -> None:
    for name, value in numbers.items():
        if not (math.isfinite(value) and value > 0.0):
            raise BenchError(f"{name} must be a positive number, not {value:g}")
        if not RANGE[0] <= value <= RANGE[1]:
            raise BenchError(f"{name} of {value:g} is beyond any pendulum's; give s, m and kg")


def _periods(times: Sequence[float], oscillations: int, axis: str) -> tuple[np.ndarray, list[Finding]]:
    _require_positive({"number of oscillations": oscillations})
    _require_positive({f"time {k}": time for k, time in enumerate(times, start=1)})
    label = f"axis {axis}: " if axis else ""
    if len(times) < 2:
        raise BenchError(
            f"{label}{len(times)} repetition(s); two or more show how well swings repeat (Kim 2017: twenty)"
        )
    periods = np.asarray(times, dtype=np.float64) / oscillations
    middle = float(np.median(periods))
    scale = max(robust_sigma(periods - middle), 0.002 * middle)
    # A swing too many or too few changes the time by a whole period.
    bad = np.abs(periods - middle) > max(5.0 * scale, 0.5 * middle / oscillations)
    if not bad.any():
        return periods, []
    if np.count_nonzero(~bad) < 2:
        raise BenchError(f"{label}times of {oscillations} swings disagree: {', '.join(f'{t:g}' for t in times)} s")
    return periods[~bad], [
        table_warning(
            f"{label}{np.count_nonzero(bad)} time(s) differ by about a swing from the others "
            f"({', '.join(f'{t:g}' for t in np.asarray(times)[bad])} s); left out",
            "count again",
            left_out=int(np.count_nonzero(bad)),
        )
    ]
