"""Which column of a table is what: the small YAML that a user writes, as a typed value.

The page docs/tables.md explains it with examples.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import yaml

from logparse.craft.frames import FRAME_CLASSES, FRAME_TYPES, Motor, motor_table
from logparse.foreign.files import TableError

Floats = npt.NDArray[np.float64]

#: Rotations from the declared frames to NED and FRD.
WORLD_TO_NED: Mapping[str, Floats] = {
    "NED": np.eye(3),
    "ENU": np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]),
    "NWU": np.diag([1.0, -1.0, -1.0]),
}
FRD_TO_BODY: Mapping[str, Floats] = {"FRD": np.eye(3), "FLU": np.diag([1.0, -1.0, -1.0])}

#: Factors to SI.
TIME_UNITS: Mapping[str, float] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0, "d": 86400.0}
LENGTH_UNITS: Mapping[str, float] = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "ft": 0.3048}
SPEED_UNITS: Mapping[str, float] = {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "km/h": 1 / 3.6}
ANGLE_UNITS: Mapping[str, float] = {"rad": 1.0, "deg": math.pi / 180}
RATE_UNITS: Mapping[str, float] = {"rad/s": 1.0, "deg/s": math.pi / 180}

#: What motor columns may hold.
QUANTITIES = ("pwm", "command", "rad/s", "rpm", "erpm")

_KEYS = {
    "name", "time", "rate", "frame", "position", "velocity", "attitude", "rates", "motors", "inputs", "voltage", "mass",
    "arm", "indoors", "fill",
}  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class ColumnSignal:
    """Columns of one vector and how to read them."""

    columns: tuple[str, ...]
    factor: float = 1.0  #: To SI.
    body: bool = False  #: In body axes rather than the world's.


@dataclass(frozen=True, slots=True, kw_only=True)
class AttitudeSignal:
    """Columns of the attitude."""

    columns: tuple[str, ...]  #: Four of a quaternion, or roll, pitch, yaw.
    scalar_first: bool = False
    world_to_body: bool = False  #: The quaternion turns from the world to the body; else from the body to the world.
    factor: float = 1.0  #: Of angles, to rad.

    @property
    def quaternion(self) -> bool:
        """Whether the attitude is a quaternion."""
        return len(self.columns) == 4


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorSignal:
    """Columns of the motors."""

    columns: tuple[str, ...]  #: In the order of `motors`.
    quantity: str  #: One of `QUANTITIES`.
    factor: float  #: To rad/s for rotor speeds, us for PWM, 0..1 for commands.
    motors: tuple[Motor, ...]  #: Where each sits.
    pwm: tuple[float, float] = (1000.0, 2000.0)  #: Idle and full, us; for PWM.
    frame: tuple[str, str] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ColumnMap:
    """All that a user says of a table."""

    time: ColumnSignal | None  #: None when the rate is given instead.
    rate: float | None  #: Samples per second.
    #: Frames.
    world: str
    body: str
    position: ColumnSignal
    velocity: ColumnSignal | None
    attitude: AttitudeSignal
    rates: ColumnSignal | None
    motors: MotorSignal
    inputs: Mapping[str, ColumnSignal]  #: Further inputs, by the name that they get.
    voltage: ColumnSignal | None
    #: kg, m.
    mass: float | None
    arm: float | None
    indoors: bool  #: No wind.
    name: str | None
    fill: bool  #: Fill gaps of any length from the samples before and after them.

    @property
    def names(self) -> tuple[str, ...]:
        """Every column that is read."""
        signals = [self.time, self.position, self.velocity, self.rates, self.voltage, *self.inputs.values()]
        out = [name for signal in signals if signal is not None for name in signal.columns]
        return (*out, *self.attitude.columns, *self.motors.columns)


class _Plain(yaml.SafeLoader):
    """YAML without aliases: a few lines of them write out to a billion words."""

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Refuse an alias; read anything else."""
        if self.check_event(yaml.AliasEvent):
            raise yaml.YAMLError("aliases (*name) are not read; write what they stand for")
        return super().compose_node(parent, index)


def read_column_map(source: Mapping[str, Any] | str | Path) -> ColumnMap:
    """Read the description of a table."""
    if not isinstance(source, Mapping):
        path = Path(source)
        try:
            content = yaml.load(path.read_text("utf-8"), _Plain)
        except FileNotFoundError:
            raise TableError(f"{path}: no such file") from None
        except Exception as error:  # tags and nesting end in whatever the constructors of YAML happen to raise
            raise TableError(f"{path.name}: not readable as YAML: {error}") from error
        if not isinstance(content, Mapping):
            raise TableError(f"{path.name}: a mapping of what each column is, is expected (docs/tables.md)")
        source = content
    return _column_map({str(key): value for key, value in source.items()})


