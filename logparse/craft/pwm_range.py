"""How commands become PWM: limits and thrust curve, as the autopilot's parameters set them."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class PwmRange:
    """How motor commands become PWM: limits [us] and fractions of their range, as in `Vehicle`."""

    pwm_min: float
    pwm_max: float
    spin_arm: float
    spin_min: float
    spin_max: float
    thrust_expo: float

    def pwm(self, fraction: float) -> float:
        """PWM [us] at a fraction of the range."""
        return self.pwm_min + fraction * (self.pwm_max - self.pwm_min)

    def thrust(self, pwm: Array) -> Array:
        """Return the thrust at pulses [us], as a part of that at full output."""
        output = np.clip((pwm - self.pwm_min) / (self.pwm_max - self.pwm_min), 0.0, 1.0)
        return np.asarray((1.0 - self.thrust_expo) * output + self.thrust_expo * output**2)


def pwm_range(parameters: Mapping[str, float]) -> PwmRange:
    """Read the PWM range and thrust curve from the parameters of any ArduCopter since 3.0.

    MOT_PWM_MIN and _MAX count when both are set; otherwise ArduCopter drives the motors over the throttle
    channel's calibrated range (RC3_MIN, RC3_MAX). Before 3.4 MOT_SPIN_ARMED is in us above the minimum, THR_MIN
    in thousandths of the range, and before 3.3 the thrust curve is a straight line to MOT_TCRV_MIDPCT percent
    at half and to MOT_TCRV_MAXPCT at full throttle; it is given as the MOT_THST_EXPO that passes through the
    same middle point. Values that no motor can have count as not set, as in a damaged log.
    """

    def get(name: str) -> float | None:
        value = parameters.get(name)
        return None if value is None or not math.isfinite(value) else float(value)

    if "SYS_AUTOSTART" in parameters or "CA_ROTOR_COUNT" in parameters:
        return _px4_pwm_range(parameters)
    low, high = get("MOT_PWM_MIN"), get("MOT_PWM_MAX")
    if not _pulses(low, high):
        low, high = get("Q_THR_MIN_PWM"), get("Q_THR_MAX_PWM")  # QuadPlanes before 4.2
    if not _pulses(low, high):
        channel = int(get("RCMAP_THROTTLE") or 3)
        low, high = get(f"RC{channel}_MIN"), get(f"RC{channel}_MAX")
    if low is None or high is None or not _pulses(low, high):
        low, high = 1000.0, 2000.0
    span = high - low

    arm = get("MOT_SPIN_ARM")
    if arm is None:
        armed_us = get("MOT_SPIN_ARMED")
        arm = 0.1 if armed_us is None else armed_us / span
    lowest = get("MOT_SPIN_MIN")
    if lowest is None:
        throttle_min = get("THR_MIN")
        lowest = 0.15 if throttle_min is None else throttle_min / 1000.0
    curve = get("MOT_TCRV_ENABLE")
    top, expo = get("MOT_SPIN_MAX"), get("MOT_THST_EXPO")
    if top is None:
        top = get("MOT_THST_MAX")
    if curve is not None:
        middle, full = get("MOT_TCRV_MIDPCT"), get("MOT_TCRV_MAXPCT")
        if curve >= 1.0 and middle and full and middle < full:
            share = middle / full
            top, expo = full / 100.0, float(np.clip((share - 0.5) / (share * (1.0 - share)), 0.0, 1.0))
        else:
            top, expo = 1.0, 0.0
    lowest = _fraction(lowest, 0.15)
    top = _fraction(top, 0.95)
    return PwmRange(
        pwm_min=low,
        pwm_max=high,
        spin_arm=_fraction(arm, 0.1),
        spin_min=lowest,
        spin_max=top if top > lowest else 1.0,
        thrust_expo=0.65 if expo is None else float(np.clip(expo, -1.0, 1.0)),
    )


def _pulses(low: float | None, high: float | None) -> bool:
    """Return whether motors can be driven between two pulses, us."""
    return low is not None and high is not None and 500.0 <= low < high <= 2500.0


def _fraction(value: float | None, otherwise: float) -> float:
    return value if value is not None and 0.0 <= value <= 1.0 else otherwise


def _px4_pwm_range(parameters: Mapping[str, float]) -> PwmRange:
    """Read PX4's range: PWM_MAIN_MINn of the motors' outputs, PWM_MIN before 1.13; DShot stands for 1000..2000 us.

    PX4 maps thrust 0..1 onto the whole range (THR_MDL_FAC is the curve that ArduPilot calls MOT_THST_EXPO); on the
    ground its motors turn at up to MPC_MANTHR_MIN.
    """
    outputs = [
        f"PWM_{bank}_{{}}{k}"
        for bank in ("MAIN", "AUX")
        for k in range(1, 17)
        if 101 <= parameters.get(f"PWM_{bank}_FUNC{k}", 0.0) <= 112
    ]
    low, high = (
        min((parameters.get(name.format(end), 0.0) for name in outputs), default=0.0)
        or parameters.get(f"PWM_{end}", 0.0)
        or parameters.get(f"PWM_MAIN_{end}", 0.0)
        for end in ("MIN", "MAX")
    )
    if not _pulses(low, high):
        low, high = 1000.0, 2000.0
    return PwmRange(
        pwm_min=low,
        pwm_max=high,
        spin_arm=0.0,
        spin_min=_fraction(parameters.get("MPC_MANTHR_MIN"), 0.08),
        spin_max=1.0,
        thrust_expo=float(np.clip(parameters.get("THR_MDL_FAC", 0.0), -1.0, 1.0)),
    )
