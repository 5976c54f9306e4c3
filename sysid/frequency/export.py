"""Frequency responses and fits for other tools: CSV, JSON, .mat, python-control."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import numpy as np
import pandas as pd
import scipy

from core.lazy import lazy
from core.parameter import Parameter
from core.serialization import as_json
from logparse import Finding
from sysid.frequency.axes import FrequencyError
from sysid.frequency.fit import FrequencyFit
from sysid.frequency.rational import RationalModel
from sysid.frequency.response import Floats, FrequencyResponse
from sysid.frequency.survey import AxisSurvey, FrequencySurvey
from sysid.frequency.time_domain import Verification

if TYPE_CHECKING:
    import control
else:
    control = lazy("control")

#: Numbers of an array, None for what is not finite.
Numbers = tuple[float | None, ...]

#: Order of the approximation of delays for tools that have none.
_PADE_ORDER = 3


def response_table(frf: FrequencyResponse, fit: FrequencyFit | None = None) -> pd.DataFrame:
    """Return a response as a table indexed by frequency [Hz]: gain in dB, phase in degrees, coherence, errors."""
    columns = {
        "gain_db": frf.gain_db,
        "phase_deg": np.degrees(frf.phase),
        "coherence": frf.coherence,
        "multiple_coherence": frf.multiple_coherence,
        "sigma_db": 20.0 / np.log(10.0) * frf.sigma,
        "sigma_phase_deg": np.degrees(frf.sigma_phase),
        "averages": frf.averages,
        "resolution_hz": frf.resolution,
        "real": frf.response.real,
        "imag": frf.response.imag,
        "direct_gain_db": 20.0 * np.log10(np.maximum(np.abs(frf.direct), 1e-300)),
        "direct_phase_deg": np.degrees(np.unwrap(np.angle(frf.direct))),
    }
    if fit is not None:
        model = fit.response(frf.hz)
        columns |= {
            "model_gain_db": 20.0 * np.log10(np.abs(model)),
            "model_phase_deg": np.degrees(np.unwrap(np.angle(model))),
        }
    return pd.DataFrame(columns, index=pd.Index(frf.hz, name="hz"))


class ResponseRecord(msgspec.Struct, frozen=True, kw_only=True):
    """A frequency response."""

    input: str
    output: str
    unit: str
    method: str
    instrument: str
    source: str
    duration: float
    records: tuple[str, ...]
    gyro_filter_hz: float | None
    findings: tuple[Finding, ...]
    hz: Numbers
    real: Numbers
    imag: Numbers
    coherence: Numbers
    sigma: Numbers
    sigma_phase: Numbers
    averages: Numbers


class FitRecord(msgspec.Struct, frozen=True, kw_only=True):
    """A fit to a response: parameters with errors, cost, poles, matrices."""

    structure: tuple[str, ...]
    cost: float
    verdict: str
    parameters: Mapping[str, Parameter]
    insensitivity: Mapping[str, float | None]
    correlation: tuple[Numbers, ...]
    num: Numbers
    den: Numbers
    delay: float
    poles: tuple[tuple[float, float], ...]  #: Real and imaginary part, rad/s.
    state_space: Mapping[str, tuple[Numbers, ...]]


class AttitudeRecord(msgspec.Struct, frozen=True, kw_only=True):
    """How the attitude follows its target."""

    bandwidth: Parameter
    phase_delay: Parameter
    peak: Parameter
    fit: FitRecord
    response: ResponseRecord


class CheckRecord(msgspec.Struct, frozen=True, kw_only=True):
    """How the model predicted flying that was held out."""

    seconds: float
    rms: float
    fit_percent: float
    theil: float
    correlation: float
    white: bool | None
    verdict: str
    records: tuple[str, ...]


class CouplingRecord(msgspec.Struct, frozen=True, kw_only=True):
    """How strongly the command of one axis turns the craft about another, in parts of its own answer."""

    axis: str
    other: str
    ratio: Parameter


class AxisRecord(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What is known of an axis."""

    axis: str
    reason: str
    attitude_reason: str
    response: ResponseRecord | None = None
    fit: FitRecord | None = None
    attitude: AttitudeRecord | None = None
    check: CheckRecord | None = None
    check_reason: str = ""


class SurveyRecord(msgspec.Struct, frozen=True, kw_only=True):
    """What frequency.json holds."""

    logs: tuple[str, ...]
    axes: tuple[AxisRecord, ...]
    couplings: tuple[CouplingRecord, ...]
    findings: tuple[Finding, ...]


def survey_record(found: FrequencySurvey) -> SurveyRecord:
    """Return a survey as frequency.json holds it."""
    return SurveyRecord(
        logs=found.names,
        axes=tuple(map(_axis, found.axes)),
        couplings=tuple(CouplingRecord(axis=each.axis, other=each.other, ratio=each.ratio) for each in found.couplings),
        findings=found.findings,
    )


