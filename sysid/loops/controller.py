"""ArduCopter's rate controller (AC_PID as of 4.0) and angle controller, with their discrete filters at the loop rate.

Per loop of length T: the target passes a first-order low-pass (FLTT), the error e = target - rate another (FLTE);
u = P e + I sum(e T) + D low-pass_FLTD((e - e_before) / T) + FF target + D_FF (target - target_before) / T. P and D
together are scaled by Dmod where their slew exceeds SMAX, and are limited to PDMX; the integral is limited to IMAX and
may only shrink while the mixer is at a limit. Source: ArduPilot libraries/AC_PID/AC_PID.cpp (formulae only).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.loops.filters import Complexes, Floats, first_order
from sysid.records.filtering import lfilter


@dataclass(frozen=True, slots=True)
class PidTerms:
    """Terms of the controller's output, each of shape (N,); their sum goes to the mixer."""

    P: Floats
    I: Floats  # noqa: E741 -- the field's letter
    D: Floats
    FF: Floats
    DFF: Floats

    @property
    def total(self) -> Floats:
        """Output of the controller."""
        return self.P + self.I + self.D + self.FF + self.DFF


@dataclass(frozen=True, slots=True, kw_only=True)
class RateController:
    """Gains and filters of one axis of ArduCopter's rate controller, named as its parameters.

    Rates in rad/s, output in units of the mixer (-1..1), filters in Hz (0: none), `loop_rate` in Hz.
    """

    P: float
    I: float  # noqa: E741 -- the field's letter
    D: float
    FF: float = 0.0
    D_FF: float = 0.0
    FLTT: float = 0.0
    FLTE: float = 0.0
    FLTD: float = 0.0
    SMAX: float = 0.0
    PDMX: float = 0.0
    IMAX: float = 1.0
    loop_rate: float = 400.0

    def error_response(self, hz: Floats) -> Complexes:
        """Compute the response from error (target after its filter, less rate) to output."""
        rate = self.loop_rate
        back = np.exp(-2j * np.pi * np.asarray(hz, np.float64) / rate)
        integral = 1.0 / (rate * (1.0 - back))
        derivative = rate * (1.0 - back) * first_order(rate, self.FLTD).response(hz)
        pid = self.P + self.I * integral + self.D * derivative
        return np.asarray(pid * first_order(rate, self.FLTE).response(hz), np.complex128)

    def target_response(self, hz: Floats) -> Complexes:
        """Compute the response from the rate target to output, at constant rate."""
        rate = self.loop_rate
        back = np.exp(-2j * np.pi * np.asarray(hz, np.float64) / rate)
        forward = self.FF + self.D_FF * rate * (1.0 - back)
        return np.asarray(first_order(rate, self.FLTT).response(hz) * (self.error_response(hz) + forward))

    def run(self, target: Floats, rate: Floats) -> PidTerms:
        """Run the controller over samples of its loop, from rest; limits (SMAX, PDMX) are not reached.

        Parameters
        ----------
        target, rate : ndarray, shape (N,)
            rad/s at every loop; `target` is before its filter.
        """
        filtered = first_order(self.loop_rate, self.FLTT).run(target)
        return self.run_error(first_order(self.loop_rate, self.FLTE).run(filtered - rate), filtered)

    def run_error(self, error: Floats, target: Floats) -> PidTerms:
        """Run the controller over the filtered error and target (PIDR.Err and .Tar), rad/s at every loop."""
        change = np.diff(error, prepend=error[:1]) * self.loop_rate
        integral = np.clip(lfilter([self.I / self.loop_rate], [1.0, -1.0], error), -self.IMAX, self.IMAX)
        return PidTerms(
            P=self.P * error,
            I=np.asarray(integral, np.float64),
            D=self.D * first_order(self.loop_rate, self.FLTD).run(change),
            FF=self.FF * target,
            DFF=self.D_FF * np.diff(target, prepend=target[:1]) * self.loop_rate,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class AngleController:
    """Proportional angle controller: rate target = P (angle target - angle), near zero where it is linear.

    Beyond `linear` [rad] ArduPilot's square-root law takes over, which only lowers the gain. It runs after the rate
    controller, which sees its target `late` [s], in the next loop (12 firmware flights: 2.4 to 2.6 ms at 400 Hz).
    """

    P: float
    linear: float = float("inf")
    late: float = 0.0

    def rate_response(self, hz: Floats) -> Complexes:
        """Compute the response from body rate to the rate target: -P / (j w)."""
        return np.asarray(-self.P / (2j * np.pi * np.asarray(hz, np.float64)), np.complex128)

    def delay_response(self, hz: Floats) -> Complexes:
        """Compute the response from the rate target to that which the rate controller sees."""
        return np.asarray(np.exp(-2j * np.pi * self.late * np.asarray(hz, np.float64)), np.complex128)
