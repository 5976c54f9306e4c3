"""Continuous-time transfer functions, and the model made of one for each pair of output and input."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.special import chdtri as chi2_isf

from core.summary import Summarised, listed
from logparse import Finding
from sysid.records.experiment import Experiment, Floats, horizon_steps, require_signals
from sysid.transfer_functions.model_record import (
    FitReport,
    FunctionRecord,
    FunctionsRecord,
    NoiseModel,
    TransferFunctionsRecord,
)
from sysid.transfer_functions.response import INITIAL_SECONDS, carried_on, discretise, trends

#: What has a standard deviation above this part of its value is reported as not determined.
DETERMINED = 0.5

Complex = NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class Root:
    """A pole or zero with its uncertainty."""

    value: complex  #: rad/s.
    covariance: Floats  #: shape (2, 2): Of real and imaginary part, (rad/s)^2; infinite for a multiple root.

    @property
    def sigma(self) -> float:
        """Largest standard deviation in any direction, rad/s."""
        if not np.isfinite(self.covariance).all():
            return float("inf")
        return float(np.sqrt(max(np.linalg.eigvalsh(self.covariance)[-1], 0.0)))

    @property
    def determined(self) -> bool:
        """Whether the deviation is below half of the distance from the origin."""
        return self.sigma < DETERMINED * abs(self.value)

    def ellipse(self, level: float = 0.95) -> Complex:
        """Draw the line within which the root lies with the given probability; on the axis, for a real root."""
        values, vectors = np.linalg.eigh(self.covariance)
        radii = np.sqrt(np.maximum(values, 0.0) * chi2_isf(2 if self.value.imag else 1, 1.0 - level))
        angle = np.linspace(0.0, 2.0 * np.pi, 48)
        around = vectors @ (radii[:, None] * np.array([np.cos(angle), np.sin(angle)]))
        return np.asarray(self.value + around[0] + 1j * around[1])


def roots_of(polynomial: Floats, covariance: Floats | None) -> tuple[Root, ...]:
    """Return the roots of ``c_0 s^n + ...``, slowest first, by ``d r / d c_k = -r^(n-k) / C'(r)``."""
    roots = np.roots(polynomial).astype(np.complex128)
    if covariance is None:
        covariance = np.zeros((len(polynomial), len(polynomial)))
    free = len(covariance)
    derivative = np.polyder(polynomial)
    with_errors = []
    for root in sorted(roots, key=lambda r: (abs(r), r.imag)):
        apart = np.abs(roots - root)
        # One multiple root, whose place is not differentiable.
        if np.count_nonzero(apart <= 1e-6 * max(abs(root), 1e-12)) > 1:
            with_errors.append(Root(complex(root), np.full((2, 2), np.inf)))
            continue
        slope = -(root ** np.arange(free - 1, -1, -1)) / np.polyval(derivative, root)
        parts = np.vstack([slope.real, slope.imag])
        with_errors.append(Root(complex(root), np.asarray(parts @ covariance @ parts.T)))
    return tuple(with_errors)


