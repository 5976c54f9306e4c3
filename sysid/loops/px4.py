"""PX4's rate and attitude controllers as a log's parameters give them.

``torque = K (P (target - rate) + I sum((target - rate) T) - D acceleration) + FF target``, with the angular
acceleration through a first-order low-pass (IMU_DGYRO_CUTOFF) and, on yaw since 1.15, the torque through another
(MC_YAW_TQ_CUTOFF). Sources: PX4 src/lib/rate_control, src/modules/mc_att_control, sensors/vehicle_angular_velocity
(formulae only).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from logparse import FlightLog
from sysid.loops.controller import AngleController, GyroPath, LoopError, LoopSettings, RateController
from sysid.loops.filters import Complexes, DigitalFilter, Floats, first_order

#: Versions whose rate controller is this one.
OLDEST, NEWEST = (1, 11), (1, 17)

#: Rate of the control loops [Hz] where IMU_GYRO_RATEMAX is not set, and of the gyro's filters on usual boards.
_LOOP_RATE, _GYRO_RATE = 400.0, 8000.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Px4RateController(RateController):
    """PX4's rate controller of one axis: the derivative is that of the rate alone, `FLTD` is IMU_DGYRO_CUTOFF."""

    K: float = 1.0  #: Factor of P, I and D.
    output_filter: float = 0.0  #: Low-pass of the torque (MC_YAW_TQ_CUTOFF), Hz.

    def _part(self, hz: Floats, derivative: float) -> Complexes:
        rate = self.loop_rate
        back = np.exp(-2j * np.pi * np.asarray(hz, np.float64) / rate)
        change = rate * (1.0 - back) * first_order(rate, self.FLTD).response(hz)
        pid = self.P + self.I / (rate * (1.0 - back)) + derivative * change
        return np.asarray(self.K * pid, np.complex128)

    def error_response(self, hz: Floats) -> Complexes:
        """Compute the response from rate, sign reversed, to torque."""
        return np.asarray(self._part(hz, self.D) * first_order(self.loop_rate, self.output_filter).response(hz))

    def target_response(self, hz: Floats) -> Complexes:
        """Compute the response from the rate target to torque, at constant rate."""
        through = first_order(self.loop_rate, self.output_filter).response(hz)
        return np.asarray((self._part(hz, 0.0) + self.FF) * through)


@dataclass(frozen=True, slots=True)
class Px4Settings(LoopSettings):
    """An axis' loop of PX4."""

    def parameters(self) -> dict[str, float]:
        """Return values by the autopilot's parameter names."""
        name = self.axis.upper()
        controller = self.controller
        assert isinstance(controller, Px4RateController)
        values = {f"MC_{name}RATE_{term}": getattr(controller, term) for term in ("P", "I", "D", "FF", "K")}
        values |= {f"MC_{name}_P": self.angle.P, "IMU_GYRO_CUTOFF": self.gyro.low_pass}
        values["IMU_DGYRO_CUTOFF"] = controller.FLTD
        return values | ({"MC_YAW_TQ_CUTOFF": controller.output_filter} if controller.output_filter else {})


def check_version(log: FlightLog) -> None:
    """Raise where the rate controller of a log's PX4 is not this one."""
    known = f"known are those of PX4 {OLDEST[0]}.{OLDEST[1]} to {NEWEST[0]}.{NEWEST[1]}"
    numbers = re.match(r"v?(\d+)\.(\d+)", log.vehicle.version or "")
    if numbers is None:
        raise LoopError(f"{log.path.name} does not tell the version of PX4, whose loops differ; {known}")
    if not OLDEST <= (int(numbers[1]), int(numbers[2])) <= NEWEST:
        raise LoopError(f"{log.path.name} is of PX4 {log.vehicle.version}, whose rate controller is another; {known}")


def read_px4(log: FlightLog, axis: str) -> Px4Settings:
    """Read an axis' loop from the parameters of a log of PX4."""
    check_version(log)
    parameters, name = log.parameters_flown, axis.upper()
    wanted = [f"MC_{name}RATE_{term}" for term in ("P", "I", "D")] + [f"MC_{name}_P", "IMU_GYRO_CUTOFF"]
    missing = [each for each in wanted if each not in parameters]
    if missing:
        raise LoopError(
            f"{log.path.name} lacks {', '.join(missing[:4])}{' ...' if len(missing) > 4 else ''}: without the "
            "parameters the loop is unknown"
        )
    loop_rate = parameters.get("IMU_GYRO_RATEMAX", 0.0) or _LOOP_RATE
    remarks = []
    if int(parameters.get("IMU_GYRO_DNF_EN", 0.0)):
        remarks.append(f"{axis}: the gyro's dynamic notches (IMU_GYRO_DNF_EN) are left out: the true lag is larger")
    if parameters.get("MC_BAT_SCALE_EN", 0.0) > 0.0:
        remarks.append(f"{axis}: MC_BAT_SCALE_EN raises the gains as the battery empties")
    return Px4Settings(
        axis=axis,
        controller=Px4RateController(
            **{term: parameters.get(f"MC_{name}RATE_{term}", 0.0) for term in ("P", "I", "D", "FF")},
            K=parameters.get(f"MC_{name}RATE_K", 1.0),
            FLTD=parameters.get("IMU_DGYRO_CUTOFF", 0.0),
            IMAX=parameters.get(f"MC_{name[0]}R_INT_LIM", 1.0),
            output_filter=parameters.get("MC_YAW_TQ_CUTOFF", 0.0) if axis == "yaw" else 0.0,
            loop_rate=loop_rate,
        ),
        angle=AngleController(P=parameters[f"MC_{name}_P"]),
        gyro=GyroPath(parameters["IMU_GYRO_CUTOFF"], _GYRO_RATE, _notches(parameters)),
        remarks=tuple(remarks),
    )


def _notches(parameters: Mapping[str, float]) -> tuple[DigitalFilter, ...]:
    """Return the static notches of the gyro (IMU_GYRO_NF0 and NF1)."""
    found = []
    for k in range(2):
        centre, width = (parameters.get(f"IMU_GYRO_NF{k}_{each}", 0.0) for each in ("FRQ", "BW"))
        if centre > 0.0 and width > 0.0:
            alpha, beta = math.tan(math.pi * width / _GYRO_RATE), -math.cos(2.0 * math.pi * centre / _GYRO_RATE)
            scale = 1.0 / (1.0 + alpha)
            b = (scale, 2.0 * beta * scale, scale)
            found.append(DigitalFilter(b, (1.0, b[1], (1.0 - alpha) * scale), _GYRO_RATE))
    return tuple(found)