def _axis(axis: AxisSurvey) -> AxisRecord:
    attitude = axis.attitude
    return AxisRecord(
        axis=axis.axis,
        reason=axis.reason,
        attitude_reason=axis.attitude_reason,
        response=None if axis.response is None else _response(axis.response),
        fit=None if axis.fit is None else _fit(axis.fit),
        attitude=None
        if attitude is None
        else AttitudeRecord(
            bandwidth=attitude.bandwidth,
            phase_delay=attitude.phase_delay,
            peak=attitude.peak,
            fit=_fit(attitude.fit),
            response=_response(attitude.frf),
        ),
        check=None if axis.check is None else _check(axis.check),
        check_reason=axis.check_reason,
    )


def _check(check: Verification) -> CheckRecord:
    return CheckRecord(
        seconds=check.seconds,
        rms=check.rms,
        fit_percent=check.fit_percent,
        theil=check.theil,
        correlation=check.correlation,
        white=None if check.residuals is None else check.residuals.white,
        verdict=check.verdict,
        records=check.records,
    )


def _response(frf: FrequencyResponse) -> ResponseRecord:
    return ResponseRecord(
        input=frf.input,
        output=frf.output,
        unit=frf.unit,
        method=frf.method,
        instrument=frf.instrument,
        source=frf.source,
        duration=frf.duration,
        records=frf.records,
        gyro_filter_hz=frf.gyro_filter_hz,
        findings=frf.findings,
        hz=tuple(frf.hz.tolist()),
        real=tuple(frf.response.real.tolist()),
        imag=tuple(frf.response.imag.tolist()),
        coherence=tuple(frf.coherence.tolist()),
        sigma=tuple(frf.sigma.tolist()),
        sigma_phase=tuple(frf.sigma_phase.tolist()),
        averages=tuple(frf.averages.tolist()),
    )


def _fit(fit: FrequencyFit) -> FitRecord:
    model = fit.transfer_function()
    matrices = model.state_space
    return FitRecord(
        structure=tuple(structure.name for structure in fit.structure),
        cost=fit.cost,
        verdict=fit.verdict,
        parameters=fit.parameters,
        insensitivity=dict(zip(fit.names, fit.insensitivity.tolist(), strict=True)),
        correlation=_rows(fit.correlation),
        num=tuple(model.num.tolist()),
        den=tuple(model.den.tolist()),
        delay=model.delay,
        poles=tuple((pole.real, pole.imag) for pole in model.poles.tolist()),
        state_space={name: _rows(getattr(matrices, name)) for name in "ABCD"},
    )


def _rows(matrix: Floats) -> tuple[Numbers, ...]:
    return tuple(tuple(row) for row in matrix.tolist())


def write(found: FrequencySurvey, out: Path) -> tuple[Path, ...]:
    """Write ``frequency.json``, ``frequency.mat`` and one ``frequency_AXIS.csv`` for each response.

    In MATLAB: ``load frequency.mat; sys = frd(roll.response, roll.hz, 'FrequencyUnit', 'Hz'); tf(roll.num, roll.den)``,
    which has neither ``roll.delay`` nor the gyro's low-pass of ``roll.gyro_filter_hz``. What follows its target is
    ``roll_attitude``.
    """
    files = [out / "frequency.json", out / "frequency.mat"]
    files[0].write_text(as_json(survey_record(found)), encoding="utf-8")
    responses: dict[str, tuple[FrequencyResponse, FrequencyFit | None]] = {}
    for axis in found.axes:
        if axis.response is not None:
            responses[axis.axis] = axis.response, axis.fit
        if axis.attitude is not None:
            responses[f"{axis.axis}_attitude"] = axis.attitude.frf, axis.attitude.fit
    for name, (frf, fit) in responses.items():
        table = out / f"frequency_{name}.csv"
        response_table(frf, fit).to_csv(table)
        files.append(table)
    scipy.io.savemat(files[1], {name: _struct(*each) for name, each in responses.items()})
    return tuple(files)


def _struct(frf: FrequencyResponse, fit: FrequencyFit | None) -> dict[str, object]:
    names = ("hz", "response", "coherence", "sigma", "sigma_phase", "averages", "direct", "unit")
    struct: dict[str, object] = {name: getattr(frf, name) for name in names}
    struct["gyro_filter_hz"] = np.nan if frf.gyro_filter_hz is None else frf.gyro_filter_hz
    if fit is not None:
        model = fit.transfer_function()
        struct |= {"num": model.num, "den": model.den, "delay": model.delay, "cost": fit.cost}
    return struct


def to_control(found: FrequencyResponse | FrequencyFit | RationalModel) -> control.FRD | control.TransferFunction:
    """Return a response as python-control's FRD, a model as its transfer function, the delay as Padé's approximation.

    Raises
    ------
    FrequencyError
        Without python-control, the extra ``control``.
    """
    if find_spec("control") is None:
        raise FrequencyError("python-control is not installed; install it with: pip install 'rotorid[control]'")
    if isinstance(found, FrequencyResponse):
        return control.FRD(found.response, 2.0 * np.pi * found.hz)
    model = found.transfer_function() if isinstance(found, FrequencyFit) else found
    num, den = control.pade(model.delay, _PADE_ORDER if model.delay > 0.0 else 0)
    return control.TransferFunction(np.polymul(model.num, num), np.polymul(model.den, den))
