"""Structures of an axis: what its frequency response may look like, with parameters that mean something.

Every structure is a ratio of polynomials in s with a delay and, where it is known, the low-pass through which the rate
was measured.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from sysid.frequency.response import Complex, Floats

#: Numerator and denominator, highest power first.
Polynomials = tuple[Floats, Floats]


@dataclass(frozen=True, slots=True)
class ParameterSpec:
    """A parameter of a structure."""

    name: str
    unit: str
    positive: bool = True  #: Whether it keeps its sign; the search then goes over its logarithm.
    scale: float = 1.0  #: A change that matters, for those that may change their sign.
    #: Standard deviation up to which it is determined even where that is more than half of its value.
    absolute: float = 0.0


@dataclass(frozen=True, slots=True)
class Structure:
    """A family of responses."""

    name: str
    specs: tuple[ParameterSpec, ...]  #: The last one is the delay.
    polynomials: Callable[[Floats], Polynomials]  #: From values in the order of `specs` to numerator and denominator.

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the parameters."""
        return tuple(spec.name for spec in self.specs)

    def response(self, values: Floats, hz: Floats) -> Complex:
        """Evaluate at frequencies [Hz], without the filter of the measurement, shape (n,)."""
        s = 2j * np.pi * hz
        num, den = self.polynomials(values)
        return np.asarray(np.polyval(num, s) / np.polyval(den, s) * np.exp(-values[-1] * s))

    def slopes(self, values: Floats, hz: Floats) -> Complex:
        """Differentiate the logarithm of the response by the values, shape (n, parameters).

        Only the few coefficients are differenced, not the response at every frequency.
        """
        size = np.abs(values[:-1])
        steps = 1e-6 * np.array(
            [value if spec.positive else max(value, spec.scale) for value, spec in zip(size, self.specs, strict=False)]
        )
        moves = np.diag(np.append(steps, 0.0))[:-1]
        s = 2j * np.pi * hz
        slopes = np.zeros((len(hz), len(values)), np.complex128)
        beside = [(*self.polynomials(values + move), *self.polynomials(values - move)) for move in moves]
        for sign, part, now in zip((1.0, -1.0), (0, 1), self.polynomials(values), strict=True):
            apart = np.array([shifted[part] - shifted[part + 2] for shifted in beside]).T / (2.0 * steps)
            powers = np.vander(s, len(now))
            slopes[:, :-1] += sign * (powers @ apart) / (powers @ now)[:, None]
        slopes[:, -1] = -s
        return slopes


def low_pass(hz: Floats, corner: float | None) -> Complex:
    """Evaluate the second-order Butterworth low-pass of gyro and accelerometer; ones without a corner."""
    if not corner:
        return np.ones(len(hz), dtype=np.complex128)
    s, omega = 2j * np.pi * hz, 2.0 * np.pi * corner
    return np.asarray(omega**2 / (s**2 + np.sqrt(2.0) * omega * s + omega**2))


#: Parameters by name. Gains come first and delays last.
_SPECS = {
    "damping": ParameterSpec("damping", "1/s", positive=False, scale=1.0, absolute=0.5),
    "lag": ParameterSpec("lag", "s"),
    "lead": ParameterSpec("lead", "s", positive=False, scale=0.05, absolute=0.02),
    "mode_frequency": ParameterSpec("mode_frequency", "rad/s"),
    "mode_damping": ParameterSpec("mode_damping", "1"),
    "mode_share": ParameterSpec("mode_share", "1", positive=False, scale=0.1, absolute=0.1),
    "speed_moment": ParameterSpec("speed_moment", "1/s^3", positive=False, scale=20.0, absolute=1.0),
    "corner": ParameterSpec("corner", "rad/s"),
    "natural_frequency": ParameterSpec("natural_frequency", "rad/s"),
    "damping_ratio": ParameterSpec("damping_ratio", "1"),
}


