"""The axes of a multirotor: what drives each, what answers, and which SID_AXIS excites it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from core.summary import listed
from logparse import RotoridError


class FrequencyError(RotoridError):
    """A frequency response, or a fit to one, that the data cannot give; the message says why and what to fly or log."""


def log_by_log(reasons: Iterable[str]) -> str:
    """Join reasons of the form "LOG: why"; logs, and power-ups of one, that share a reason stand together."""
    logs: dict[str, list[str]] = {}
    for reason in dict.fromkeys(reasons):
        name, colon, why = reason.partition(": ")
        logs.setdefault(why if colon else name, []).extend([name] if colon else [])
    return "; ".join(f"{listed(names)}: {why}" if names else why for why, names in logs.items())


@dataclass(frozen=True, slots=True)
class Axis:
    """One axis of control."""

    name: str
    #: Columns of the table `rates`; the vertical acceleration is that of RATE.A.
    input: str
    output: str
    unit: str  #: Of output per input.
    reference: str  #: Column of the target of the output.
    attitude: str  #: Column of the table `attitude` whose derivative the output is; empty for the vertical axis.
    letter: str  #: Of the axis in RATE and PID messages.
    #: Standard deviation of ln |G| between trims: the drag of rotors, which turns a craft in yaw, goes with more than
    #: the thrust asked of them. Yaw gains of firmware craft are 7 % larger in the climb of SYSTEMID mode than in hover.
    between_trims: float = 0.0


AXES: Mapping[str, Axis] = MappingProxyType(
    {
        "roll": Axis("roll", "out_roll", "w_x", "rad/s", "w_x_ref", "roll", "R"),
        "pitch": Axis("pitch", "out_pitch", "w_y", "rad/s", "w_y_ref", "pitch", "P"),
        "yaw": Axis("yaw", "out_yaw", "w_z", "rad/s", "w_z_ref", "yaw", "Y", 0.04),
        "vertical": Axis("vertical", "out_thrust", "a_up", "m/s^2", "a_up_ref", "", "A"),
    }
)

#: Names of the instruments of the vertical axis in ordinary flights.
PILOTS_THROTTLE, HEIGHT_TARGET = "pilot's throttle", "height target"

#: Which axis of the craft each SID_AXIS turns or lifts, and whether its chirp is added after the controller.
SID_AXES: Mapping[int, tuple[str, bool]] = MappingProxyType(
    {k: (name, False) for first in (1, 4, 7) for k, name in enumerate(("roll", "pitch", "yaw"), first)}
    | {10: ("roll", True), 11: ("pitch", True), 12: ("yaw", True), 13: ("vertical", True)}
    | {k: (("roll", "pitch")[k % 2], False) for k in range(14, 20)}
)

#: SID_AXIS of a chirp that is added after the controller, by axis.
MIXER_CHIRPS: Mapping[str, int] = MappingProxyType({name: k for k, (name, mixer) in SID_AXES.items() if mixer})


def axis_of(name: str) -> Axis:
    """Return an axis by its name."""
    if name not in AXES:
        raise FrequencyError(f"there is no axis {name!r}; the axes are {', '.join(AXES)}")
    return AXES[name]
