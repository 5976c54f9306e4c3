"""Gains and filters of one axis' loop as the parameters of a log give them, whichever autopilot wrote it."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from enum import IntEnum

import numpy as np
import pandas as pd

from logparse import FlightLog
from sysid.frequency.excitation import mixer_chirps
from sysid.loops.controller import (
    AXES,
    NEEDED,
    OPTIONAL,
    AngleController,
    GyroPath,
    LoopError,
    LoopSettings,
    RateController,
)
from sysid.loops.filters import DigitalFilter, harmonic_notches

#: Firmware whose rate controllers are those in `controller`: ArduCopter's, and PX4's.
OLDEST, NEWEST = (4, 0), (4, 7)
_PX4_OLDEST, _PX4_NEWEST = (1, 11), (1, 17)

#: Rate of PX4's control loops [Hz] where IMU_GYRO_RATEMAX is not set, and of the gyro's filters on usual boards.
_PX4_LOOP_RATE, _PX4_GYRO_RATE = 400.0, 8000.0

#: Harmonic notches by the beginning of their parameters.
NOTCHES = ("INS_HNTCH_", "INS_HNTC2_", "INS_HNTC3_")


class Follows(IntEnum):
    """What a harmonic notch follows (its MODE)."""

    NOTHING, THROTTLE, ESC = 0, 1, 3


def read_settings(log: FlightLog, axis: str) -> LoopSettings:
    """Read an axis' loop from the parameters of a log.

    Raises
    ------
    LoopError
        For an unknown axis or firmware, or where parameters are missing.
    """
    if axis not in AXES:
        raise LoopError(f"there is no rate loop {axis!r}; the axes are {', '.join(AXES)}")
    return _read_px4(log, axis) if log.vehicle.firmware == "PX4" else read_copter(log, axis)


def shared_settings(logs: Sequence[FlightLog], axis: str) -> LoopSettings:
    """Read an axis' loop from logs that share it; LoopError where they differ."""
    first, *others = [read_settings(log, axis) for log in logs]
    if any(other.parameters() != first.parameters() for other in others):
        raise LoopError(
            f"{axis}: the flights differ in their settings: identify each on its own, or compare them with "
            "`rotorid prove`"
        )
    return first


def check_firmware(log: FlightLog) -> None:
    """Raise where the loops of a log's firmware are not known."""
    if log.vehicle.firmware == "PX4":
        _px4_version(log)
    else:
        firmware_version(log)


def firmware_version(log: FlightLog) -> tuple[int, int]:
    """Return major and minor version of ArduCopter, or of ArduPlane, whose QuadPlanes have the copter's controller."""
    vehicle = log.vehicle
    known = (
        f"known are the rate loops of ArduCopter, and of ArduPlane's QuadPlanes, {OLDEST[0]}.{OLDEST[1]} to "
        f"{NEWEST[0]}.{NEWEST[1]}"
    )
    if not vehicle.firmware:
        raise LoopError(f"{log.path.name} does not tell its firmware; {known}")
    if vehicle.firmware != "ArduCopter" and (vehicle.firmware != "ArduPlane" or vehicle.other_craft):
        raise LoopError(f"{log.path.name} is of {vehicle.firmware} {vehicle.version or ''}".rstrip() + f"; {known}")
    numbers = re.match(r"(\d+)\.(\d+)", vehicle.version or "")
    if numbers is None:
        raise LoopError(f"{log.path.name} does not tell the version of {vehicle.firmware}; {known}")
    version = int(numbers[1]), int(numbers[2])
    if not OLDEST <= version <= NEWEST:
        raise LoopError(
            f"{log.path.name} is of {vehicle.firmware} {vehicle.version}, whose controller is another; {known}"
        )
    return version


def _px4_version(log: FlightLog) -> None:
    """Raise where the rate controller of a log's PX4 is not the known one."""
    (oldest, least), (newest, most) = _PX4_OLDEST, _PX4_NEWEST
    known = f"known are those of PX4 {oldest}.{least} to {newest}.{most}"
    numbers = re.match(r"v?(\d+)\.(\d+)", log.vehicle.version or "")
    if numbers is None:
        raise LoopError(f"{log.path.name} does not tell the version of PX4, whose loops differ; {known}")
    if not _PX4_OLDEST <= (int(numbers[1]), int(numbers[2])) <= _PX4_NEWEST:
        raise LoopError(f"{log.path.name} is of PX4 {log.vehicle.version}, whose rate controller is another; {known}")


def _require(log: FlightLog, parameters: Mapping[str, float], wanted: Sequence[str], advice: str = "") -> None:
    """Refuse a log that lacks parameters of its loops."""
    missing = [name for name in wanted if name not in parameters]
    if missing:
        raise LoopError(
            f"{log.path.name} lacks {', '.join(missing[:4])}{' ...' if len(missing) > 4 else ''}: without the "
            f"parameters the loop is unknown{advice}"
        )


