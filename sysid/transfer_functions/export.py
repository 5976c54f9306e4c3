"""Transfer functions for other tools: MATLAB and Octave (.mat), python-control, spreadsheets (CSV)."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import scipy

from core.lazy import lazy
from logparse import RotoridError
from sysid.transfer_functions.closed_loop import ClosedLoopModel
from sysid.transfer_functions.transfer_function import DETERMINED, TransferFunction, TransferFunctionModel

if TYPE_CHECKING:
    import control
else:
    control = lazy("control")


#: Models that are a matrix of transfer functions.
TransferMatrix = TransferFunctionModel | ClosedLoopModel


class ExportError(RotoridError):
    """A model cannot be given in the form that was asked for; the message says what is missing."""


def matlab_struct(model: TransferMatrix) -> dict[str, Any]:
    """Arrange a model as `scipy.io.savemat` writes it: one struct with cell arrays for every pair of output and input.

    In MATLAB (Control System Toolbox) and Octave (control package) it opens with::

        load models.mat
        G = tf(motors.num, motors.den, 'IODelay', motors.delay)
        G.InputName = motors.inputs; G.OutputName = motors.outputs;

    ``num`` and ``den`` are p x m cells of row vectors, highest power first, time in seconds; ``num_std`` and
    ``den_std`` the standard deviations of the same coefficients, NaN where there is none.
    """
    shape = (len(model.output_names), len(model.input_names))
    cells: dict[str, Any] = {
        name: np.empty(shape, dtype=object) for name in ("num", "den", "num_std", "den_std", "covariance")
    }
    delay = np.zeros(shape)
    for row, output in enumerate(model.output_names):
        for column, source in enumerate(model.input_names):
            function = model.transfer_functions[output][source]
            count = len(function.num)
            delay[row, column] = function.delay
            deviation = function.standard_deviation
            if deviation is None:
                deviation = np.full(count + len(function.den) - 1, np.nan)
            cells["num"][row, column] = function.num[None, :]
            cells["den"][row, column] = function.den[None, :]
            cells["num_std"][row, column] = deviation[None, :count]
            cells["den_std"][row, column] = np.concatenate([[0.0], deviation[count:]])[None, :]
            cells["covariance"][row, column] = (
                np.full((len(deviation), len(deviation)), np.nan)
                if function.covariance is None
                else function.covariance
            )
    return cells | {
        "delay": delay,
        "name": model.name,
        "inputs": _cell(model.input_names),
        "outputs": _cell(model.output_names),
        "units": _cell([model.units.get(name, "") for name in (*model.input_names, *model.output_names)]),
        "structure": model.structure,
        "hold": model.hold,
        "rate_hz": model.rate,
        "training": _cell(model.training),
    }


def write_mat(models: Mapping[str, TransferMatrix | Mapping[str, TransferMatrix]], path: str | Path) -> None:
    """Write models as structs of a ``.mat`` file, by name (see `matlab_struct`); a mapping becomes a struct of them.

    Names must be MATLAB's: letters, digits and underscores, a letter first.
    """
    scipy.io.savemat(path, _structs(models), long_field_names=True, oned_as="row")


def _structs(models: Mapping[str, TransferMatrix | Mapping[str, TransferMatrix]]) -> dict[str, Any]:
    wrong = [name for name in models if not (name.isascii() and name.isidentifier() and name[0].isalpha())]
    if wrong:
        raise ExportError(f"{wrong[0]!r} cannot name a variable in MATLAB; use letters, digits and underscores")
    return {
        name: _structs(model) if isinstance(model, Mapping) else matlab_struct(model) for name, model in models.items()
    }


def python_control() -> Any:
    """Return python-control; ExportError without it."""
    if find_spec("control") is None:
        raise ExportError("python-control is not installed; install it with: pip install 'rotorid[control]'")
    return control


def functions_to_control(rows: Sequence[Sequence[TransferFunction]], **named: object) -> control.TransferFunction:
    """Return transfer functions by output and input to python-control, delays as Padé approximations."""
    tool, num, den = python_control(), [], []
    for row in rows:
        late = [tool.pade(f.delay, 3 if f.delay > 0.0 else 0) for f in row]
        num.append([np.polymul(f.num, pade[0]) for f, pade in zip(row, late, strict=True)])
        den.append([np.polymul(f.den, pade[1]) for f, pade in zip(row, late, strict=True)])
    return tool.TransferFunction(num, den, **named)


def to_control(model: TransferMatrix) -> control.TransferFunction:
    """Return a model to python-control, as one system with named inputs and outputs.

    That package has no delays in continuous time; they become Padé approximations of third order.

    Raises
    ------
    ExportError
        Without python-control, the extra ``control``.
    """
    return functions_to_control(
        [[model.transfer_functions[o][i] for i in model.input_names] for o in model.output_names],
        inputs=list(model.input_names),
        outputs=list(model.output_names),
        name=re.sub(r"[\W_]", "_", model.name),  # that package takes no other characters
    )


def coefficients(model: TransferMatrix) -> pd.DataFrame:
    """Tabulate every coefficient, a row each; inputs without effect have none."""
    rows: list[dict[str, object]] = []
    for output, row in model.transfer_functions.items():
        for source, function in row.items():
            if not np.any(function.num):
                continue
            spread, relative, known = function.standard_deviation, function.relative_deviation, function.determined
            count = len(function.num)
            for part, values, first in (("num", function.num, 0), ("den", function.den, count - 1)):
                for place, value in enumerate(values):
                    k = None if spread is None or (part == "den" and place == 0) else first + place
                    rows.append(
                        {
                            "output": output,
                            "input": source,
                            "part": part,
                            "power": len(values) - 1 - place,
                            "value": float(value),
                            "std": None if k is None or spread is None else float(spread[k]),
                            "relative": None if k is None or relative is None else float(relative[k]),
                            "determined": None if k is None or known is None else bool(known[k]),
                        }
                    )
            if function.delay:
                relative_delay = function.delay_std / function.delay
                rows.append(
                    {"output": output, "input": source, "part": "delay", "power": 0, "value": function.delay}
                    | {"std": function.delay_std, "relative": relative_delay}
                    | {"determined": relative_delay < DETERMINED}
                )
    return pd.DataFrame(rows)


def _cell(texts: Any) -> Any:
    """Make a row cell array of texts: a list of them would become a padded character matrix."""
    texts = list(texts)
    cell = np.empty((1, len(texts)), dtype=object)
    cell[0, :] = texts
    return cell
