"""One axis' loop: rate controller of ArduCopter (AC_PID as of 4.0) or PX4, angle controller and gyro filters, discrete.

Per loop of length T: the target passes a first-order low-pass (FLTT), the error e = target - rate another (FLTE);
u = P e + I sum(e T) + D low-pass_FLTD((e - e_before) / T) + FF target + D_FF (target - target_before) / T. P and D
together are scaled by Dmod where their slew exceeds SMAX, and are limited to PDMX; the integral is limited to IMAX and
may only shrink while the mixer is at a limit. Source: ArduPilot libraries/AC_PID/AC_PID.cpp (formulae only).

PX4: ``torque = K (P (target - rate) + I sum((target - rate) T) - D acceleration) + FF target``, with the angular
acceleration through a first-order low-pass (IMU_DGYRO_CUTOFF, here FLTD) and, on yaw since 1.15, the torque through
another (MC_YAW_TQ_CUTOFF). Sources: PX4 src/lib/rate_control, src/modules/mc_att_control,
sensors/vehicle_angular_velocity (formulae only).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from logparse import RotoridError
from sysid.loops.filters import Complexes, DigitalFilter, Floats, cascade, first_order, second_order

#: Axes and how ArduPilot's parameters spell them.
AXES: Mapping[str, str] = {"roll": "RLL", "pitch": "PIT", "yaw": "YAW"}

#: Terms without which a controller is not known; the others are zero where the firmware has no such parameter.
NEEDED = ("P", "I", "D", "FLTT", "FLTE", "FLTD", "IMAX")
OPTIONAL = ("FF", "D_FF", "SMAX", "PDMX")

#: Terms in which the feedback is affine.
_GAINS = ("P", "I", "D", "FF", "D_FF")


class LoopError(RotoridError):
    """The log does not describe the loop: unknown firmware, missing parameters or signals, another craft."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RateController:
    """Gains and filters of one axis of a rate controller, named as ArduCopter's parameters.

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
    K: float = 1.0  #: Factor of P, I and D (PX4).
    output_filter: float = 0.0  #: Low-pass of the torque (MC_YAW_TQ_CUTOFF of PX4), Hz.
    of_target: float = 1.0  #: Part of the target in the derivative: 0 for PX4, whose derivative is that of the rate.

    def error_response(self, hz: Floats) -> Complexes:
        """Compute the response from error (target after its filter, less rate) to output."""
        return np.asarray(self._feedback(hz, self.D) * first_order(self.loop_rate, self.output_filter).response(hz))

    def target_response(self, hz: Floats) -> Complexes:
        """Compute the response from the rate target to output, at constant rate."""
        rate = self.loop_rate
        forward = self.FF + self.D_FF * self._change(hz)
        whole = self._feedback(hz, self.of_target * self.D) + forward
        filters = cascade([first_order(rate, self.FLTT), first_order(rate, self.output_filter)], hz)
        return np.asarray(filters * whole)

    def _feedback(self, hz: Floats, derivative: float) -> Complexes:
        change = self._change(hz)
        pid = self.P + self.I / change + derivative * change * first_order(self.loop_rate, self.FLTD).response(hz)
        return np.asarray(self.K * pid * first_order(self.loop_rate, self.FLTE).response(hz), np.complex128)

    def _change(self, hz: Floats) -> Complexes:
        """Compute the response of the rate of change from one loop to the next."""
        back = np.exp(-2j * np.pi * np.asarray(hz, np.float64) / self.loop_rate)
        return np.asarray(self.loop_rate * (1.0 - back))


@dataclass(frozen=True, slots=True, kw_only=True)
class AngleController:
    """Proportional angle controller: rate target = P (angle target - angle), near zero where it is linear.

    For larger angles ArduPilot's square-root law takes over, which only lowers the gain. It runs after the rate
    controller, which sees its target `late` [s], in the next loop (12 firmware flights: 2.4 to 2.6 ms at 400 Hz).
    """

    P: float
    late: float = 0.0

    def rate_response(self, hz: Floats) -> Complexes:
        """Compute the response from body rate to the rate target: -P / (j w)."""
        return np.asarray(-self.P / (2j * np.pi * np.asarray(hz, np.float64)), np.complex128)

    def delay_response(self, hz: Floats) -> Complexes:
        """Compute the response from the rate target to that which the rate controller sees."""
        return np.asarray(np.exp(-2j * np.pi * self.late * np.asarray(hz, np.float64)), np.complex128)


@dataclass(frozen=True, slots=True)
class GyroPath:
    """Filters between the gyro and the controller: low-pass (INS_GYRO_FILTER, Hz) and notches, at the gyro's rate."""

    low_pass: float
    rate: float
    notches: tuple[DigitalFilter, ...] = ()

    def response(self, hz: Floats) -> Complexes:
        """Compute filtered per true rate."""
        return second_order(self.rate, self.low_pass).response(hz) * cascade(self.notches, hz)