def _column_map(raw: Mapping[str, Any]) -> ColumnMap:
    unknown = sorted(set(raw) - _KEYS)
    if unknown:
        near = difflib.get_close_matches(unknown[0], sorted(_KEYS), 1)
        hint = f"; do you mean {near[0]}?" if near else f"; keys are {', '.join(sorted(_KEYS))}"
        raise TableError(f"columns: unknown key {unknown[0]}{hint}")
    for key in ("position", "attitude", "motors"):
        if key not in raw:
            raise TableError(f"columns: {key} is missing; a model of the motion needs position, attitude and motors")
    frame = _mapping("frame", raw.get("frame", {}))
    world = _choice("frame: world", str(frame.get("world", "NED")).upper(), tuple(WORLD_TO_NED))
    body = _choice(
        "frame: body", str(frame.get("body", "FRD" if world == "NED" else "FLU")).upper(), tuple(FRD_TO_BODY)
    )
    rate = raw.get("rate")
    if rate is None and "time" not in raw:
        raise TableError("columns: time is missing; name its column, or give the rate in samples per second")
    return ColumnMap(
        time=_signal("time", raw["time"], TIME_UNITS, 1) if "time" in raw else None,
        rate=None if rate is None else _positive("rate", rate),
        world=world,
        body=body,
        position=_signal("position", raw["position"], LENGTH_UNITS, 3),
        velocity=_signal("velocity", raw["velocity"], SPEED_UNITS, 3) if "velocity" in raw else None,
        attitude=_attitude(raw["attitude"]),
        rates=_signal("rates", raw["rates"], RATE_UNITS, 3) if "rates" in raw else None,
        motors=_motors(raw["motors"], body),
        inputs={
            str(name): _signal(f"inputs: {name}", value, None, 1)
            for name, value in _mapping("inputs", raw.get("inputs", {})).items()
        },
        voltage=_signal("voltage", raw["voltage"], {"V": 1.0, "mV": 1e-3}, 1) if "voltage" in raw else None,
        mass=None if raw.get("mass") is None else _positive("mass", raw["mass"]),
        arm=None if raw.get("arm") is None else _positive("arm", raw["arm"]),
        indoors=bool(raw.get("indoors", False)),
        name=None if raw.get("name") is None else str(raw["name"]),
        fill=bool(raw.get("fill", False)),
    )


def _mapping(key: str, value: Any) -> dict[str, Any]:
    if not isinstance(value, Mapping):
        raise TableError(f"columns: {key} must be a mapping, not {value!r}")
    return {str(name): each for name, each in value.items()}


def _choice(key: str, value: str, known: Sequence[str]) -> str:
    if value not in known:
        raise TableError(f"columns: {key} must be one of {', '.join(known)}, not {value}")
    return value


def _positive(key: str, value: Any) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        raise TableError(f"columns: {key} must be a number, not {value!r}") from None
    if not (math.isfinite(number) and number > 0.0):
        raise TableError(f"columns: {key} must be a positive number, not {value!r}")
    return number


def _names(key: str, value: Any, count: int | None) -> tuple[str, ...]:
    """Column names: a list, or one name that stands for a vector."""
    if isinstance(value, str):
        return (value,) if count == 1 else tuple(f"{value}[{k}]" for k in range(count or 0))
    if not isinstance(value, Sequence) or not all(isinstance(each, str | int) for each in value):
        raise TableError(f"columns: {key} must name its columns, not {value!r}")
    names = tuple(str(each) for each in value)
    if count is not None and len(names) != count:
        raise TableError(f"columns: {key} takes {count} columns, not {len(names)} ({', '.join(names)})")
    if len(set(names)) < len(names):
        raise TableError(f"columns: {key} names a column twice ({', '.join(names)})")
    return names


def _signal(key: str, value: Any, units: Mapping[str, float] | None, count: int) -> ColumnSignal:
    if not isinstance(value, Mapping):
        return ColumnSignal(columns=_names(key, value, count))
    given = _mapping(key, value)
    unit = str(given.get("unit", next(iter(units)) if units else "1"))
    if units is not None and unit not in units:
        raise TableError(f"columns: the unit of {key} must be one of {', '.join(units)}, not {unit}")
    axes = _choice(f"{key}: axes", str(given.get("axes", "world")), ("world", "body"))
    names = given.get("columns", given.get("column"))
    return ColumnSignal(columns=_names(key, names, count), factor=units[unit] if units else 1.0, body=axes == "body")


