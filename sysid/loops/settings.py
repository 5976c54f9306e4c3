"""Gains and filters of one axis' loop as the parameters of a log give them, whichever autopilot wrote it."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from logparse import FlightLog
from sysid.loops import px4
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
from sysid.loops.signals import mixer_chirps

#: Firmware whose rate controller is the one in `controller`.
OLDEST, NEWEST = (4, 0), (4, 7)

#: Frequency-tracking modes of the harmonic notch (INS_HNTCH_MODE).
_FIXED, _THROTTLE = 0, 1


def read_settings(log: FlightLog, axis: str) -> LoopSettings:
    """Read an axis' loop from the parameters of a log.

    Raises
    ------
    LoopError
        For an unknown axis or firmware, or where parameters are missing.
    """
    if axis not in AXES:
        raise LoopError(f"there is no rate loop {axis!r}; the axes are {', '.join(AXES)}")
    return px4.read_px4(log, axis) if log.vehicle.firmware == "PX4" else read_copter(log, axis)


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
        px4.check_version(log)
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


def read_copter(log: FlightLog, axis: str) -> LoopSettings:
    """Read an axis' loop from the parameters of a log of ArduCopter."""
    firmware_version(log)
    parameters = parameters_of(log, axis)
    letters = AXES[axis]
    wanted = [f"ATC_RAT_{letters}_{name}" for name in NEEDED]
    wanted += [f"ATC_ANG_{letters}_P", "INS_GYRO_FILTER", "SCHED_LOOP_RATE"]
    missing = [name for name in wanted if name not in parameters]
    if missing:
        raise LoopError(
            f"{log.path.name} lacks {', '.join(missing[:4])}{' ...' if len(missing) > 4 else ''}: without the "
            "parameters the loop is unknown; keep LOG_DISARMED or the start of the log, where they are written"
        )
    if not parameters["SCHED_LOOP_RATE"] > 0.0:
        raise LoopError(f"{log.path.name}: SCHED_LOOP_RATE = {parameters['SCHED_LOOP_RATE']:g} is no rate of a loop")
    if parameters.get("FSTRATE_ENABLE", 0.0) > 0.0:
        raise LoopError(f"{log.path.name}: the rate loop runs in its own thread (FSTRATE_ENABLE), at an unknown rate")
    odd = [f"ATC_RAT_{letters}_{n}" for n in ("NTF", "NEF") if parameters.get(f"ATC_RAT_{letters}_{n}", 0.0) > 0.0]
    if odd:
        raise LoopError(f"{log.path.name}: notches within the controller ({', '.join(odd)}) are not modelled")
    terms = {name: parameters.get(f"ATC_RAT_{letters}_{name}", 0.0) for name in (*NEEDED, *OPTIONAL)}
    gyro, remarks = _gyro_path(log, axis, parameters)
    angle = AngleController(
        P=parameters[f"ATC_ANG_{letters}_P"],
        late=1.0 / parameters["SCHED_LOOP_RATE"],
    )
    return LoopSettings(
        axis=axis,
        controller=RateController(**terms, loop_rate=parameters["SCHED_LOOP_RATE"]),
        angle=angle,
        gyro=gyro,
        remarks=remarks,
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
    for prefix in ("INS_HNTCH_", "INS_HNTC2_", "INS_HNTC3_"):
        if parameters.get(f"{prefix}ENABLE", 0.0) <= 0.0:
            continue
        values = {name: parameters.get(prefix + name) for name in ("FREQ", "BW", "ATT", "HMNCS")}
        lacking = [prefix + name for name, value in values.items() if value is None]
        if lacking:
            raise LoopError(f"{log.path.name} lacks {', '.join(lacking)} of a notch that is enabled")
        known = {name: float(value) for name, value in values.items() if value is not None}
        none = [f"{prefix}{name} = {known[name]:g}" for name in ("FREQ", "BW", "ATT") if not known[name] > 0.0]
        if none:
            raise LoopError(f"{log.path.name}: {', '.join(none)} of a notch that is enabled is no value of one")
        base, remark = _notch_base(log, axis, parameters, prefix, known["FREQ"])
        options = int(parameters.get(f"{prefix}OPTS", 0.0))
        notches += harmonic_notches(
            rate,
            base,
            nominal=known["FREQ"],
            bandwidth=known["BW"],
            attenuation_db=known["ATT"],
            harmonics=int(known["HMNCS"]),
            composite=2 if options & 1 else 3 if options & 16 else 1,
        )
        remarks.append(remark)
    return GyroPath(parameters["INS_GYRO_FILTER"], rate, tuple(notches)), tuple(remarks)


def _notch_base(
    log: FlightLog, axis: str, parameters: Mapping[str, float], prefix: str, nominal: float
) -> tuple[float, str]:
    """Return the frequency of the first harmonic, Hz: as tracked (FTN, FTN1), else from the throttle flown."""
    mode = int(parameters.get(f"{prefix}MODE", 0.0))
    reference = parameters.get(f"{prefix}REF", 0.0)
    name = prefix.rstrip("_")
    if mode == _FIXED or reference <= 0.0:
        return nominal, f"{name} fixed at {nominal:.0f} Hz"
    if prefix == "INS_HNTCH_":
        for message in ("FTN", "FTN1"):
            if message in log.messages and "NF1" in log.messages[message]:
                tracked = log.messages[message]["NF1"].to_numpy(np.float64)
                tracked = tracked[np.isfinite(tracked) & (tracked > 0.0)]
                if len(tracked):
                    return float(np.median(tracked)), f"{name} tracked, median {np.median(tracked):.0f} Hz"
    throttle = _throttle(log, axis) or parameters.get("MOT_THST_HOVER")
    if mode == _THROTTLE and throttle:
        floor = parameters.get(f"{prefix}FM_RAT", 1.0)
        base = nominal * max(floor, math.sqrt(throttle / reference))
        return base, f"{name} follows throttle, {base:.0f} Hz at the {throttle:.2f} flown"
    return nominal, f"{name} tracks a frequency that is not logged; taken at its lowest, {nominal:.0f} Hz"


def _throttle(log: FlightLog, axis: str) -> float | None:
    """Return the median throttle of the chirps at the mixer on an axis, without one of the flight, 0..1."""
    throttle, flight = log.tables.column("setpoints", "throttle"), log.flight
    if throttle is None or flight is None:
        return None
    spans = [(chirp.start, chirp.stop) for chirp in mixer_chirps(log, axis)] or [(flight.start, flight.stop)]
    found = pd.concat([throttle.loc[start:stop] for start, stop in spans]).dropna()
    return float(found.median()) if len(found) else None