@dataclass(frozen=True, slots=True)
class LoopSettings:
    """Everything of one axis' loop that is in the autopilot: rate controller, angle controller, gyro filters."""

    axis: str
    controller: RateController
    angle: AngleController
    gyro: GyroPath
    remarks: tuple[str, ...] = field(default=())
    autopilot: str = "ArduPilot"

    def feedback(self, hz: Floats) -> Complexes:
        """Compute mixer output per measured rate, sign reversed: rate loop and, through the attitude, angle loop.

        The attitude is the integral of the true rate, not of the filtered one.
        """
        attitude = -self.angle.rate_response(hz) * self.angle.delay_response(hz) / self.gyro.response(hz)
        return np.asarray(self.controller.error_response(hz) + self.controller.target_response(hz) * attitude)

    def feedbacks(self, candidates: Sequence[Mapping[str, float]], hz: Floats) -> Complexes:
        """Compute the feedback with each of many changes (see `changed`), shape (K, n): affine in the gains."""
        result = np.empty((len(candidates), len(hz)), np.complex128)
        alike: dict[tuple[tuple[str, float], ...], list[int]] = {}
        for k, candidate in enumerate(candidates):
            alike.setdefault(tuple(item for item in candidate.items() if item[0] not in _GAINS), []).append(k)
        for filters, rows in alike.items():
            gains = [name for name in _GAINS if name in candidates[rows[0]]]
            bare = self.changed(**dict(filters), **dict.fromkeys(gains, 0.0))
            without = bare.feedback(hz)
            per_unit = [bare.changed(**{name: 1.0}).feedback(hz) - without for name in gains]
            values = np.array([[candidates[k][name] for name in gains] for k in rows])
            result[rows] = without + (values @ np.array(per_unit) if gains else 0.0)
        return result

    def value(self, name: str) -> float:
        """Return a value by a name as in `changed`."""
        others = {"angle_P": self.angle.P, "gyro_filter": self.gyro.low_pass}
        return others[name] if name in others else float(getattr(self.controller, name))

    def changed(self, **values: float) -> LoopSettings:
        """Return the same with other values: a name of `RateController`, `angle_P` or `gyro_filter`.

        LoopError for an unknown name or a value that is negative or not finite.
        """
        for name, value in values.items():
            if not math.isfinite(value) or value < 0.0:
                raise LoopError(f"{name} = {value} is no value of a gain or filter")
        terms = {name: value for name, value in values.items() if name in (*NEEDED, *OPTIONAL)}
        unknown = set(values) - set(terms) - {"angle_P", "gyro_filter"}
        if unknown:
            known = ", ".join((*NEEDED, *OPTIONAL, "angle_P", "gyro_filter"))
            raise LoopError(f"there is no {', '.join(sorted(unknown))}; known are {known}")
        return replace(
            self,
            controller=replace(self.controller, **terms),
            angle=replace(self.angle, P=values.get("angle_P", self.angle.P)),
            gyro=replace(self.gyro, low_pass=values.get("gyro_filter", self.gyro.low_pass)),
        )

    def parameters(self) -> dict[str, float]:
        """Return values by the autopilot's parameter names."""
        controller = self.controller
        if self.autopilot == "PX4":
            name = f"MC_{self.axis.upper()}"
            values = {f"{name}RATE_{term}": getattr(controller, term) for term in ("P", "I", "D", "FF", "K")}
            values |= {f"{name}_P": self.angle.P, "IMU_GYRO_CUTOFF": self.gyro.low_pass}
            values["IMU_DGYRO_CUTOFF"] = controller.FLTD
            return values | ({"MC_YAW_TQ_CUTOFF": controller.output_filter} if controller.output_filter else {})
        letters = AXES[self.axis]
        result = {f"ATC_RAT_{letters}_{name}": getattr(controller, name) for name in (*NEEDED, *OPTIONAL)}
        return result | {f"ATC_ANG_{letters}_P": self.angle.P, "INS_GYRO_FILTER": self.gyro.low_pass}
