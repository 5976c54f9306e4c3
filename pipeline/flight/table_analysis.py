"""Tables of other origin to a model with six degrees of freedom, judged on what it has not seen."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatch
from pathlib import Path

from logparse.foreign.columns import read_column_map
from logparse.foreign.motion import read_motion
from pipeline.config import AnalysisConfig
from pipeline.errors import ConfigError
from pipeline.flight.table_answer import table_answer
from pipeline.results.tables import TableResult
from sysid import Experiment, choose_observer, fit_six_dof, validate_states
from sysid.rigid_body.six_dof.fit import FASTEST
from sysid.validation.states import missed_motion, predict_record

#: How far ahead the observer is chosen for and the prediction is shown, s.
AHEAD = 1.0


def analyze_tables(paths: Sequence[Path], columns: Path, config: AnalysisConfig) -> TableResult:
    """Read tables, fit one model to some of them, and judge it on the others; one table is parted in time.

    Raises
    ------
    TableError
        When a table or its description is wrong.
    ConfigError
        When no table is left to fit.
    """
    declared = read_column_map(columns)
    motions = [read_motion(path, columns, path.name if len(paths) > 1 else None) for path in paths]
    records = [Experiment.from_motion(motion).at_most(FASTEST) for motion in motions]
    training, judged = _parted(records, config)
    mass = config.mass if config.mass is not None else declared.mass
    model = fit_six_dof(training, mass=mass, indoors=declared.indoors)
    if max(record.duration for record in training) > 2.0 * AHEAD:
        model = choose_observer(model, training, AHEAD)
    if len(records) == 1:
        model = model.with_rest(training[0], judged[0])
    validation = validate_states(model, judged)
    findings = (*(finding for record in records for finding in record.findings), *model.findings)
    return TableResult(
        title=declared.name or (paths[0].name if len(paths) == 1 else f"{len(paths)} tables"),
        records=tuple(record.name for record in records),
        judged=tuple(record.name for record in judged),
        duration=float(sum(record.duration for record in records)),
        model=model,
        answer=table_answer(validation.verdicts, model, findings),
        errors=validation.errors,
        verdicts=validation.verdicts,
        missed=missed_motion(model, judged),
        prediction=predict_record(model, max(judged, key=lambda record: record.duration), AHEAD),
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