@dataclass(frozen=True, repr=False)
class TransferFunction(Summarised):
    """``G(s) = num(s) / den(s)``."""

    num: Floats  #: Highest power of s first; time in seconds.
    den: Floats  #: Highest power first, monic.
    #: Of ``(num, den without its leading 1)``; None for a transfer function that was not estimated.
    covariance: Floats | None = None
    delay: float = 0.0  #: Of the input, s: ``G(s) = exp(-delay s) num(s) / den(s)``.
    delay_std: float = 0.0  #: Its standard deviation, s; 0 when it was given.

    def summary(self) -> Mapping[str, str]:
        """Return the key facts of this result."""
        return {
            "numerator": " ".join(f"{value:.4g}" for value in self.num),
            "denominator": " ".join(f"{value:.4g}" for value in self.den),
            "delay": f"{self.delay:.4g} s",
            "uncertainty": "not known" if self.covariance is None else "covariance known",
        }

    @cached_property
    def poles(self) -> NDArray[np.complex128]:
        """Roots of the denominator, rad/s."""
        return np.asarray(np.roots(self.den), dtype=np.complex128)

    @cached_property
    def zeros(self) -> NDArray[np.complex128]:
        """Roots of the numerator, rad/s."""
        return np.asarray(np.roots(self.num), dtype=np.complex128)

    @property
    def state_space(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Matrices A, B, C and D of its controller canonical form, behind the delay."""
        a, b, c, d = (np.asarray(matrix, dtype=np.float64) for matrix in scipy.signal.tf2ss(self.num, self.den))
        return a, b, c, d

    @property
    def gain(self) -> float:
        """Value at s = 0: output per unit of input in the long run; infinite with an integrator."""
        if self.den[-1] == 0.0:
            return float(np.copysign(np.inf, self.num[-1]))
        return float(self.num[-1] / self.den[-1])

    @cached_property
    def standard_deviation(self) -> Floats | None:
        """Of ``(num, den without its leading 1)``."""
        return None if self.covariance is None else np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @cached_property
    def relative_deviation(self) -> Floats | None:
        """Standard deviation over value of ``(num, den without its leading 1)``: the relative Cramer-Rao deviation.

        It is Cramer-Rao's for white Gaussian residuals; for coloured ones the deviation is the wider, valid one.
        """
        if self.standard_deviation is None:
            return None
        value = np.abs(np.concatenate([self.num, self.den[1:]]))
        return np.asarray(self.standard_deviation / np.maximum(value, 1e-300))

    @cached_property
    def determined(self) -> NDArray[np.bool_] | None:
        """Which of ``(num, den without its leading 1)`` the data determine: standard deviation below half the value."""
        if self.relative_deviation is None or self.standard_deviation is None:
            return None
        fixed = (self.standard_deviation == 0.0) & (np.concatenate([self.num, self.den[1:]]) == 0.0)
        return np.asarray((self.relative_deviation < DETERMINED) | fixed)

    def response(self, omega: Floats) -> NDArray[np.complex128]:
        """Evaluate G(j omega) at angular frequencies in rad/s."""
        s = 1j * np.asarray(omega, dtype=np.float64)
        ratio = np.polyval(self.num, s) / np.polyval(self.den, s)
        return np.asarray(ratio * np.exp(-self.delay * s), dtype=np.complex128)

    def record(self) -> FunctionRecord:
        """Return what files hold of it."""
        some_poles, some_zeros = poles(self), zeros(self)
        deviation, determined, n = self.standard_deviation, self.determined, len(self.num)
        return FunctionRecord(
            num=tuple(self.num.tolist()),
            den=tuple(self.den.tolist()),
            num_std=None if deviation is None else tuple(deviation[:n].tolist()),
            den_std=None if deviation is None else (0.0, *deviation[n:].tolist()),
            num_determined=None if determined is None else tuple(determined[:n].tolist()),
            den_determined=None if determined is None else (True, *determined[n:].tolist()),
            poles=tuple((root.value.real, root.value.imag) for root in some_poles),
            poles_std=None if deviation is None else tuple(root.sigma for root in some_poles),
            zeros=tuple((root.value.real, root.value.imag) for root in some_zeros),
            zeros_std=None if deviation is None else tuple(root.sigma for root in some_zeros),
            gain=self.gain,
            delay=self.delay,
            delay_std=self.delay_std,
            covariance=None if self.covariance is None else tuple(tuple(row) for row in self.covariance.tolist()),
        )

    @classmethod
    def from_record(cls, record: FunctionRecord) -> TransferFunction:
        """Make it again from its record."""
        size, covariance = len(record.num) + len(record.den) - 1, record.covariance
        return cls(
            num=np.asarray(record.num, dtype=np.float64),
            den=np.asarray(record.den, dtype=np.float64),
            covariance=None if covariance is None else np.array(covariance, np.float64).reshape(size, size),
            delay=record.delay,
            delay_std=np.inf if record.delay_std is None else record.delay_std,
        )


def poles(function: TransferFunction) -> tuple[Root, ...]:
    """Return the poles with their uncertainty, slowest first."""
    n, covariance = len(function.num), function.covariance
    return roots_of(function.den, None if covariance is None else covariance[n:, n:])


def zeros(function: TransferFunction) -> tuple[Root, ...]:
    """Return the zeros with their uncertainty, slowest first."""
    n, covariance = len(function.num), function.covariance
    return roots_of(function.num, None if covariance is None else covariance[:n, :n])


def run_freely(
    row: Mapping[str, TransferFunction],
    record: Experiment,
    column: int,
    hold: str,
    shared: bool,
    rmse: float,
    initial_energy: float,
    initial: Floats | None = None,
) -> Floats:
    """Simulate one output of a record with the functions from its inputs, from an initial state.

    `initial` holds the polynomial in time (`trends`) and the coefficients of the normalised initial responses,
    power-major; it is empty for a start at rest. Without it the state is found in `INITIAL_SECONDS` of the output.
    """
    samples, origin = len(record.t), record.output_trim[column]
    early = min(round(INITIAL_SECONDS / record.dt) + 1, samples)
    active = [j for j, name in enumerate(record.input_names) if len(row[name].den) > 1]
    if not active:
        return np.full(samples, origin + float(np.mean(record.y[:early, column] - origin)))
    functions = [row[record.input_names[j]] for j in active]
    orders = [len(function.den) - 1 for function in functions]
    a = np.zeros((len(active), max(orders)))
    for lane, function in enumerate(functions):
        a[lane, : orders[lane]] = function.den[:0:-1]
    system = discretise(a, record.dt, hold, orders)
    late = np.array([function.delay for function in functions])
    states = system.forced((record.u - record.input_trim)[:, active], range(len(active)), delays=late)
    forced = np.full(samples, origin)
    for lane, function in enumerate(functions):
        count = len(function.num)
        b = function.num[::-1] / system.unit[lane] ** (orders[lane] - np.arange(count))
        forced += states[:, :count, lane] @ b
    if initial is not None and initial.size == 0:
        return forced
    if shared:
        system = system.first()
    k = system.integrators
    shapes = np.hstack([trends(samples, k), system.free(samples)[:, k:].reshape(samples, -1)])
    if initial is None:
        # Maximum a posteriori: offset and integrators are free, the initial responses as small as those of the training
        # records, and the input's trim is taken as it is given.
        known = np.delete(shapes[:early], [k] if k else [], axis=1)
        normal, first = known.T @ known, max(k, 1)
        normal[first:, first:] += max(rmse, 1e-9) ** 2 / initial_energy * system.initial_precision()
        scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
        rhs = known.T @ (record.y[:, column] - forced)[:early]
        fitted = scale * np.linalg.lstsq(normal * scale * scale[:, None], scale * rhs, rcond=1e-12)[0]
        initial = fitted if k == 0 else np.insert(fitted, k, 0.0)
    return np.asarray(forced + shapes @ initial)


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class FunctionsModel(Summarised):
    """What models made of transfer functions have in common."""

    name: str  #: What it is, for tables.
    transfer_functions: Mapping[str, Mapping[str, TransferFunction]]  #: ``[output][input]``.
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]
    units: Mapping[str, str]
    structure: str  #: {"per_input", "common", "closed_loop"}
    poles: int
    zeros: int
    hold: str  #: {"zoh", "foh"}: How inputs run between samples: held, or straight lines.
    rate: float  #: Samples per second of the training records.
    #: For each output, how the part that the model does not explain carries on (for `predict`).
    disturbance: Mapping[str, NoiseModel]
    reports: Mapping[str, FitReport]  #: For each output, how the fit went.
    training: tuple[str, ...]  #: Names of the records used for the fit.
    findings: tuple[Finding, ...] = ()

    def summary(self) -> Mapping[str, str]:
        """Return the key facts of this result."""
        return {
            "name": self.name,
            "inputs": listed(self.input_names, 8),
            "outputs": listed(self.output_names),
            "order": f"{self.poles} poles, {self.zeros} zeros",
            "rate": f"{self.rate:.4g} Hz",
            "fit on training": ", ".join(f"{name} {report.fit_percent:.1f} %" for name, report in self.reports.items()),
            "training": listed(self.training),
            "findings": listed(dict.fromkeys(finding.id for finding in self.findings)) or "none",
        }

    def simulate(self, experiment: Experiment) -> Floats:
        """Run freely from the initial state; shape (N, p)."""
        raise NotImplementedError

    def predict(self, experiment: Experiment, horizon: float = 1.0, simulated: Floats | None = None) -> Floats:
        """Predict every sample from what was measured up to `horizon` seconds before it, shape (N, p).

        The model carries the response to the inputs, which are taken as known; what it did not explain so far
        (wind, drift) is carried on as `disturbance` says. The first samples, which have nothing measured before them,
        are the free run: all of them, where the horizon is longer than the record.
        """
        steps = horizon_steps(horizon, experiment.dt)
        if simulated is None:
            simulated = self.simulate(experiment)
        result = simulated.copy()
        for column, output in enumerate(self.output_names):
            residual = experiment.y[:, column] - simulated[:, column]
            result[:, column] += carried_on(self.disturbance[output], residual, experiment.dt, steps)
        return result


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class TransferFunctionModel(FunctionsModel):
    """Sum over inputs of one transfer function each, for every output: ``y_i = c_i + sum_j G_ij (u_j - trim_j)``."""

    #: For each output the energy that the response to an initial state is expected to have; see `run_freely`.
    initial_energy: Mapping[str, float]
    #: ``[record][output]``: offset and initial response of each training record as the fit found them, from which
    #: `simulate` starts such a record; empty for one that starts at rest.
    initial_states: Mapping[str, Mapping[str, Floats]]
    #: Mean of each input over the training records, about which the model was fitted: for new inputs that are no flight
    #: with a hover of its own (`simulate` works about the trim of the record that it is given). Empty where it is not
    #: known.
    input_trim: Mapping[str, float] = field(default_factory=dict)

    def summary(self) -> Mapping[str, str]:
        """Return the key facts of this result."""
        order = f"{self.poles} poles, {self.zeros} zeros, {self.structure.replace('_', ' ')} denominators"
        return {**FunctionsModel.summary(self), "order": order}

    def __getitem__(self, names: tuple[str, str] | str) -> TransferFunction:
        """Return the function from an input to an output: ``model["z", "m1"]``; of a single input ``model["z"]``."""
        output, source = (names, self.input_names[0]) if isinstance(names, str) else names
        if isinstance(names, str) and len(self.input_names) > 1:
            raise KeyError(
                f"name an output and an input, such as [{self.output_names[0]!r}, {source!r}]; outputs are "
                f"{', '.join(self.output_names)}, inputs {', '.join(self.input_names)}"
            )
        if output not in self.output_names or source not in self.input_names:
            raise KeyError(
                f"no function to {output!r} from {source!r}; outputs are {', '.join(self.output_names)}, inputs "
                f"{', '.join(self.input_names)}"
            )
        return self.transfer_functions[output][source]

    def simulate(self, experiment: Experiment) -> Floats:
        """Run freely from the initial state, with nothing of the outputs after the first three seconds.

        The initial state is not measured; it is estimated from the outputs of the first `INITIAL_SECONDS` with the
        assumption that it is no larger than those of the training records. A training record starts from the initial
        state that the fit found for it, as is usual for the figures of a training flight.

        Returns
        -------
        ndarray, shape (N, p)
        """
        require_signals(experiment, self.input_names, self.output_names)
        result = np.empty_like(experiment.y)
        for column, output in enumerate(self.output_names):
            row, rmse, energy = self.transfer_functions[output], self.reports[output].rmse, self.initial_energy[output]
            initial = self.initial_states.get(experiment.name, {}).get(output)
            shared = self.structure == "common"
            result[:, column] = run_freely(row, experiment, column, self.hold, shared, rmse, energy, initial)
        return result

    def from_rest(self, name: str) -> TransferFunctionModel:
        """Return the model with this record starting at rest at its output trim, for outputs not measured."""
        states = dict.fromkeys(self.output_names, np.zeros(0))
        return replace(self, initial_states={**self.initial_states, name: states})

    def record(self) -> TransferFunctionsRecord:
        """Return what files hold of the model."""
        functions = {
            output: {name: function.record() for name, function in row.items()}
            for output, row in self.transfer_functions.items()
        }
        held = held_alike(self, TransferFunctionsRecord.__struct_fields__)
        return TransferFunctionsRecord(
            **held | {"transfer_functions": functions, "initial_seconds": INITIAL_SECONDS},
        )

    @classmethod
    def from_record(cls, record: TransferFunctionsRecord) -> TransferFunctionModel:
        """Make the model again from its record, all but the initial states of the training records and the findings."""
        functions = {
            output: {name: TransferFunction.from_record(function) for name, function in row.items()}
            for output, row in record.transfer_functions.items()
        }
        held = held_alike(record, [attribute.name for attribute in fields(cls)])
        return cls(**held | {"transfer_functions": functions, "initial_states": {}, "findings": ()})


def held_alike(of: FunctionsModel | FunctionsRecord, names: Iterable[str]) -> dict[str, Any]:
    """Return what a model, or its record, has under the same names as the other."""
    return {name: getattr(of, name) for name in names if hasattr(of, name)}
