"""Which parameter of the autopilot logs what, and to which one value it must be set so that nothing is lacking.

Every piece of advice on logging comes from here, so that it never contradicts itself and never switches off what was
logged. The numbers of bits differ between ArduPilot's vehicles (`defines.h` of each: a rover's bit 10 is the range
finder, a copter's the motor outputs), and PX4 has parameters of its own (``logged_topics.cpp``).
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

from logparse.craft.frames import Vehicle
from logparse.formats import TELEMETRY


class _Logged(Protocol):
    """What is known of a log here, whose type stands above this folder."""

    format: str

    @property
    def vehicle(self) -> Vehicle: ...

    @property
    def parameters(self) -> Mapping[str, float]: ...


class Need(StrEnum):
    """What a log can lack for identification."""

    MOTORS = "motor outputs"
    FAST_MOTORS = "motor outputs at 10 Hz or more"
    IMU = "gyro and accelerometer"
    FAST_IMU = "gyro and accelerometer at the rate of the loop"
    GPS = "GPS"
    BARO = "barometer"
    COMPASS = "magnetometer"
    ATTITUDE = "attitude"
    BATTERY = "battery"
    FAST_RATES = "rate controller at the rate of the loop"
    PID = "terms of the rate controller"


@dataclass(frozen=True, slots=True)
class Bit:
    """One bit of a parameter that chooses what is logged."""

    number: int  #: Counted from 0.
    name: str  #: As ground stations list it.
    logs: str  #: Messages that it brings.

    def __str__(self) -> str:
        return f"bit {self.number} ({self.name})"


_ATTITUDE_FAST = Bit(0, "ATTITUDE_FAST", "ATT, RATE and EKF at the rate of the loop")
_ATTITUDE_MED = Bit(1, "ATTITUDE_MED", "ATT at 10 Hz")
_GPS = Bit(2, "GPS", "GPS")
_IMU = Bit(7, "IMU", "IMU at 25 Hz, and BARO")
_CURRENT = Bit(9, "CURRENT", "BAT or CURR")

#: Shared by all of ArduPilot's vehicles.
_EVERY_VEHICLE: Mapping[Need, Bit] = {
    Need.FAST_RATES: _ATTITUDE_FAST,
    Need.ATTITUDE: _ATTITUDE_MED,
    Need.GPS: _GPS,
    Need.IMU: _IMU,
    # Copter since 3.2, and the others: barometer.set_log_baro_bit(MASK_LOG_IMU).
    Need.BARO: _IMU,
    Need.BATTERY: _CURRENT,
}

#: Bits of LOG_BITMASK by the firmware that has them.
_ARDUPILOT: Mapping[str, Mapping[Need, Bit]] = {
    "ArduCopter": {
        **_EVERY_VEHICLE,
        Need.MOTORS: Bit(10, "RCOUT", "RCOU"),
        Need.FAST_MOTORS: Bit(10, "RCOUT", "RCOU"),
        Need.COMPASS: Bit(13, "COMPASS", "MAG"),
        Need.PID: Bit(12, "PID", "PIDR, PIDP and PIDY"),
        Need.FAST_IMU: Bit(18, "IMU_FAST", "IMU at the rate of the loop"),
    },
    "ArduPlane": {
        **_EVERY_VEHICLE,
        Need.MOTORS: Bit(13, "RC", "RCIN and RCOU"),
        Need.COMPASS: Bit(10, "COMPASS", "MAG"),
    },
    "ArduRover": {
        **_EVERY_VEHICLE,
        Need.MOTORS: Bit(14, "RC", "RCIN and RCOU"),
        Need.COMPASS: Bit(11, "COMPASS", "MAG"),
    },
}

#: First ArduCopter with a bit for the fast IMU; masks of earlier ones have 16 bits.
_FAST_IMU_SINCE = (3, 3)

_DEFAULT_SET = Bit(0, "default set", "actuator outputs, sensors, attitude, position")
_HIGH_RATE = Bit(4, "high rate", "sensors, rates and actuator controls at full rate")

#: Bits of PX4's SDLOG_PROFILE.
_PX4: Mapping[Need, Bit] = dict.fromkeys(Need, _DEFAULT_SET) | {
    Need.FAST_MOTORS: _HIGH_RATE,
    Need.FAST_RATES: _HIGH_RATE,
    Need.PID: _HIGH_RATE,
    Need.FAST_IMU: _HIGH_RATE,
}

#: Stream rates of ArduPilot's telemetry ports that carry what is lacking.
_STREAMS: Mapping[Need, str] = {
    Need.MOTORS: "RC_CHAN",
    Need.FAST_MOTORS: "RC_CHAN",
    Need.IMU: "RAW_SENS",
    Need.FAST_IMU: "RAW_SENS",
    Need.GPS: "EXT_STAT",
    Need.BARO: "RAW_SENS",
    Need.COMPASS: "RAW_SENS",
    Need.BATTERY: "EXT_STAT",
    Need.ATTITUDE: "EXTRA1",
}

#: First ArduPilot whose stream rates are MAVn_, from 1 on; those before have SRn_, from 0 on.
_MAV_STREAMS_SINCE = (4, 7)


@dataclass(frozen=True, slots=True)
class LogSetting:
    """The parameter that chooses what is logged, and its one final value."""

    parameter: str  #: ``"LOG_BITMASK"`` or ``"SDLOG_PROFILE"``.
    #: Its value in the log, as a number of as many bits as the autopilot gives it (-1: all); None where not known.
    present: int | None
    bits: tuple[Bit, ...]  #: All that must be set so that nothing is lacking, in order of their numbers.

    @property
    def added(self) -> tuple[Bit, ...]:
        """Bits that are not set yet."""
        return tuple(bit for bit in self.bits if not self.has(bit))

    @property
    def wanted(self) -> int | None:
        """Final value: every bit that is set stays set; None where the present value is not known."""
        if self.present is None:
            return None
        value = self.present
        for bit in self.bits:
            value |= 1 << bit.number
        return value

    def has(self, bit: Bit) -> bool:
        """Return whether a bit is set in the present value."""
        return self.present is not None and bool(self.present >> bit.number & 1)

    def sentence(self) -> str:
        """Return what to set, in the imperative, without a full stop."""
        bits = ", ".join(map(str, self.added))
        if self.wanted is None:
            return f"Add {bits} to {self.parameter}, keeping what is set"
        return f"Set {self.parameter} to {self.wanted} (it is {self.present}), which adds {bits}"


def mask(value: float | None) -> int | None:
    """Return a parameter that holds bits as a whole number; None where it is missing or no whole number."""
    if value is None or not math.isfinite(value) or value != int(value):
        return None
    return int(value)


def bits_of(vehicle: Vehicle) -> Mapping[Need, Bit]:
    """Return which bit logs what on the autopilot of a craft; of unknown firmware those that all vehicles share."""
    if vehicle.autopilot == "PX4":
        return _PX4
    firmware = vehicle.firmware or ("ArduCopter" if vehicle.frame_class else None)
    bits = dict(_EVERY_VEHICLE if firmware is None else _ARDUPILOT.get(firmware, {}))
    if (version := _version(vehicle)) and version < _FAST_IMU_SINCE:
        bits.pop(Need.FAST_IMU, None)
    return bits


def _version(vehicle: Vehicle) -> tuple[int, int] | None:
    """Return major and minor number of the firmware; None where the log does not tell."""
    version = re.match(r"(\d+)\.(\d+)", vehicle.version or "")
    return version and (int(version[1]), int(version[2]))


def log_setting(
    vehicle: Vehicle,
    format: str,  # noqa: A002 -- as in `FlightLog`
    parameters: Mapping[str, float],
    needs: Collection[Need],
) -> LogSetting | None:
    """Return the one value of the autopilot's parameter that logs everything that is lacking.

    All needs together: advice on each alone would undo the other. None for telemetry and where no bit is known.
    """
    known = bits_of(vehicle)
    bits = tuple(sorted({known[need] for need in needs if need in known}, key=lambda bit: bit.number))
    if format in TELEMETRY or not bits:
        return None
    parameter = "SDLOG_PROFILE" if vehicle.autopilot == "PX4" else "LOG_BITMASK"
    return LogSetting(parameter, mask(parameters.get(parameter)), bits)


def how_to_log(
    need: Need,
    setting: LogSetting | None,
    vehicle: Vehicle,
    format: str,  # noqa: A002 -- as in `FlightLog`
    *,
    said: bool = False,
) -> str:
    """Return a sentence on how to log next time what is lacking here; `said`: the whole setting is told elsewhere."""
    if format in TELEMETRY:
        return _by_radio(need, vehicle)
    bit = bits_of(vehicle).get(need)
    if setting is None or bit is None:
        if need is Need.FAST_IMU and bits_of(vehicle):
            return "This firmware cannot log it faster; newer firmware can."
        return (
            "Set the autopilot to log it; which parameter does so depends on the firmware, which the log does not tell."
        )
    if setting.has(bit):
        return (
            f"Look for the cause in the sensor or the card: {bit} of {setting.parameter} is set already "
            f"({setting.present})."
        )
    if said:
        value = "" if setting.wanted is None else f" = {setting.wanted}"
        return f"{setting.parameter}{value} adds it: {bit.name} logs {bit.logs}."
    return f"{setting.sentence()}. {bit.name} logs {bit.logs}."


def bit_to_set(need: Need, log: _Logged) -> str:
    """Return a clause on how to log one thing, without a value: that is for who knows all that is lacking."""
    if log.format in TELEMETRY:
        return f"log {need} on board: this came by radio"
    setting = log_setting(log.vehicle, log.format, log.parameters, (need,))
    if setting is None:
        return f"log {need}"
    if setting.added:
        return f"log {need}: add {setting.bits[0]} to {setting.parameter}"
    return f"{setting.bits[0]} of {setting.parameter} is set already: look for the cause in the card or the firmware"


def _by_radio(need: Need, vehicle: Vehicle) -> str:
    own = {"PX4": "PX4's own log (.ulg)", "ArduPilot": "the autopilot's DataFlash log (.bin)"}.get(
        vehicle.autopilot or "", "the autopilot's own log"
    )
    if need in (Need.FAST_RATES, Need.PID):
        return f"Telemetry cannot carry them: use {own}."
    prefix = "MAVn_" if (_version(vehicle) or (0, 0)) >= _MAV_STREAMS_SINCE else "SRn_"
    stream = {
        "PX4": "MAV_n_RATE of the telemetry port",
        "ArduPilot": f"{prefix}{_STREAMS[need]} of the telemetry port",
    }.get(vehicle.autopilot or "", "the rate of the telemetry stream")
    return f"Raise {stream}, or use {own}."
