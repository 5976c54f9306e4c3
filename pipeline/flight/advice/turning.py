"""What to fly and log so that the answer of the axes, and the margins of their loops, are known."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import TYPE_CHECKING

from core.quantity import joined
from logparse.craft.log_settings import TELEMETRY, Need, bits_of
from pipeline.results.advice import Advice
from pipeline.results.failure import Failure
from sysid.frequency.axes import SID_AXES

if TYPE_CHECKING:
    from pipeline.results.flight import FlightResult
    from pipeline.results.rotation import AxisRotation

#: Advice that asks for the same movement already.
_ALIKE = "excite-axes"


def turning(result: FlightResult, given: Collection[str]) -> Iterator[Advice]:
    """Advise on two minutes of flying for what a flight does not tell of its axes."""
    if isinstance(result.rotation, Failure):
        return
    unknown = [axis for axis in result.rotation.axes if not axis.rate_determined]
    if unknown and _ALIKE not in given:
        names = joined([axis.axis for axis in unknown])
        yield Advice(
            id="fly-sticks",
            rank=25,
            do=f"Fly two minutes of short stick inputs on {names}, from slow to as quick as you can, in STABILIZE or "
            f"LOITER in calm air{_logged(result, Need.FAST_RATES)}",
            why=f"how {names} answer{'s' if len(unknown) == 1 else ''} the controller is not determined",
            gain="effectiveness, damping and delay of the axis with their errors, no GPS needed",
        )
    loopless = [axis for axis in result.rotation.axes if axis.loop is None or axis.loop.ordinary]
    if loopless and _has_systemid(result):
        yield Advice(
            id="chirps-for-margins",
            rank=26,
            do="Fly mode SYSTEMID for two minutes with a chirp at the mixer on one axis after the other "
            f"(SID_AXIS {_chirps(loopless)}; rotorid design --for rates writes the parameters)"
            + _logged(result, Need.FAST_RATES, Need.PID),
            why=f"margins of the {joined([axis.axis for axis in loopless])} loop{'s' if len(loopless) > 1 else ''} "
            "are not measured: ordinary flying shows them through the craft's model at most",
            gain="gain and phase margins with errors, from which rotorid tune proposes gains",
        )


def _chirps(axes: list[AxisRotation]) -> str:
    at_mixer = {name: number for number, (name, mixer) in SID_AXES.items() if mixer}
    return joined([f"{at_mixer[axis.axis]} for {axis.axis}" for axis in axes])


def _logged(result: FlightResult, *needs: Need) -> str:
    """Name the bits of LOG_BITMASK that the flight must be logged with; empty for telemetry and unknown firmware."""
    known = bits_of(result.log.vehicle)
    bits = [str(known[need]) for need in needs if need in known]
    if result.log.format in TELEMETRY or not bits:
        return ""
    parameter = "SDLOG_PROFILE" if result.log.vehicle.autopilot == "PX4" else "LOG_BITMASK"
    return f", with {joined(list(dict.fromkeys(bits)))} of {parameter} set"


def _has_systemid(result: FlightResult) -> bool:
    """Return whether the firmware has mode SYSTEMID: ArduCopter since 4.0; unknown versions count as recent."""
    vehicle = result.log.vehicle
    major = (vehicle.version or "4").partition(".")[0]
    return vehicle.firmware == "ArduCopter" and (not major.isdecimal() or int(major) >= 4)