def _attitude(value: Any) -> AttitudeSignal:
    if not isinstance(value, Mapping):
        names = _names("attitude", value, 4 if isinstance(value, str) else None)
        given: dict[str, Any] = {}
    else:
        given = _mapping("attitude", value)
        angles = given.get("kind", "quaternion") == "angles" or "unit" in given
        columns = given.get("columns")
        names = _names("attitude", columns, (3 if angles else 4) if isinstance(columns, str) else None)
    if len(names) not in (3, 4):
        raise TableError(f"columns: attitude takes four columns of a quaternion, or roll, pitch, yaw; not {len(names)}")
    order = _choice("attitude: order", str(given.get("order", "wxyz")), ("wxyz", "xyzw"))
    direction = _choice(
        "attitude: direction", str(given.get("direction", "body-to-world")), ("body-to-world", "world-to-body")
    )
    unit = str(given.get("unit", "rad"))
    if unit not in ANGLE_UNITS:
        raise TableError(f"columns: the unit of attitude must be one of {', '.join(ANGLE_UNITS)}, not {unit}")
    return AttitudeSignal(
        columns=names,
        scalar_first=order == "wxyz",
        world_to_body=direction == "world-to-body",
        factor=ANGLE_UNITS[unit],
    )


def _motors(value: Any, body: str) -> MotorSignal:
    given = _mapping("motors", value)
    quantity = _choice("motors: quantity", str(given.get("quantity", "")), QUANTITIES)
    frame = given.get("frame")
    places = given.get("places")
    columns = given.get("columns")
    count = len(places) if isinstance(places, Sequence) else None
    named: tuple[str, str] | None = None
    if frame is not None:
        named = _named_frame(str(frame))
        motors = motor_table(*named)
        count = len(motors)
    elif places is not None:
        motors = tuple(_place(k, each, body) for k, each in enumerate(places))
    else:
        raise TableError("columns: motors need a frame (such as quad/x) or their places [forward, left or right, spin]")
    names = _names("motors", columns, count)
    factor = 1.0
    if quantity == "rpm":
        factor = 2.0 * math.pi / 60.0
    elif quantity == "erpm":
        if "poles" not in given:
            raise TableError("columns: electrical rpm needs the number of poles of the motors (motors: poles)")
        factor = 2.0 * math.pi / 60.0 / (_positive("motors: poles", given["poles"]) / 2.0)
    elif quantity == "command":
        factor = 1.0 / _positive("motors: full", given.get("full", 1.0))
    return MotorSignal(
        columns=names,
        quantity=quantity,
        factor=factor,
        motors=motors,
        pwm=_widths(given.get("pwm", (1000.0, 2000.0))),
        frame=named,
    )


def _widths(pwm: Any) -> tuple[float, float]:
    """Return the pulse widths of idle and full, us."""
    try:
        idle, full = map(float, pwm)
    except (TypeError, ValueError, OverflowError):
        idle = full = math.nan
    if not -math.inf < idle < full < math.inf:
        raise TableError(f"columns: motors: pwm takes the widths of idle and full in us, not {pwm!r}")
    return idle, full


def _named_frame(text: str) -> tuple[str, str]:
    kind, _, layout = text.partition("/")
    if kind not in FRAME_CLASSES.values() or layout not in {*FRAME_TYPES.values(), "two-layer", ""}:
        raise TableError(
            f"columns: motors: frame {text} is not known; write CLASS/TYPE such as quad/x, or give the places"
        )
    if not motor_table(kind, layout):
        raise TableError(f"columns: motors: the places of frame {text} are not known; give the places")
    return kind, layout


def _place(at: int, value: Any, body: str) -> Motor:
    """Motor from forward, sideways (left in FLU, right in FRD) and spin."""
    try:
        forward, aside, spin = float(value[0]), float(value[1]), str(value[2]).lower()
    except (TypeError, ValueError, OverflowError, IndexError, KeyError):
        raise TableError(
            f"columns: motors: place {at + 1} must be [forward, {'left' if body == 'FLU' else 'right'}, cw or ccw], "
            f"not {value!r}"
        ) from None
    turns = {"cw": 1, "ccw": -1, "1": 1, "-1": -1, "0": 0, "none": 0}
    if spin not in turns:
        raise TableError(f"columns: motors: the spin of place {at + 1} must be cw or ccw seen from above, not {spin}")
    right = -aside if body == "FLU" else aside
    return Motor(
        number=at + 1,
        channel=None,
        angle=math.atan2(right, forward),
        spin=turns[spin],
        layer=0,
        roll=-right,
        pitch=forward,
        yaw=float(-turns[spin]),
    )
