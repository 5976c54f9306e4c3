"""Frequency responses and fits for other tools: CSV, JSON, .mat, python-control."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import scipy

from core.serialization import as_json
from sysid.frequency.fitted import FrequencyFit
from sysid.frequency.response import FrequencyResponse
from sysid.frequency.survey import AxisSurvey, FrequencySurvey
from sysid.transfer_functions.export import functions_to_control, python_control
from sysid.transfer_functions.transfer_function import TransferFunction, poles

if TYPE_CHECKING:
    import control


def response_table(frf: FrequencyResponse, fit: FrequencyFit | None = None) -> pd.DataFrame:
    """Return a response as a table indexed by frequency [Hz]: gain in dB, phase in degrees, coherence, errors."""
    known = np.where(np.isfinite(frf.sigma), 1.0, np.nan)
    columns = {
        "gain_db": frf.gain_db,
        "phase_deg": np.degrees(frf.phase),
        "coherence": frf.coherence,
        "multiple_coherence": frf.multiple_coherence,
        "sigma_db": 20.0 / np.log(10.0) * frf.sigma,
        "sigma_phase_deg": np.degrees(frf.sigma_phase),
        "averages": frf.averages,
        "resolution_hz": frf.resolution,
        "real": known * frf.response.real,
        "imag": known * frf.response.imag,
        "direct_gain_db": known * 20.0 * np.log10(np.maximum(np.abs(frf.direct), 1e-300)),
        "direct_phase_deg": known * np.degrees(np.unwrap(np.angle(frf.direct))),
    }
    if fit is not None:
        model = fit.response(frf.hz)
        columns |= {
            "model_gain_db": 20.0 * np.log10(np.abs(model)),
            "model_phase_deg": np.degrees(np.unwrap(np.angle(model))),
        }
    return pd.DataFrame(columns, index=pd.Index(frf.hz, name="hz"))


def survey_json(survey: FrequencySurvey) -> str:
    """Return the text of frequency.json."""
    couplings = [_fields(coupling, "axis other ratio") for coupling in survey.couplings]
    axes = [{name: value for name, value in _axis(axis).items() if value is not None} for axis in survey.axes]
    return as_json({"logs": survey.names, "axes": axes, "couplings": couplings, "findings": survey.findings})


def _axis(axis: AxisSurvey) -> dict[str, object]:
    attitude, check = axis.attitude, axis.check
    return {
        "axis": axis.axis,
        "reason": axis.reason,
        "attitude_reason": axis.attitude_reason,
        "response": None if axis.response is None else _response(axis.response),
        "fit": None if axis.fit is None else _fit(axis.fit),
        "attitude": None
        if attitude is None
        else _fields(attitude, "bandwidth phase_delay peak")
        | {"fit": _fit(attitude.fit), "response": _response(attitude.frf)},
        "check": None
        if check is None
        else _fields(check, "seconds rms fit_percent theil correlation verdict records")
        | {"white": None if check.residuals is None else check.residuals.white},
        "check_reason": axis.check_reason or None,
    }


def _fields(value: object, names: str) -> dict[str, object]:
    return {name: getattr(value, name) for name in names.split()}


def _response(frf: FrequencyResponse) -> dict[str, object]:
    names = "input output unit method instrument source duration records gyro_filter_hz findings"
    names += " hz coherence sigma sigma_phase averages"
    return _fields(frf, names) | {"real": frf.response.real, "imag": frf.response.imag}


def _fit(fit: FrequencyFit) -> dict[str, object]:
    model = fit.transfer_function()
    return (
        _fields(fit, "cost verdict parameters correlation")
        | _fields(model, "num den delay")
        | {
            "poles": [root.value for root in poles(model)],
            "structure": [structure.name for structure in fit.structure],
            "insensitivity": dict(zip(fit.names, fit.insensitivity.tolist(), strict=True)),
            "state_space": dict(zip("ABCD", model.state_space, strict=True)),
        }
    )


def write(survey: FrequencySurvey, out: Path) -> tuple[Path, ...]:
    """Write ``frequency.json``, ``frequency.mat`` and one ``frequency_AXIS.csv`` for each response.

    In MATLAB: ``load frequency.mat; sys = frd(roll.response, roll.hz, 'FrequencyUnit', 'Hz'); tf(roll.num, roll.den)``,
    which has neither ``roll.delay`` nor the gyro's low-pass of ``roll.gyro_filter_hz``. What follows its target is
    ``roll_attitude``.
    """
    files = [out / "frequency.json", out / "frequency.mat"]
    files[0].write_text(survey_json(survey), encoding="utf-8")
    responses: dict[str, tuple[FrequencyResponse, FrequencyFit | None]] = {}
    for axis in survey.axes:
        if axis.response is not None:
            responses[axis.axis] = axis.response, axis.fit
        if axis.attitude is not None:
            responses[f"{axis.axis}_attitude"] = axis.attitude.frf, axis.attitude.fit
    for name, (frf, fit) in responses.items():
        table = out / f"frequency_{name}.csv"
        response_table(frf, fit).to_csv(table)
        files.append(table)
    scipy.io.savemat(files[1], {name: _struct(*response) for name, response in responses.items()})
    return tuple(files)


def _struct(frf: FrequencyResponse, fit: FrequencyFit | None) -> dict[str, object]:
    struct = _fields(frf, "hz response coherence sigma sigma_phase averages direct unit")
    struct["gyro_filter_hz"] = np.nan if frf.gyro_filter_hz is None else frf.gyro_filter_hz
    if fit is not None:
        model = fit.transfer_function()
        struct |= {"num": model.num, "den": model.den, "delay": model.delay, "cost": fit.cost}
    return struct


def to_control(model: FrequencyResponse | FrequencyFit | TransferFunction) -> control.FRD | control.TransferFunction:
    """Return a response as FRD of python-control, a model as its transfer function, the delay by Padé."""
    if isinstance(model, FrequencyResponse):
        return python_control().FRD(model.response, 2.0 * np.pi * model.hz)
    return functions_to_control([[model.transfer_function() if isinstance(model, FrequencyFit) else model]])
