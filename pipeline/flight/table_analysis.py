"""Tables of other origin to a model with six degrees of freedom, judged on what it has not seen."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatch
from pathlib import Path

import numpy as np

from logparse.foreign.columns import read_column_map
from logparse.foreign.motion import read_motion
from pipeline.config import AnalysisConfig
from pipeline.errors import ConfigError
from pipeline.results.tables import StateErrors, TableResult
from sysid import Experiment, fit_six_dof
from sysid.rigid_body.six_dof.model import SixDofModel
from sysid.rigid_body.six_dof.shooting import state_errors

#: Horizons that are judged, s.
HORIZONS = (0.1, 0.25, 0.5, 1.0, 2.0)

STATES = ("position", "velocity", "attitude", "rates")
UNITS = ("m", "m/s", "rad", "rad/s")

#: Error at which a prediction that runs away is held.
_WORST = 1e6

#: By how much errors must be below those of the simplest prediction to count as better.
_MARGIN = 0.1


def analyze_tables(paths: Sequence[Path], columns: Path, config: AnalysisConfig) -> TableResult:
    """Read tables, fit one model to some of them, and judge it on the others; one table is parted in time.

    Parameters
    ----------
    paths : sequence of Path
        CSV, Parquet or MATLAB files of one craft.
    columns : Path
        YAML that says which column is what (docs/tables.md).
    config : AnalysisConfig
        Its mass (over that of the YAML), training and validation names, and training fraction are used.

    Raises
    ------
    TableError
        When a table or its description is wrong.
    ConfigError
        When no table is left to fit.
    """
    declared = read_column_map(columns)
    motions = [read_motion(path, columns, path.name if len(paths) > 1 else None) for path in paths]
    records = [Experiment.from_motion(motion) for motion in motions]
    training, judged = _parted(records, config)
    mass = config.mass if config.mass is not None else declared.mass
    model = fit_six_dof(training, mass=mass, indoors=declared.indoors)
    errors = [error for record in judged for error in _errors(model, record)]
    findings = (*(finding for record in records for finding in record.findings), *model.findings)
    return TableResult(
        title=declared.name or (paths[0].name if len(paths) == 1 else f"{len(paths)} tables"),
        records=tuple(record.name for record in records),
        judged=tuple(record.name for record in judged),
        duration=float(sum(record.duration for record in records)),
        model=model,
        errors=tuple(errors),
        verdicts=tuple(_verdict(state, unit, errors) for state, unit in zip(STATES, UNITS, strict=True)),
        findings=findings,
    )


def _parted(records: Sequence[Experiment], config: AnalysisConfig) -> tuple[list[Experiment], list[Experiment]]:
    """Part into records to fit and records to judge on."""
    if len(records) == 1:
        first, rest = records[0].split(config.training_fraction)
        return [first], [rest]

    def named(record: Experiment, patterns: Sequence[str]) -> bool:
        return any(fnmatch(record.name, pattern) or fnmatch(Path(record.name).stem, pattern) for pattern in patterns)

    if config.training:
        training = [record for record in records if named(record, config.training)]
    elif config.validation:
        training = [record for record in records if not named(record, config.validation)]
    else:
        training = list(records[::2])
    judged = [record for record in records if record not in training]
    if config.validation:
        judged = [record for record in judged if named(record, config.validation)]
    if not training:
        raise ConfigError(f"no table is named {', '.join(config.training)}: nothing to fit")
    if not judged:
        raise ConfigError("every table trains: none is left to judge the model on")
    return training, judged


def _errors(model: SixDofModel, experiment: Experiment) -> list[StateErrors]:
    """RMS errors of every state at every horizon that fits into the record."""
    record = model.record(experiment)
    marks = [max(round(horizon / record.dt), 1) for horizon in HORIZONS]
    marks = sorted({mark for mark in marks if mark < len(record.t) // 2})
    if not marks:
        return []
    every = max(len(record.t) // 2000, 1)
    starts = np.arange(0, len(record.t) - marks[-1], every)
    predicted = model.ahead(record, starts, np.array(marks))
    out: list[StateErrors] = []
    for k, mark in enumerate(marks):
        truth = record.states[starts + mark]
        ours = _rms(state_errors(predicted[:, k], truth))
        held = _rms(state_errors(record.states[starts], truth))
        moved = record.states[starts].copy()
        moved[:, :3] += mark * record.dt * moved[:, 3:6]
        carried = _rms(state_errors(moved, truth))
        out += [
            StateErrors(
                record=experiment.name,
                horizon=float(mark * record.dt),
                state=state,
                model=ours[at],
                held=held[at],
                carried_on=carried[at] if state == "position" else None,
            )
            for at, state in enumerate(STATES)
        ]
    return out


def _rms(errors: np.ndarray) -> list[float]:
    # A model that runs away is as bad as the largest number that can be written.
    held = np.nan_to_num(np.clip(errors, -_WORST, _WORST), nan=_WORST)
    squares = (held.reshape(len(errors), 4, 3) ** 2).sum(axis=2).mean(axis=0)
    return [float(value) for value in np.sqrt(squares)]


def _verdict(state: str, unit: str, errors: Sequence[StateErrors]) -> str:
    """Explain how far ahead a state is predicted better than by the simplest means."""
    rows = [each for each in errors if each.state == state]
    if not rows:
        return f"{state}: not judged, the records are too short"
    better = []
    for horizon in sorted({row.horizon for row in rows}):
        here = [row for row in rows if row.horizon == horizon]
        ours = float(np.mean([row.model for row in here]))
        simple = float(np.mean([min(row.held, row.carried_on or row.held) for row in here]))
        better.append((horizon, ours, simple, ours < (1.0 - _MARGIN) * simple))
    good = [row for row in better if row[3]]
    if not good:
        horizon, ours, simple, _ = better[-1]
        against = f"against {simple:.3g} {unit} without a model"
        return f"{state}: do not use it: {ours:.3g} {unit} {horizon:g} s ahead, {against}"
    horizon, ours, simple, _ = good[-1]
    return f"{state}: {ours:.3g} {unit} {horizon:g} s ahead, against {simple:.3g} {unit} without a model"
