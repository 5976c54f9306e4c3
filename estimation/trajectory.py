"""The result of estimation: position, velocity and attitude over time, with their covariance."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from core.summary import Summarised, listed
from logparse import Finding, Geodetic
from logparse.tables import between

#: Columns that every trajectory has in `Trajectory.states`, with unit and meaning. Bias columns follow where estimated.
STATE_COLUMNS: Mapping[str, str] = {
    "p_n": "m; position north of the origin",
    "p_e": "m; position east",
    "p_d": "m; position down",
    "v_n": "m/s; velocity north",
    "v_e": "m/s; velocity east",
    "v_d": "m/s; velocity down",
    "q_w": "1; body-to-NED quaternion, scalar first",
    "q_x": "1",
    "q_y": "1",
    "q_z": "1",
    "w_x": "rad/s; angular rate about body x, bias removed",
    "w_y": "rad/s",
    "w_z": "rad/s",
    "f_x": "m/s^2; specific force along body x, bias removed",
    "f_y": "m/s^2",
    "f_z": "m/s^2",
}

#: Columns of `Trajectory.sigma`: the 1-sigma of each error state; attitude errors as rotations about the NED axes.
SIGMA_COLUMNS: Mapping[str, str] = {
    "p_n": "m",
    "p_e": "m",
    "p_d": "m",
    "v_n": "m/s",
    "v_e": "m/s",
    "v_d": "m/s",
    "phi_n": "rad; attitude error about north",
    "phi_e": "rad; about east",
    "phi_d": "rad; about down (yaw)",
}


#: Largest horizontal 1-sigma, m, at which the position counts as known; beyond, it drifted without measurements.
POSITION_KNOWN = 25.0


@dataclass(frozen=True, slots=True, repr=False)
class Trajectory(Summarised):
    """The estimated motion of a log, with findings on its sensors."""

    states: pd.DataFrame  #: Index `t` [s], columns of `STATE_COLUMNS`, then estimated biases.
    #: Same index, columns of `SIGMA_COLUMNS`, then the sigma of each bias column; `"strapdown"` in single precision, as
    #: its covariance.
    sigma: pd.DataFrame
    #: shape (n, 3, 3, 3): Covariances of the errors of position, of velocity and of attitude at each row.
    covariance: np.ndarray
    origin: Geodetic  #: Of the local NED frame. Latitude and longitude are NaN where no sensor measured them.
    #: ``"strapdown"`` (IMU-rate error-state EKF and smoother) or ``"low-rate"`` (telemetry: attitude-aided filter).
    method: str
    #: Of the filter, such as innovation statistics per sensor.
    diagnostics: Mapping[str, object] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()

    @property
    def inconsistency(self) -> str:
        """Why the trajectory must not be used (finding `trajectory-inconsistent`); empty if it may."""
        return next((f.reason for f in self.findings if f.id == "trajectory-inconsistent"), "")

    def unknown_position(self, start: float, stop: float) -> str:
        """Explain why there is no motion to fit between two times; empty where the horizontal position is known.

        Parameters
        ----------
        start, stop : float
            s on the log's clock.
        """
        sigma = between(self.sigma, start, stop)
        largest = float((sigma["p_n"] ** 2 + sigma["p_e"] ** 2).max() ** 0.5)
        if largest <= POSITION_KNOWN:
            return ""
        return (
            f"The horizontal position is not known (its 1-sigma grows to {largest:.0f} m), so there is no motion to "
            "fit: the log has no usable GPS there"
        )

    def summary(self) -> Mapping[str, str]:
        """Return the key facts of this result."""
        t = self.states.index
        return {
            "time": f"{t[0]:.1f} to {t[-1]:.1f} s, {len(t)} samples" if len(t) else "empty",
            "method": self.method,
            "origin": f"{math.degrees(self.origin.lat):.6f} deg N, {math.degrees(self.origin.lon):.6f} deg E",
            "states": listed(list(self.states.columns), 8),
            "findings": listed(dict.fromkeys(finding.id for finding in self.findings)) or "none",
        }
