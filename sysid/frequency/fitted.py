"""What a fit to frequency responses found: values, their covariance, the model they make, and its cost J."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from core.parameter import Parameter
from core.quantity import uncertain
from core.summary import Summarised, listed
from sysid.frequency.response import Complex, Floats, FrequencyResponse
from sysid.frequency.structures import Structure, low_pass
from sysid.transfer_functions.transfer_function import TransferFunction

#: Weight of a squared degree beside a squared dB: 1 dB counts as 7.57 deg (Tischler and Remple 2012, section 11.2).
PHASE_WEIGHT = 0.01745

#: Cost up to which a fit is good, and up to which it can hardly be told from a perfect one.
ACCEPTABLE, EXCELLENT = 100.0, 50.0

#: Cost beyond which the parameters mean nothing.
POOR = 400.0


def coherence_weight(coherence: Floats) -> Floats:
    """Weigh frequencies by coherence: ``(1.58 (1 - exp(-gamma^2)))^2`` (Tischler and Remple 2012, eq. 11.4)."""
    return np.asarray((1.58 * (1.0 - np.exp(-coherence))) ** 2)


def cost(measured: Complex, modelled: Complex, coherence: Floats) -> float:
    """Compute J, the weighted mean of squared dB and degrees, times 20 (Tischler and Remple 2012, eq. 11.3).

    `measured, modelled` (n,): frequency responses; `coherence` (n,): of the measured response, from 0 to 1.
    """
    ratio = measured / modelled
    gain, phase = 20.0 * np.log10(np.abs(ratio)), np.degrees(np.angle(ratio))
    return float(20.0 * np.mean(coherence_weight(coherence) * (gain**2 + PHASE_WEIGHT * phase**2)))


#: Times that shift the phase: the sign of each in the effective delay, which shows at low frequency.
TIMES: Mapping[str, float] = {"delay": 1.0, "lag": 1.0, "lead": -1.0}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class FrequencyFit(Summarised):
    """Parameters fitted to one or several frequency responses."""

    axes: tuple[str, ...]
    structure: tuple[Structure, ...]  #: One for each response.
    #: By name; with several responses by ``"roll.gain"`` and so on, shared ones without the axis. A parameter that the
    #: data do not determine has no value, and a reason.
    parameters: Mapping[str, Parameter]
    names: tuple[str, ...]
    values: Floats  #: shape (k,): Of the search, in the order of `names`, determined or not.
    #: shape (k, k): Of `values`: Cramer-Rao's, widened where the response does not fit within its errors.
    covariance: Floats
    #: shape (k,): Smallest change of each parameter alone that shows, in parts of its value (Tischler and Remple 2012,
    #: 11.3.3).
    insensitivity: Floats
    cost: float  #: J, the largest of the responses; up to 100 is good, up to 50 excellent.
    costs: tuple[float, ...]  #: J of each response.
    excess: float  #: Root mean square of the remainder in its own errors; 1 where the structure is right.
    responses: tuple[FrequencyResponse, ...] = field(repr=False)
    columns: tuple[tuple[int, ...], ...] = field(repr=False)
    #: Fits with other structures that explain the response too, with their probability beside this one's 1.
    others: tuple[tuple[float, FrequencyFit], ...] = field(default=(), repr=False)

    @property
    def correlation(self) -> Floats:
        """Return the correlation of the parameters, shape (k, k)."""
        deviation = np.sqrt(np.maximum(np.diag(self.covariance), 1e-300))
        return np.asarray(self.covariance / np.outer(deviation, deviation))

    @property
    def verdict(self) -> str:
        """Return in a word what the fit is good for."""
        if self.cost <= EXCELLENT:
            return "excellent: within what flight tests can tell apart"
        return "good" if self.cost <= ACCEPTABLE else "poor: the structure misses part of the response"

    def sigma_of(self, quantity: Callable[[FrequencyFit], float]) -> float:
        """Return the standard deviation of what is computed from the fit: of its parameters and of its structure."""
        value = quantity(self)
        variance, whole = self._variance(quantity, value), 1.0
        for share, other in self.others:
            there = quantity(other)
            if np.isfinite(there):
                variance += share * (other._variance(quantity, there) + (there - value) ** 2)
                whole += share
        return float(np.sqrt(variance / whole))

    def _variance(self, quantity: Callable[[FrequencyFit], float], value: float) -> float:
        slope = np.zeros(len(self.values))
        for k in range(len(self.values)):
            step = 0.1 * float(np.sqrt(max(self.covariance[k, k], 1e-20)))
            moved = self.values.copy()
            moved[k] += step
            slope[k] = (quantity(self.at(moved)) - value) / step
        return max(float(slope @ self.covariance @ slope), 0.0)

    def at(self, values: Floats) -> FrequencyFit:
        """Return the model at other parameters."""
        return replace(self, values=values)

    def response(self, hz: Floats, which: int = 0) -> Complex:
        """Evaluate the model of one response, with the filter of its measurement, shape (n,)."""
        hz = np.asarray(hz, dtype=np.float64)
        own = self.values[list(self.columns[which])]
        return self.structure[which].response(own, hz) * low_pass(hz, self.responses[which].gyro_filter_hz)

    def transfer_function(self, which: int = 0) -> TransferFunction:
        """Return the model of one response as a ratio of polynomials, without the filter of the measurement."""
        columns = list(self.columns[which])
        own, structure = self.values[columns], self.structure[which]
        covariance = self.covariance[np.ix_(columns, columns)]

        def coefficients(values: Floats) -> Floats:
            num, den = structure.polynomials(values)
            return np.concatenate([num / den[0], den[1:] / den[0], values[-1:]])

        centre = coefficients(own)
        slope = np.empty((len(centre), len(own)))
        for k in range(len(own)):
            step = 1e-5 * max(abs(own[k]), structure.specs[k].scale * 1e-2)
            moved = own.copy()
            moved[k] += step
            slope[:, k] = (coefficients(moved) - centre) / step
        num, den = structure.polynomials(own)
        known = np.asarray(slope @ covariance @ slope.T)
        late = float(np.sqrt(max(known[-1, -1], 0.0)))
        return TransferFunction(num / den[0], den / den[0], known[:-1, :-1], delay=float(own[-1]), delay_std=late)

    def summary(self) -> dict[str, str]:
        """Return the structure, its cost J and the parameters."""
        parts = []
        for name, value in self.parameters.items():
            known = value.value is not None and value.sigma is not None
            parts.append(f"{name} {uncertain(value.value, value.sigma, value.unit) if known else 'unknown'}")
        kinds = "; ".join(dict.fromkeys(structure.name for structure in self.structure))
        return {
            "axes": listed(self.axes),
            "structure": kinds,
            "cost J": f"{self.cost:.1f}",
            "parameters": listed(parts),
        }


def value_of(name: str, found: FrequencyFit) -> float:
    """Return a parameter of a fit; lag and lead are zero in a structure without them, other things are unknown."""
    if name in found.names:
        return float(found.values[found.names.index(name)])
    return 0.0 if name.rpartition(".")[2] in TIMES else float("nan")