def _structures(
    unit: str, delay: tuple[float, float], *kinds: tuple[str, str, Callable[[Floats], Polynomials]]
) -> tuple[Structure, ...]:
    """Return structures of a gain, other parameters, and a delay with its scale and the error that determines it."""
    late = ParameterSpec("delay", "s", positive=False, scale=delay[0], absolute=delay[1])
    gain = ParameterSpec("gain", unit)
    return tuple(
        Structure(name, (gain, *(_SPECS[parameter] for parameter in parameters.split()), late), polynomials)
        for name, parameters, polynomials in kinds
    )


def _rate(p: Floats) -> Polynomials:
    return np.array([p[0]]), np.array([1.0, p[1]])


def _lagged(ratio: Polynomials, lag: float) -> Polynomials:
    return ratio[0], np.convolve(ratio[1], np.array([lag, 1.0]))


def _flexible(p: Floats) -> Polynomials:
    """Return ``K (1 / (s + a) + c s / (s^2 + 2 z w s + w^2))``: a rigid body with a mode that rides on it."""
    gain, damping, omega, zeta, share = p[:5]
    mode = np.array([1.0, 2.0 * zeta * omega, omega**2])
    num = mode + share * np.array([1.0, damping, 0.0])
    return gain * num, np.convolve(np.array([1.0, damping]), mode)


def _yaw(p: Floats) -> Polynomials:
    """Return ``K (T s + 1) / (s + a)``: the reaction to the rotors' acceleration leads their drag."""
    return p[0] * np.array([p[2], 1.0]), np.array([1.0, p[1]])


def _hovering(p: Floats) -> Polynomials:
    """Return ``K s^2 / (s^3 + a s^2 + b)``: slowly, motors work against the moment that air makes with speed.

    The cubic of hover (Tischler and Remple 2012, section 11.5), without the drag of the speed.
    """
    return p[0] * np.array([1.0, 0.0, 0.0]), np.array([1.0, p[1], 0.0, p[2]])


def _second_order(p: Floats) -> Polynomials:
    """Return a closed loop, with a zero where the parameters have its lead."""
    zero = np.array([p[3], 1.0]) if len(p) > 4 else np.ones(1)
    return p[0] * p[1] ** 2 * zero, np.array([1.0, 2.0 * p[2] * p[1], p[1] ** 2])


_TURNING = _structures(
    "rad/s^2",
    (0.005, 0.01),
    ("rate", "damping", _rate),
    ("rate, lag", "damping lag", lambda p: _lagged(_rate(p), float(p[2]))),
    ("rate, speed", "damping speed_moment", _hovering),
    ("rate, flexible mode", "damping mode_frequency mode_damping mode_share", _flexible),
    (
        "rate, lag, flexible mode",
        "damping mode_frequency mode_damping mode_share lag",
        lambda p: _lagged(_flexible(p), float(p[5])),
    ),
    ("yaw, lead", "damping lead", _yaw),
)

#: Structures that are tried for the output of each unit or axis, simplest first.
STRUCTURES: Mapping[str, tuple[Structure, ...]] = MappingProxyType(
    {
        "roll": _TURNING[:5],
        "pitch": _TURNING[:5],
        "yaw": (*_TURNING[:2], _TURNING[5]),
        "vertical": _structures(
            "m/s^2",
            (0.005, 0.01),
            ("vertical", "", lambda p: (np.array([p[0]]), np.array([1.0]))),
            ("vertical, lag", "lag", lambda p: (np.array([p[0]]), np.array([p[1], 1.0]))),
            ("vertical, heave damping", "damping", lambda p: (p[0] * np.array([1.0, 0.0]), np.array([1.0, p[1]]))),
        ),
        "closed": _structures(
            "1",
            (0.02, 0.03),
            ("closed loop, first order", "corner", lambda p: (np.array([p[0] * p[1]]), np.array([1.0, p[1]]))),
            ("closed loop, second order", "natural_frequency damping_ratio", _second_order),
            ("closed loop, second order with zero", "natural_frequency damping_ratio lead", _second_order),
        ),
    }
)
