"""Arithmetic with signals of a log and their units: ``ATT.Roll - ATT.DesRoll``, ``deg(IMU[0].GyrX)``."""

import ast
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from logparse.signals import LoggedSignal, SignalError, logged_signal

if TYPE_CHECKING:
    from logparse.log import FlightLog

Array = npt.NDArray[np.float64]
Unit = Mapping[str, Fraction]

#: Longest expression, characters, and most operations in it.
_LONGEST, _MOST = 300, 60
#: Largest exponent: a double knows no number above 1 to a higher power.
_LARGEST_POWER = 1000
_PART = re.compile(r"([*/·]?)\s*([^\s*/·^²³]+)(?:\^(-?\d+)|([²³]))?")
_SUPERSCRIPTS = {"²": 2, "³": 3}
_SIGNS = {Fraction(2): "²", Fraction(3): "³", Fraction(1): ""}


@dataclass(frozen=True, slots=True, eq=False)
class _Value:
    """A number, or a signal over time."""

    y: Array
    unit: Unit
    t: Array | None = None  #: None for a number.


def evaluate(log: "FlightLog", text: str) -> LoggedSignal:
    """Evaluate an expression of signals.

    Signals of different times are interpolated to those of the one with most samples.
    """
    text = text.strip()
    if len(text) > _LONGEST:
        raise SignalError(f"the expression is longer than {_LONGEST} characters")
    try:
        tree = ast.parse(text, mode="eval")
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise SignalError(f"{text!r} cannot be read; write, for one, ATT.Roll - ATT.DesRoll") from None
    nodes = list(ast.walk(tree))
    if len(nodes) > 4 * _MOST:
        raise SignalError(f"the expression has more than {_MOST} operations")
    if _name(tree.body) is not None:
        return logged_signal(log, text)
    try:
        with np.errstate(all="ignore"):
            value = _evaluate(log, tree.body)
    except (OverflowError, ValueError):  # of whole numbers without end: units have exact exponents
        raise SignalError(f"{text!r} holds a number that is too large") from None
    if value.t is None:
        raise SignalError(f"{text!r} holds no signal; write, for one, ATT.Roll - ATT.DesRoll")
    if not np.isfinite(value.y).any():
        raise SignalError(f"{text} holds no numbers")
    return LoggedSignal(text, _written(value.unit), value.t, value.y)


def _evaluate(log: "FlightLog", node: ast.expr) -> _Value:
    name = _name(node)
    if name is not None:
        signal = logged_signal(log, name)
        return _Value(signal.y, _parsed(signal.unit), signal.t)
    match node:
        case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
            return _Value(np.asarray(float(number)), {})
        case ast.UnaryOp(op=ast.USub(), operand=inner):
            value = _evaluate(log, inner)
            return _Value(-value.y, value.unit, value.t)
        case ast.UnaryOp(op=ast.UAdd(), operand=inner):
            return _evaluate(log, inner)
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATIONS:
            return _OPERATIONS[type(op)](*_together(_evaluate(log, left), _evaluate(log, right)))
        case ast.Call(func=ast.Name(id=function), args=[argument], keywords=[]) if function in _OF_ONE:
            return _OF_ONE[function](_evaluate(log, argument))
        case ast.Call(func=ast.Name(id=function), args=[first, second], keywords=[]) if function in _OF_TWO:
            return _OF_TWO[function](*_together(_evaluate(log, first), _evaluate(log, second)))
    known = ", ".join([*_OF_ONE, *_OF_TWO])
    raise SignalError(
        f"{ast.unparse(node)!r} is no signal or number; write ATT.Roll for a signal; functions are {known}"
    )


def _name(node: ast.expr) -> str | None:
    """Return the signal that a node names: ``ATT.Roll``, ``IMU[1].GyrX``."""
    match node:
        case ast.Attribute(value=ast.Name(id=message), attr=field):
            return f"{message}.{field}"
        case ast.Attribute(
            value=ast.Subscript(value=ast.Name(id=message), slice=ast.Constant(value=int() as instance)), attr=field
        ):
            return f"{message}[{instance}].{field}"
    return None


def _together(a: _Value, b: _Value) -> tuple[_Value, _Value]:
    """Interpolate two values to the times of the one with more samples."""
    if a.t is None or b.t is None or (len(a.t) == len(b.t) and np.array_equal(a.t, b.t)):
        return a, b
    if len(a.t) >= len(b.t):
        return a, _at(b, a.t)
    return _at(a, b.t), b


def _at(value: _Value, t: Array) -> _Value:
    if value.t is None:
        return value
    known = np.isfinite(value.y)
    y = (
        np.interp(t, value.t[known], value.y[known], left=np.nan, right=np.nan)
        if known.any()
        else np.full_like(t, np.nan)
    )
    return _Value(y, value.unit, t)


def _sum(sign: float) -> Callable[[_Value, _Value], _Value]:
    def added(a: _Value, b: _Value) -> _Value:
        return _Value(a.y + sign * b.y, _common(a, b), _times(a, b))

    return added


