"""How far the air that nobody measured may pass for drag, or drag for wind.

Drag acts on the speed through the air, ``d (v - w)``. In hover only the product of drag and wind (and the lean of the
thrust) shows; drag by itself is told by what the craft's own velocity changes. The wind's unknown part acts like such
changes and moves the craft besides: with standard deviations s_w of the unknown wind and s_v of the velocity, a
fraction up to (s_w / s_v)^2 of the velocity's power belongs to the wind, and drag is wrong by that part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.rigid_body.body_motion import Motion
from sysid.rigid_body.wind import LIGHT, TURBULENCE, FlightTrim

#: Most that drag is taken to be wrong by, as a part: what is known of it beforehand (0.25 +- 0.5 1/s).
MOST = 2.0


@dataclass(frozen=True, slots=True)
class AirDoubt:
    """Doubt that unknown wind leaves of drag along the body's x and y axes.

    Attributes
    ----------
    speeds : tuple of 2 float
        Standard deviation of the velocity along each axis about each flight's mean over the ground, m/s.
    unknown : float
        Standard deviation of the wind that is not known, m/s.
    """

    speeds: tuple[float, float]
    unknown: float

    def of(self, name: str) -> float:
        """Relative error of a parameter of drag; 0 for any other and along z, where there is no mean wind."""
        if not name.startswith("drag") or name.endswith("z"):
            return 0.0
        return self._part("xy".index(name[-1]))

    def reason(self, name: str) -> str:
        """Say why drag cannot be told, and what to fly."""
        speed = self.speeds["xy".index(name[-1])]
        return (
            f"the speed along this axis varied by {speed:.2g} m/s only, the wind is unknown to {self.unknown:.2g} m/s, "
            "and hover shows the product of drag and wind; fly at several speeds and directions"
        )

    def widened(self, trim: FlightTrim) -> FlightTrim:
        """Add to the error of a wind what comes from its product with drag."""
        part = max(self._part(0), self._part(1))
        speed = float(np.hypot(trim.wind_n, trim.wind_e))
        return replace(trim, wind_sigma=float(np.hypot(trim.wind_sigma * (1.0 + part), part * speed)))

    def _part(self, axis: int) -> float:
        return float(min((self.unknown / max(self.speeds[axis], 1e-9)) ** 2, MOST))


def doubt_of_air(motions: Sequence[Motion], trims: Sequence[FlightTrim], *, varies: bool) -> AirDoubt:
    """Compare the changes of velocity with the wind that is not known.

    Parameters
    ----------
    motions : sequence of Motion
    trims : sequence of FlightTrim
        As fitted, alike.
    varies : bool
        Whether the wind may vary about its mean.
    """
    along, unknown = [], []
    for flight, trim in zip(motions, trims, strict=True):
        # Turning does not tell drag from wind: changes are those over the ground, seen along the axes.
        changes = flight.velocity - flight.velocity.mean(axis=0)
        along.append(np.einsum("nij,ni->nj", flight.rotation.reshape(-1, 3, 3)[:, :, :2], changes))
        strength = float(np.hypot(trim.wind_n, trim.wind_e)) + trim.wind_sigma
        gust = TURBULENCE * max(strength, LIGHT) if varies else 0.0
        unknown.append(np.full(len(flight.t), gust**2 + trim.wind_sigma**2))
    speeds = np.sqrt(np.mean(np.concatenate(along) ** 2, axis=0))
    return AirDoubt((float(speeds[0]), float(speeds[1])), float(np.sqrt(np.mean(np.concatenate(unknown)))))
