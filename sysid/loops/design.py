"""`design`: the next flight as files that an autopilot takes, with the errors that it will leave and its limits."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from logparse import FlightLog, RotoridError
from logparse.craft.log_settings import Need, log_setting
from logparse.craft.quadplane import own_names
from sysid.frequency.axes import MIXER_CHIRPS
from sysid.frequency.fit import fit
from sysid.loops.as_flown import contradiction_of
from sysid.loops.chirps import (
    FADE_OUT,
    RELATIVE,
    ChirpDesign,
    Expected,
    Limits,
    design_chirp,
    first_chirp,
    predicted_errors,
)
from sysid.loops.controller import AXES, LoopError
from sysid.loops.loop import RateLoop, rate_loop
from sysid.loops.lua import Multisine, multisine_script, orthogonal_multisines
from sysid.loops.missions import (
    drag_errors,
    drag_legs,
    position_legs,
    thrust_errors,
    thrust_legs,
    waypoints,
)
from sysid.loops.parameter_file import parameter_file
from sysid.loops.plant import FIRST_MODES
from sysid.loops.settings import firmware_version, read_copter

#: What a flight can be designed for.
PURPOSES = ("rates", "drag", "inertia", "thrust", "position")

#: How a chirp is started and ended: by a copter, and by a QuadPlane.
_CHIRPS = (
    (
        "hover, switch to SYSTEMID, sticks still",
        "SYSTEMID ends itself beyond 30 deg of lean; switch back to ALT_HOLD or LOITER at any time",
    ),
    (
        "hover in QHOVER, start by the switch of RCn_OPTION 184 (System ID), sticks still; ArduPlane 4.6 or later",
        "no lean ends it: put the switch back at any time, and leave room for QLOITER",
    ),
)


@dataclass(frozen=True, slots=True, eq=False)
class Design:
    """Files of the next flight."""

    purpose: str
    files: dict[str, str]  #: Text by file name; empty where refused.
    expected: tuple[Expected, ...]
    limits: Limits
    chirps: tuple[ChirpDesign, ...]
    refused: str | None


def design(log: FlightLog, purpose: str, limits: Limits | None = None) -> Design:
    """Design the next flight of a craft from a log.

    Parameters
    ----------
    log : FlightLog
        Of the craft; for inertia with chirps at the mixer, however small.
    purpose : {"rates", "drag", "inertia", "thrust", "position"}
    limits : Limits, optional

    Raises
    ------
    LoopError
        For an unknown purpose.
    """
    limits = limits or Limits()
    if purpose not in PURPOSES:
        raise LoopError(f"there is no purpose {purpose!r}; a flight can be designed for {', '.join(PURPOSES)}")
    try:
        if purpose in ("rates", "inertia"):
            firmware_version(log)  # no other has mode SYSTEMID and these bindings
        if purpose == "rates":
            return _rates(log, limits)
        if purpose == "inertia":
            return _inertia(log, limits)
        return _mission(log, purpose, limits)
    except RotoridError as error:
        return Design(purpose, {}, (), limits, (), own_names(str(error), log.vehicle.firmware))


def _rates(log: FlightLog, limits: Limits) -> Design:
    _check_flown(log)
    files: dict[str, str] = {}
    expected: list[Expected] = []
    chirps: list[ChirpDesign] = []
    reasons = []
    for axis in AXES:
        try:
            chirp = _chirp(log, axis, limits)
        except RotoridError as error:
            reasons.append(str(error))
            continue
        chirps.append(chirp)
        expected += _of_chirp(chirp)
        files[f"rates_{axis}.param"] = _chirp_file(log, chirp, limits)
    if not files:
        raise LoopError("; ".join(dict.fromkeys(reasons)))
    return Design("rates", files, tuple(expected), limits, tuple(chirps), None)


def _chirp(log: FlightLog, axis: str, limits: Limits) -> ChirpDesign:
    """Design from the craft's response, or, before its first chirp, from the gains alone."""
    try:
        return design_chirp(rate_loop(log, axis), limits)
    except RotoridError:
        return first_chirp(read_copter(log, axis), limits)


def _check_flown(log: FlightLog) -> None:
    """Raise where the parameters are not those that flew: what a chirp leans the craft by goes with them."""
    contradicted = next((reason for axis in AXES if (reason := contradiction_of(log, axis))), None)
    if contradicted is not None:
        raise LoopError(contradicted)


def _of_chirp(chirp: ChirpDesign) -> list[Expected]:
    """Return the predicted errors of the parameters that the chirp will determine, named with its axis."""
    return [replace(error, name=f"{chirp.axis} {error.name.replace('_', ' ')}") for error in chirp.errors]


def _predicted(chirp: ChirpDesign) -> list[str]:
    if not chirp.errors:
        return ["a first, careful chirp from the gains alone: its errors are known once it is flown"]
    return [f"predicted standard deviation of {item}" for item in _of_chirp(chirp)]