def _common(a: _Value, b: _Value) -> Unit:
    """Return the unit of two values that are added or compared; a plain number takes that of the other."""
    if a.t is None and not a.unit:
        return b.unit
    if b.t is None and not b.unit:
        return a.unit
    if a.unit != b.unit:
        units = " and ".join(_written(value.unit) or "no unit" for value in (a, b))
        raise SignalError(f"{units} cannot be added or compared; convert one, for angles with deg() or rad()")
    return a.unit


def _times(a: _Value, b: _Value) -> Array | None:
    return a.t if a.t is not None else b.t


def _product(power: int) -> Callable[[_Value, _Value], _Value]:
    def multiplied(a: _Value, b: _Value) -> _Value:
        return _Value(a.y * b.y**power, _combined(a.unit, b.unit, power), _times(a, b))

    return multiplied


def _power(a: _Value, b: _Value) -> _Value:
    if b.t is not None or b.unit:
        raise SignalError("an exponent must be a number")
    if not abs(b.y) <= _LARGEST_POWER:
        raise SignalError(f"an exponent must be between -{_LARGEST_POWER} and {_LARGEST_POWER}")
    exponent = Fraction(float(b.y)).limit_denominator(12)
    unit = {name: power * exponent for name, power in a.unit.items() if exponent}
    return _Value(np.asarray(a.y ** float(b.y)), unit, a.t)


def _combined(a: Unit, b: Unit, sign: int) -> Unit:
    powers = {name: a.get(name, Fraction(0)) + sign * b.get(name, Fraction(0)) for name in (*a, *b)}
    return {name: power for name, power in powers.items() if power}


def _trigonometric(function: Callable[[Array], Array]) -> Callable[[_Value], _Value]:
    def applied(a: _Value) -> _Value:
        factor = {"deg": np.pi / 180.0, "rad": 1.0, "": 1.0}.get(_written(a.unit))
        if factor is None:
            raise SignalError(f"{_written(a.unit)} is no angle")
        return _Value(np.asarray(function(factor * a.y)), {}, a.t)

    return applied


def _converted(old: str, new: str, factor: float) -> Callable[[_Value], _Value]:
    def applied(a: _Value) -> _Value:
        power = a.unit.get(old, Fraction(0))
        if power == 0 and a.unit and new not in a.unit:
            raise SignalError(f"{_written(a.unit)} holds no angle to convert")
        if new in a.unit:
            return a
        unit = {name: each for name, each in a.unit.items() if name != old} | {new: power or Fraction(1)}
        return _Value(a.y * factor ** float(power or 1), unit, a.t)

    return applied


def _rate(a: _Value) -> _Value:
    if a.t is None or len(a.t) < 2:
        raise SignalError("only a signal of two samples or more has a rate")
    return _Value(np.gradient(a.y, a.t), _combined(a.unit, {"s": Fraction(1)}, -1), a.t)


def _of_equal_units(function: Callable[[Array, Array], Array]) -> Callable[[_Value, _Value], _Value]:
    return lambda a, b: _Value(np.asarray(function(a.y, b.y)), _common(a, b), _times(a, b))


_OPERATIONS: Mapping[type[ast.operator], Callable[[_Value, _Value], _Value]] = {
    ast.Add: _sum(1.0),
    ast.Sub: _sum(-1.0),
    ast.Mult: _product(1),
    ast.Div: _product(-1),
    ast.Pow: _power,
}
_OF_ONE: Mapping[str, Callable[[_Value], _Value]] = {
    "abs": lambda a: _Value(np.abs(a.y), a.unit, a.t),
    "sqrt": lambda a: _Value(np.sqrt(a.y), {name: power / 2 for name, power in a.unit.items()}, a.t),
    "sin": _trigonometric(np.sin),
    "cos": _trigonometric(np.cos),
    "tan": _trigonometric(np.tan),
    "deg": _converted("rad", "deg", 180.0 / np.pi),
    "rad": _converted("deg", "rad", np.pi / 180.0),
    "rate": _rate,
}
_OF_TWO: Mapping[str, Callable[[_Value, _Value], _Value]] = {
    "hypot": _of_equal_units(np.hypot),
    "min": _of_equal_units(np.fmin),
    "max": _of_equal_units(np.fmax),
    "atan2": lambda a, b: _Value(
        np.arctan2(a.y, b.y), {"rad": Fraction(1)} if _common(a, b) is not None else {}, _times(a, b)
    ),
}


def _parsed(unit: str) -> Unit:
    """Read ``m/s/s``, ``m/s^2`` or ``rad/s``; what follows one slash is divided by, up to the next sign."""
    powers: dict[str, Fraction] = {}
    for sign, name, exponent, superscript in _PART.findall(unit):
        if name == "1":
            continue
        power = Fraction(int(exponent) if exponent else _SUPERSCRIPTS.get(superscript, 1))
        powers[name] = powers.get(name, Fraction(0)) + (-power if sign == "/" else power)
    return {name: power for name, power in powers.items() if power}


def _written(unit: Unit) -> str:
    """Write a unit: ``m/s²``."""

    def part(name: str, power: Fraction) -> str:
        return name + _SIGNS.get(power, f"^{power}")

    above = "·".join(part(name, power) for name, power in unit.items() if power > 0)
    below = "".join(f"/{part(name, -power)}" for name, power in unit.items() if power < 0)
    return f"{above or '1'}{below}" if below else above
