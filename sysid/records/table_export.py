"""An experiment as a table, with the YAML of what its columns are: the form that `Experiment.from_table` reads."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import yaml

from logparse import MissingDataError
from sysid.records.experiment import Experiment

#: Columns of motion, which the context of an experiment has.
_ANGLES = ("roll", "pitch", "yaw")


def write_table(record: Experiment, path: str | Path, mass: float | None = None) -> tuple[Path, Path]:
    """Write motion and inputs of an experiment as a table, and what its columns are beside it.

    Parameters
    ----------
    record : Experiment
        Inputs: motors ``m1 ...`` of a known frame, and any others; outputs x, y, z; context with attitude and rates.
    path : str or Path
        ``.parquet`` or ``.csv``; the description has the same name and ends in ``.yaml``.
    mass : float, optional
        kg; put into the description.

    Returns
    -------
    tuple of Path
        Table and description.

    Raises
    ------
    MissingDataError
        When motors, their places, position or attitude are missing.
    """
    path = Path(path)
    known = {f"m{motor.number}": motor for motor in (record.vehicle.motors if record.vehicle is not None else ())}
    motors = [name for name in record.input_names if name in known]
    context = record.context
    if not motors or record.vehicle is None:
        raise MissingDataError(f"{record.name}: a table of motion needs motors whose places are known")
    if record.output_names[:3] != ("x", "y", "z") or context is None or not set(_ANGLES) <= set(context.columns):
        raise MissingDataError(f"{record.name}: a table of motion needs position and attitude")
    frame = pd.DataFrame({"t": record.t})
    frame[["north", "east", "down"]] = record.y[:, :3] * np.array([1.0, 1.0, -1.0])
    described: dict[str, object] = {
        "name": record.name,
        "time": "t",
        "frame": {"world": "NED", "body": "FRD"},
        "position": ["north", "east", "down"],
        "attitude": {"columns": list(_ANGLES), "kind": "angles", "unit": "rad"},
    }
    frame[list(_ANGLES)] = context[list(_ANGLES)].to_numpy()
    for key, names in (("velocity", ("v_n", "v_e", "v_d")), ("rates", ("w_x", "w_y", "w_z"))):
        if set(names) <= set(context.columns) and context[list(names)].notna().all(axis=None):
            frame[list(names)] = context[list(names)].to_numpy()
            described[key] = list(names)
    if "voltage" in context and context["voltage"].notna().all():
        frame["voltage"] = context["voltage"].to_numpy()
        described["voltage"] = "voltage"
    frame[list(record.input_names)] = record.u
    units = {record.units.get(name, "") for name in motors}
    vehicle = record.vehicle
    width = vehicle.pwm_max - vehicle.pwm_min
    described["motors"] = {
        "columns": motors,
        "quantity": {"us": "pwm", "rad/s": "rad/s"}.get(units.pop() if len(units) == 1 else "", "command"),
        "pwm": [float(vehicle.pwm_min + spin * width) for spin in (vehicle.spin_min, vehicle.spin_max)],
        "places": [
            [
                round(float(np.cos(known[name].angle)), 6),
                round(float(np.sin(known[name].angle)), 6),
                {1: "cw", -1: "ccw"}.get(known[name].spin, "none"),
            ]
            for name in motors
        ],
    }
    if others := [name for name in record.input_names if name not in known]:
        described["inputs"] = {name: name for name in others}
    if mass is not None:
        described["mass"] = mass
    if path.suffix == ".parquet":
        frame.to_parquet(path, index=False)
    else:
        frame.to_csv(path, index=False)
    description = path.with_suffix(".yaml")
    description.write_text(yaml.safe_dump(described, sort_keys=False, allow_unicode=True), encoding="utf-8")
    return path, description
