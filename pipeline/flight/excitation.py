"""How much a flight moved the craft, axis by axis: what of it an identification can be made from."""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING

import numpy as np

from core.units import STANDARD_GRAVITY
from pipeline.results.coverage import AxisExcitation, Excitation, Linearity
from sysid.records.excitation import Coherence
from sysid.records.thrust_curve import VARYING
from sysid.rigid_body.rotation import STILL

if TYPE_CHECKING:
    import pandas as pd
    from numpy.typing import NDArray

    from estimation import Trajectory

    Floats = NDArray[np.float64]

#: Time over which changes of velocity are taken, s: shorter ones are noise of the estimate and gusts.
SPAN = 1.0

#: Frequencies over which coherence is summed up, rad/s: where a multirotor answers to its commands.
BAND = (0.5, 5.0)

#: Sectors of heading that are counted.
SECTORS = 8

#: Time in a sector of heading that counts, s.
IN_SECTOR = 3.0

#: Excitation in multiples of what hardly tells anything: below the first none, then weak, fair, strong.
_WORDS = ((0.5, "none"), (1.0, "weak"), (4.0, "fair"), (float("inf"), "strong"))


def excitation_of(trajectory: Trajectory, context: pd.DataFrame) -> Excitation:
    """Measure how much a flight moved."""
    t = context.index.to_numpy(np.float64)
    dt = float(t[1] - t[0])
    velocity = context[["v_n", "v_e", "v_d"]].to_numpy()
    step = min(max(round(SPAN / dt), 1), len(t) - 1)
    change = (velocity[step:] - velocity[:-step]) / (step * dt)
    sigma = trajectory.sigma.loc[t[0] : t[-1], ["v_n", "v_e", "v_d"]].to_numpy()
    yaw, departure = context["yaw"].to_numpy(), velocity[:, :2] - velocity[:, :2].mean(axis=0)
    along = np.cos(yaw) * departure[:, 0] + np.sin(yaw) * departure[:, 1]
    across = np.cos(yaw) * departure[:, 1] - np.sin(yaw) * departure[:, 0]
    # Sectors are centred on the points of the compass, so that a heading held north is one of them.
    sectors = np.rint(yaw * SECTORS / (2.0 * pi)).astype(np.int64) % SECTORS
    return Excitation(
        acceleration_rms=_rms(change),
        # Errors a second apart are taken as independent, which can only make the noise larger than it is.
        acceleration_noise=float(np.sqrt(2.0 * np.mean(np.sum(sigma**2, axis=1))) / (step * dt))
        if len(sigma)
        else None,
        speed_std=(float(along.std()), float(across.std())),
        headings=int(np.sum(np.bincount(sectors, minlength=SECTORS) * dt >= IN_SECTOR)),
        axes=_axes(context, round(1.0 / dt)),
    )


def _rms(vectors: Floats) -> float:
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=1))))


def _axes(context: pd.DataFrame, per_second: int) -> dict[str, AxisExcitation]:
    force = context["f_z"].rolling(max(per_second, 1), center=True).mean().dropna().to_numpy()
    size = float(np.std(force)) if len(force) else 0.0
    axes = {
        axis: AxisExcitation(
            rms=float(context[rate].std(ddof=0)),
            unit="rad/s",
            word=word_of(float(context[rate].std(ddof=0)) / STILL),
        )
        for axis, rate in (("roll", "w_x"), ("pitch", "w_y"), ("yaw", "w_z"))
    }
    axes["thrust"] = AxisExcitation(rms=size, unit="m/s^2", word=word_of(size / (VARYING * STANDARD_GRAVITY)))
    return axes


def word_of(multiple: float) -> str:
    """Return the word for how much moved, as a multiple of what a craft at rest shows."""
    return next(word for limit, word in _WORDS if multiple < limit or limit == float("inf"))


def in_band(found: Coherence) -> dict[str, Linearity] | None:
    """Sum a coherence up over the frequencies at which a multirotor answers; None where it has none of them."""
    band = (found.frequency >= BAND[0]) & (found.frequency <= BAND[1])
    if not band.any():
        return None
    return {
        output: Linearity(
            multiple_median=float(np.median(multiple[band])),
            above_chance=float(np.mean(multiple[band] > found.threshold)),
        )
        for output, multiple in zip(found.output_names, found.multiple.T, strict=True)
    }
