"""An identified craft as files: JSON, MATLAB, simulator frame, linear hover model."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy

from core.serialization import as_json
from logparse import Finding, MissingDataError, Severity
from sysid.rigid_body.export.frame_json import frame_json
from sysid.rigid_body.export.hover import HoverModel, hover_model
from sysid.rigid_body.model import RigidBodyModel
from sysid.rigid_body.model_record import RigidBodyRecord


@dataclass(frozen=True, slots=True, kw_only=True)
class CraftRecord:
    """What craft.json holds."""

    craft: RigidBodyRecord
    hover: HoverModel | None


def write_craft(
    model: RigidBodyModel,
    folder: Path,
    mass: float | None = None,
    *,
    arm: float | None = None,
    disc_area: float | None = None,
) -> tuple[list[Path], list[Finding]]:
    """Write ``craft.json``, ``craft.mat`` and, where flight determined enough, ``sitl_frame.json`` with its notes.

    Parameters
    ----------
    model : RigidBodyModel
    folder : Path
        Made when missing.
    mass : float, optional
        kg; the model's own otherwise.
    arm, disc_area : float, optional
        As `frame_json`.

    Returns
    -------
    files : list of Path
    findings : list of Finding
        What could not be written, and why.
    """
    folder.mkdir(parents=True, exist_ok=True)
    findings: list[Finding] = []
    linear: HoverModel | None = None
    try:
        linear = hover_model(model)
    except MissingDataError as error:
        findings.append(Finding("not-determined", Severity.INFO, str(error)))
    record = CraftRecord(craft=model.record(), hover=linear)
    files = [folder / "craft.json", folder / "craft.mat"]
    files[0].write_text(as_json(record), encoding="utf-8")
    scipy.io.savemat(files[1], _for_matlab(model, linear), long_field_names=True, oned_as="column")
    try:
        frame = frame_json(model, mass, arm=arm, disc_area=disc_area)
    except MissingDataError as error:
        findings.append(Finding("not-determined", Severity.INFO, str(error)))
    else:
        path = folder / "sitl_frame.json"
        frame.write(path)
        files += [path, path.with_suffix(".md")]
    return files, findings


def _for_matlab(model: RigidBodyModel, linear: HoverModel | None) -> dict[str, object]:
    """Structures ``parameters`` (value, sigma, unit), ``covariance``, ``hover`` (A, B, trim); NaN: not determined."""
    result: dict[str, object] = {
        "parameters": {
            re.sub(r"\W", "_", name): {
                "value": np.nan if each.value is None else each.value,
                "sigma": np.nan if each.sigma is None else each.sigma,
                "used": each.used,
                "unit": each.unit,
            }
            for name, each in model.parameters.items()
        },
        "estimated": np.array(model.estimated, dtype=object),
        "covariance": model.covariance,
        "mass": np.nan if model.mass is None else model.mass,
        "reference_density": model.reference_density,
        "reference_voltage": np.nan if model.reference_voltage is None else model.reference_voltage,
    }
    if linear is not None:
        result["hover"] = {
            "A": linear.A,
            "B": linear.B,
            "eigenvalues": np.array(linear.eigenvalues),
            "trim": linear.trim,
            "input_unit": linear.input_unit,
        }
    return result