def read_copter(log: FlightLog, axis: str) -> LoopSettings:
    """Read an axis' loop from the parameters of a log of ArduCopter."""
    firmware_version(log)
    parameters = parameters_of(log, axis)
    letters = AXES[axis]
    wanted = [f"ATC_RAT_{letters}_{name}" for name in NEEDED]
    wanted += [f"ATC_ANG_{letters}_P", "INS_GYRO_FILTER", "SCHED_LOOP_RATE"]
    _require(log, parameters, wanted, "; keep LOG_DISARMED or the start of the log, where they are written")
    if not parameters["SCHED_LOOP_RATE"] > 0.0:
        raise LoopError(f"{log.path.name}: SCHED_LOOP_RATE = {parameters['SCHED_LOOP_RATE']:g} is no rate of a loop")
    if parameters.get("FSTRATE_ENABLE", 0.0) > 0.0:
        raise LoopError(f"{log.path.name}: the rate loop runs in its own thread (FSTRATE_ENABLE), at an unknown rate")
    odd = [f"ATC_RAT_{letters}_{n}" for n in ("NTF", "NEF") if parameters.get(f"ATC_RAT_{letters}_{n}", 0.0) > 0.0]
    if odd:
        raise LoopError(f"{log.path.name}: notches within the controller ({', '.join(odd)}) are not modelled")
    terms = {name: parameters.get(f"ATC_RAT_{letters}_{name}", 0.0) for name in (*NEEDED, *OPTIONAL)}
    gyro, remarks = _gyro_path(log, axis, parameters)
    return LoopSettings(
        axis=axis,
        controller=RateController(**terms, loop_rate=parameters["SCHED_LOOP_RATE"]),
        angle=AngleController(P=parameters[f"ATC_ANG_{letters}_P"], late=1.0 / parameters["SCHED_LOOP_RATE"]),
        gyro=gyro,
        remarks=remarks,
    )


def _read_px4(log: FlightLog, axis: str) -> LoopSettings:
    """Read an axis' loop from the parameters of a log of PX4."""
    _px4_version(log)
    parameters, name = log.parameters_flown, axis.upper()
    wanted = [f"MC_{name}RATE_{term}" for term in ("P", "I", "D")] + [f"MC_{name}_P", "IMU_GYRO_CUTOFF"]
    _require(log, parameters, wanted)
    remarks = []
    if int(parameters.get("IMU_GYRO_DNF_EN", 0.0)):
        remarks.append(f"{axis}: the gyro's dynamic notches (IMU_GYRO_DNF_EN) are left out: the true lag is larger")
    if parameters.get("MC_BAT_SCALE_EN", 0.0) > 0.0:
        remarks.append(f"{axis}: MC_BAT_SCALE_EN raises the gains as the battery empties")
    notches = []
    for k in range(2):
        centre, width = (parameters.get(f"IMU_GYRO_NF{k}_{suffix}", 0.0) for suffix in ("FRQ", "BW"))
        if centre > 0.0 and width > 0.0:
            alpha, beta = (f(math.pi * x / _PX4_GYRO_RATE) for f, x in ((math.tan, width), (math.cos, 2.0 * centre)))
            scale = 1.0 / (1.0 + alpha)
            b = (scale, -2.0 * beta * scale, scale)
            notches.append(DigitalFilter(b, (1.0, b[1], (1.0 - alpha) * scale), _PX4_GYRO_RATE))
    return LoopSettings(
        axis=axis,
        controller=RateController(
            **{term: parameters.get(f"MC_{name}RATE_{term}", 0.0) for term in ("P", "I", "D", "FF")},
            K=parameters.get(f"MC_{name}RATE_K", 1.0),
            FLTD=parameters.get("IMU_DGYRO_CUTOFF", 0.0),
            IMAX=parameters.get(f"MC_{name[0]}R_INT_LIM", 1.0),
            output_filter=parameters.get("MC_YAW_TQ_CUTOFF", 0.0) if axis == "yaw" else 0.0,
            of_target=0.0,
            loop_rate=parameters.get("IMU_GYRO_RATEMAX", 0.0) or _PX4_LOOP_RATE,
        ),
        angle=AngleController(P=parameters[f"MC_{name}_P"]),
        gyro=GyroPath(parameters["IMU_GYRO_CUTOFF"], _PX4_GYRO_RATE, tuple(notches)),
        remarks=tuple(remarks),
        autopilot="PX4",
    )


def parameters_of(log: FlightLog, axis: str) -> Mapping[str, float]:
    """Return the parameters that held during the last chirp at the mixer on an axis; without one those of the flight.

    The published procedure sets I of the axis under test to 0 in the air, just before its chirp.
    """
    chirps = mixer_chirps(log, axis)
    return log.parameters_at(chirps[-1].start) if chirps else log.parameters_flown