def _chirp_file(log: FlightLog, chirp: ChirpDesign, limits: Limits) -> str:
    values = {
        "SID_AXIS": float(MIXER_CHIRPS[chirp.axis]),
        "SID_MAGNITUDE": chirp.magnitude,
        "SID_F_START_HZ": chirp.low,
        "SID_F_STOP_HZ": chirp.high,
        "SID_T_FADE_IN": chirp.fade_in,
        "SID_T_REC": chirp.seconds,
        "SID_T_FADE_OUT": FADE_OUT,
    }
    # What is logged stays logged; where the mask is not known, its value cannot be.
    setting = log_setting(log.vehicle, log.format, log.parameters, (Need.FAST_RATES, Need.PID))
    if setting is not None and setting.wanted is not None:
        values[setting.parameter] = float(setting.wanted)
    both = "rotorid tune takes this log together with that of a chirp up to 40 Hz, which looks for modes of the frame"
    start, end = _CHIRPS[log.vehicle.firmware == "ArduPlane"]
    comments = (
        f"rotorid design --for rates: {chirp.axis} of the craft of {log.path.name}",
        *_predicted(chirp),
        f"expected at most: lean {chirp.lean_deg:.1f} deg (limit {limits.lean_deg:.0f}), rate "
        f"{chirp.rate_deg:.0f} deg/s (limit {limits.rate_deg:.0f}), mixer {chirp.mixer:.2f} (limit {limits.mixer:.2f})",
        f"fly in calm air, {limits.height_m:.0f} m or more above ground; {start}",
        end,
        "load these before the flight, one axis a run; put SID_AXIS back to 0 afterwards",
        *((setting.sentence(),) if setting is not None and setting.wanted is None else ()),
        *(() if chirp.high >= FIRST_MODES else (both,)),
    )
    return parameter_file(values, comments)


def _inertia(log: FlightLog, limits: Limits) -> Design:
    if log.vehicle.firmware == "ArduPlane":
        raise LoopError(
            f"{log.path.name} is of a QuadPlane, whose scripts cannot ask the motors that lift for rates; fly the "
            "chirps of --for rates, which tell its inertia as well"
        )
    _check_flown(log)
    loops = {axis: rate_loop(log, axis) for axis in ("roll", "pitch")}
    # Scripts run at 25 to 90 Hz, with gaps up to 0.24 s.
    sines = orthogonal_multisines(3, 0.3, 4.5, 20.0)
    scales = [_rate_scale(sine, limits) for sine in sines]
    expected = []
    for (axis, loop), sine, scale in zip(loops.items(), sines, scales, strict=False):
        error = _multisine_error(loop, sine, scale)
        expected.append(replace(error, name=f"{axis} gain (torque per inertia)"))
    hover = log.parameters.get("MOT_THST_HOVER")
    if hover is None:
        raise LoopError(f"{log.path.name} has no MOT_THST_HOVER: the script cannot hold the height")
    script = multisine_script(sines, scales, hover, limits, [(e.name, e.sigma) for e in expected])
    return Design("inertia", {"inertia.lua": script}, tuple(expected), limits, (), None)


def _rate_scale(sine: Multisine, limits: Limits) -> float:
    """Return the peak rate [rad/s] at which neither lean nor rate reach half of their limits."""
    t = np.arange(4000) / 4000.0 * sine.period
    lean = -np.cos(2.0 * np.pi * np.outer(t, sine.hz) + sine.phase) @ (sine.amplitude / (2.0 * np.pi * sine.hz))
    lean -= lean[0]
    return float(0.5 * min(np.radians(limits.lean_deg) / np.max(np.abs(lean)), np.radians(limits.rate_deg)))


def _multisine_error(loop: RateLoop, sine: Multisine, scale: float) -> Expected:
    """Predict the error of the gain from one period, through the rate loop from its target."""
    hz = loop.frf.hz
    controller = loop.flown.controller
    drive = np.abs(controller.target_response(sine.hz)) * sine.amplitude * scale
    # Each line's energy, spread over the distance to the next.
    density = drive**2 * sine.period / (4.0 * float(np.median(np.diff(sine.hz))))
    energy = np.where((hz >= sine.hz[0]) & (hz <= sine.hz[-1]), np.interp(hz, sine.hz, density), 0.0)
    error = next(iter(predicted_errors(loop, fit(loop.frf), energy)), None)
    if error is None:
        raise LoopError(
            f"{loop.axis}: the flown chirps tell nothing below {sine.hz[-1]:.1f} Hz, where a script can play"
        )
    return error


def _mission(log: FlightLog, purpose: str, limits: Limits) -> Design:
    origin, gps = log.tables.origin, log.tables.gps
    fixes = None if gps is None else gps.dropna(subset=["lat", "lon"])
    if fixes is not None and len(fixes):
        lat, lon, alt = (float(fixes[name].iloc[0]) for name in ("lat", "lon", "alt"))
    elif origin is not None:
        lat, lon, alt = origin.lat, origin.lon, origin.alt
    else:
        raise LoopError(f"{log.path.name} has no position: a mission needs the place where it is flown")
    home = (float(np.degrees(lat)), float(np.degrees(lon)), alt)
    vtol = log.vehicle.firmware == "ArduPlane"
    legs = {"drag": drag_legs, "thrust": thrust_legs, "position": position_legs}[purpose](limits.height_m)
    errors = drag_errors(legs) if purpose == "drag" else thrust_errors(legs)
    units = {"drag_linear": "1/s", "drag_quadratic": "1/m", "wind": "m/s"}
    expected = tuple(Expected(name, sigma, units.get(name, RELATIVE)) for name, sigma in errors.items())
    reach = max(float(np.hypot(leg.north, leg.east)) for leg in legs)
    lines = [
        f"Mission for {purpose}, made from {log.path.name}.",
        f"It reaches {reach:.0f} m from home and {max(leg.height for leg in legs):.0f} m above it, at up to "
        f"{max(leg.speed for leg in legs):.0f} m/s: look at the map first, and set a fence.",
        "Predicted standard deviations:",
        *(f"  {item.name} {item.sigma:.2g} {item.unit}" for item in expected),
        "Fly in mode AUTO, which stays on the motors that lift; switch to QLOITER or QRTL at any time."
        if vtol
        else "Fly in mode AUTO; switch to LOITER or RTL at any time.",
    ]
    files = {f"{purpose}.waypoints": waypoints(home, legs, vtol), f"{purpose}.txt": "\n".join(lines) + "\n"}
    return Design(purpose, files, expected, limits, (), None)
