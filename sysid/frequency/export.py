"""Frequency responses and fits for other tools: CSV, JSON, .mat, python-control."""

from __future__ import annotations

import json
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from scipy.io import savemat

from logparse.lazy import lazy
from logparse.serialization import plain
from sysid.frequency.axes import FrequencyError
from sysid.frequency.fit import FrequencyFit
from sysid.frequency.rational import RationalModel
from sysid.frequency.response import FrequencyResponse
from sysid.frequency.survey import AxisSurvey, FrequencySurvey

if TYPE_CHECKING:
    import control
else:
    control = lazy("control")

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


def axis_numbers(axis: AxisSurvey) -> dict[str, Any]:
    """Return what is known of an axis as plain values for JSON."""
    numbers: dict[str, Any] = {"axis": axis.axis, "reason": axis.reason, "attitude_reason": axis.attitude_reason}
    if axis.response is not None:
        frf = axis.response
        numbers["response"] = {
            "input": frf.input,
            "output": frf.output,
            "unit": frf.unit,
            "method": frf.method,
            "instrument": frf.instrument,
            "duration": frf.duration,
            "records": list(frf.records),
            "gyro_filter_hz": frf.gyro_filter_hz,
            "findings": plain(frf.findings),
            "hz": frf.hz.tolist(),
        } | {
            name: _finite(values)
            for name, values in (
                ("real", frf.response.real),
                ("imag", frf.response.imag),
                ("coherence", frf.coherence),
                ("sigma", frf.sigma),
                ("sigma_phase", frf.sigma_phase),
                ("averages", frf.averages),
            )
        }
    if axis.fit is not None:
        numbers["fit"] = fit_numbers(axis.fit)
    if axis.attitude is not None:
        numbers["attitude"] = {
            "bandwidth": plain(axis.attitude.bandwidth),
            "phase_delay": plain(axis.attitude.phase_delay),
            "peak": plain(axis.attitude.peak),
            "fit": fit_numbers(axis.attitude.fit),
        }
    return numbers


def fit_numbers(fit: FrequencyFit) -> dict[str, Any]:
    """Return a fit as plain values for JSON: parameters with errors, cost, poles, matrices."""
    model = fit.transfer_function()
    matrices = model.state_space
    return {
        "structure": [structure.name for structure in fit.structure],
        "cost": fit.cost,
        "verdict": fit.verdict,
        "parameters": plain(fit.parameters),
        "insensitivity": dict(zip(fit.names, _finite(fit.insensitivity), strict=True)),
        "correlation": [_finite(row) for row in fit.correlation],
        "num": model.num.tolist(),
        "den": model.den.tolist(),
        "delay": model.delay,
        "poles": [[pole.real, pole.imag] for pole in model.poles],
        "state_space": {name: getattr(matrices, name).tolist() for name in "ABCD"},
    }


def write(found: FrequencySurvey, out: Path) -> tuple[Path, ...]:
    """Write ``frequency.json``, ``frequency.mat`` and one ``frequency_AXIS.csv`` for each axis with a response.

    In MATLAB: ``load frequency.mat; sys = frd(roll.response, roll.hz, 'FrequencyUnit', 'Hz'); tf(roll.num, roll.den)``.
    """
    files = [out / "frequency.json", out / "frequency.mat"]
    numbers = {"logs": list(found.names), "axes": [axis_numbers(axis) for axis in found.axes]}
    files[0].write_text(json.dumps(numbers, indent=1, allow_nan=False), encoding="utf-8")
    structs: dict[str, Any] = {}
    for axis in found.axes:
        if axis.response is None:
            continue
        table = out / f"frequency_{axis.axis}.csv"
        response_table(axis.response, axis.fit).to_csv(table)
        files.append(table)
        struct = {name: getattr(axis.response, name) for name in ("hz", "response", "coherence", "sigma", "direct")}
        if axis.fit is not None:
            model = axis.fit.transfer_function()
            struct |= {"num": model.num, "den": model.den, "delay": model.delay, "cost": axis.fit.cost}
        structs[axis.axis] = struct
    savemat(files[1], structs)
    return tuple(files)


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


def _finite(values: Any) -> list[float | None]:
    return [float(value) if np.isfinite(value) else None for value in values]