def _gyro_path(log: FlightLog, axis: str, parameters: Mapping[str, float]) -> tuple[GyroPath, tuple[str, ...]]:
    """Read the gyro's filters; harmonic notches at the frequency that they had."""
    # Most boards that log no rate run their filters at this one.
    rate, remarks = 1000.0, []
    imu = log.messages.once("IMU", ("GHz", "I")) if "IMU" in log.messages else None
    if imu is not None and "GHz" in imu:
        first = imu[imu["I"] == 0] if "I" in imu else imu
        logged = first["GHz"].to_numpy(np.float64)
        logged = logged[np.isfinite(logged) & (logged > 100.0)]
        rate = float(np.median(logged)) if len(logged) else rate
    notches: list[DigitalFilter] = []
    for prefix in NOTCHES:
        if parameters.get(f"{prefix}ENABLE", 0.0) <= 0.0:
            continue
        wanted = [prefix + name for name in ("FREQ", "BW", "ATT", "HMNCS")]
        lacking = [name for name in wanted if name not in parameters]
        if lacking:
            raise LoopError(f"{log.path.name} lacks {', '.join(lacking)} of a notch that is enabled")
        none = [f"{name} = {parameters[name]:g}" for name in wanted[:3] if not parameters[name] > 0.0]
        if none:
            raise LoopError(f"{log.path.name}: {', '.join(none)} of a notch that is enabled is no value of one")
        base, remark = _notch_base(log, axis, parameters, prefix)
        notches += notch_at(parameters, prefix, rate, base)
        remarks.append(remark)
    return GyroPath(parameters["INS_GYRO_FILTER"], rate, tuple(notches)), tuple(remarks)


def notch_at(parameters: Mapping[str, float], prefix: str, rate: float, base: float) -> tuple[DigitalFilter, ...]:
    """Return a harmonic notch, whose parameters begin so, where its first harmonic is at `base`, Hz."""
    options = int(parameters.get(f"{prefix}OPTS", 0.0))
    return harmonic_notches(
        rate,
        base,
        nominal=parameters[f"{prefix}FREQ"],
        bandwidth=parameters[f"{prefix}BW"],
        attenuation_db=parameters[f"{prefix}ATT"],
        harmonics=int(parameters[f"{prefix}HMNCS"]),
        composite=2 if options & 1 else 3 if options & 16 else 1,
    )


def notch_frequency(
    parameters: Mapping[str, float], prefix: str, throttle: float | None, rotors_hz: float | None = None
) -> float:
    """Return where the first harmonic of a notch is, Hz: at FREQ unless what it follows is known."""
    nominal, reference = parameters[f"{prefix}FREQ"], parameters.get(f"{prefix}REF", 0.0)
    mode = int(parameters.get(f"{prefix}MODE", 0.0))
    if not reference > 0.0:
        return nominal
    if mode == Follows.THROTTLE and throttle is not None:
        return nominal * max(parameters.get(f"{prefix}FM_RAT", 1.0), math.sqrt(throttle / reference))
    # Of what it can follow the speed of the rotors; FREQ is the lowest.
    return max(nominal, rotors_hz) if mode > Follows.THROTTLE and rotors_hz is not None else nominal


def _notch_base(log: FlightLog, axis: str, parameters: Mapping[str, float], prefix: str) -> tuple[float, str]:
    """Return the frequency of the first harmonic, Hz: as tracked (FTN, FTN1), else from the throttle flown."""
    mode, nominal, name = int(parameters.get(f"{prefix}MODE", 0.0)), parameters[f"{prefix}FREQ"], prefix.rstrip("_")
    if mode == Follows.NOTHING or parameters.get(f"{prefix}REF", 0.0) <= 0.0:
        return nominal, f"{name} fixed at {nominal:.0f} Hz"
    if prefix == "INS_HNTCH_":
        for message in ("FTN", "FTN1"):
            if message in log.messages and "NF1" in log.messages[message]:
                tracked = log.messages[message]["NF1"].to_numpy(np.float64)
                tracked = tracked[np.isfinite(tracked) & (tracked > 0.0)]
                if len(tracked):
                    return float(np.median(tracked)), f"{name} tracked, median {np.median(tracked):.0f} Hz"
    throttle = _throttle(log, axis) or parameters.get("MOT_THST_HOVER")
    if mode == Follows.THROTTLE and throttle:
        base = notch_frequency(parameters, prefix, throttle)
        return base, f"{name} follows throttle, {base:.0f} Hz at the {throttle:.2f} flown"
    return nominal, f"{name} tracks a frequency that is not logged; taken at its lowest, {nominal:.0f} Hz"


def _throttle(log: FlightLog, axis: str) -> float | None:
    """Return the median throttle of the chirps at the mixer on an axis, without one of the flight, 0..1."""
    throttle, flight = log.tables.column("setpoints", "throttle"), log.flight
    if throttle is None or flight is None:
        return None
    spans = [(chirp.start, chirp.stop) for chirp in mixer_chirps(log, axis)] or [(flight.start, flight.stop)]
    values = pd.concat([throttle.loc[start:stop] for start, stop in spans]).dropna()
    return float(values.median()) if len(values) else None
