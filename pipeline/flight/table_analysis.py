"""Tables of other origin to a model with six degrees of freedom, judged on what it has not seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path
from typing import Literal

from core.quantity import counted
from logparse import Finding, Severity
from logparse.foreign.columns import read_column_map
from logparse.foreign.motion import read_motion
from pipeline.config import AnalysisConfig, ConfigError
from pipeline.results.answer import Answer, AnswerLine, Picture, Tone
from sysid import Experiment, choose_observer, fit_six_dof, validate_states
from sysid.rigid_body.model_record import BodyParameter
from sysid.rigid_body.six_dof.fit import FASTEST
from sysid.rigid_body.six_dof.model import SixDofModel, SixDofReport
from sysid.validation.states import Missed, PredictedStates, StateErrors, StateVerdict, missed_motion, predict_record

#: How far ahead the observer is chosen for and the prediction is shown, s.
AHEAD = 1.0


def analyze_tables(paths: Sequence[Path], columns: Path, config: AnalysisConfig) -> TableResult:
    """Read tables, fit one model to some of them, and judge it on the others; one table is parted in time.

    TableError where a table or its description is wrong, ConfigError where no table is left to fit.
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
    report = TablesReport(
        title=declared.name or (paths[0].name if len(paths) == 1 else f"{len(paths)} tables"),
        records=tuple(record.name for record in records),
        judged=tuple(record.name for record in judged),
        duration=float(sum(record.duration for record in records)),
        answer=table_answer(validation.verdicts, model, findings),
        verdicts=validation.verdicts,
        errors=validation.errors,
        missed=missed_motion(model, judged),
        model=model.report(),
        findings=findings,
    )
    longest = max(judged, key=lambda record: record.duration)
    return TableResult(report=report, model=model, prediction=predict_record(model, longest, AHEAD))


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


#: What is asked of the craft, and the parameters that answer.
_ASKED = (
    ("Thrust", ("thrust",)),
    ("Turning", ("roll_gain", "pitch_gain")),
    ("Drag", ("drag_rotor_x", "drag_quadratic_x")),
)


def table_answer(verdicts: Sequence[StateVerdict], model: SixDofModel, findings: Sequence[Finding]) -> Answer:
    """Answer for each state, for what a craft is asked first, and for the tables themselves."""
    lines = [_ahead(verdict) for verdict in verdicts]
    lines += [
        _known(asked, [model.parameters[name] for name in names], bool(model.kinds.motors)) for asked, names in _ASKED
    ]
    return Answer(lines=(*lines, _checked(findings)), picture=Picture.PREDICTION)


def _ahead(verdict: StateVerdict) -> AnswerLine:
    purpose = f"Predict {verdict.state}"
    if verdict.horizon is None or verdict.model is None or verdict.simple is None:
        return AnswerLine(purpose=purpose, word="not judged", tone=Tone.UNKNOWN, text="the records are too short")
    text = f"{verdict.model:.2g} {verdict.unit}; without a model {verdict.simple:.2g}"
    if not verdict.useful:
        return AnswerLine(purpose=purpose, word="no", tone=Tone.BAD, text=f"{verdict.horizon:g} s ahead {text}")
    return AnswerLine(purpose=purpose, word=f"{verdict.horizon:g} s ahead", tone=Tone.GOOD, text=text)


def _known(asked: str, parameters: Sequence[BodyParameter], motors: bool) -> AnswerLine:
    """Answer with the first parameter that is determined, in SI where it is known; `motors` are single ones."""
    for parameter in parameters:
        for value, sigma, unit in (
            (parameter.si_value, parameter.si_sigma, parameter.si_unit),
            (parameter.value, parameter.sigma, parameter.unit),
        ):
            if value is not None and sigma is not None:
                bare, _, condition = unit.replace("^2", "²").partition(" at ")
                # Motion alone knows forces by the mass only, and turning by the inertia: accelerations.
                mass = "over mass, " if parameter.name not in ("roll_gain", "pitch_gain") and bare[0] != "N" else ""
                text = f"{mass}{_spoken(parameter.name, motors)} {f'at {condition}' if condition else ''}".strip()
                return AnswerLine(
                    purpose=asked, word="known", tone=Tone.GOOD, text=text, value=value, sigma=sigma, unit=bare
                )
    return AnswerLine(purpose=asked, word="not determined", tone=Tone.UNKNOWN, text=parameters[0].reason)


def _spoken(name: str, motors: bool) -> str:
    """Name a parameter beside its number."""
    if name == "thrust":
        return "of each rotor" if motors else "in all"
    return {"roll_gain": "in roll", "pitch_gain": "in pitch"}.get(name, "forward")


def _checked(findings: Sequence[Finding]) -> AnswerLine:
    grave = [finding for finding in findings if finding.severity is not Severity.INFO]
    if not grave:
        return AnswerLine(purpose="Tables", word="consistent", tone=Tone.GOOD, text="no column contradicts another")
    errors = any(finding.severity is Severity.ERROR for finding in grave)
    tone = Tone.BAD if errors else Tone.CARE
    text = f"{counted(len(grave), 'finding')} below, first: {grave[0].reason}"
    return AnswerLine(purpose="Tables", word="see findings", tone=tone, text=text)


@dataclass(frozen=True, slots=True, kw_only=True)
class TablesReport:
    """Analysis of one or several tables of one craft: what report.json holds."""

    kind: Literal["tables"] = "tables"
    title: str
    records: tuple[str, ...]
    judged: tuple[str, ...]  #: Records, or parts of one, that the model has not seen.
    duration: float  #: Of all records, s.
    answer: Answer
    verdicts: tuple[StateVerdict, ...]  #: One for each state.
    errors: tuple[StateErrors, ...]  #: On what the model has not seen.
    missed: tuple[Missed, ...]  #: Accelerations that the model leaves over there.
    model: SixDofReport
    findings: tuple[Finding, ...]

    @property
    def horizons(self) -> tuple[float, ...]:
        """How far ahead it was judged, s."""
        return tuple(sorted({error.horizon for error in self.errors}))

    def mean(self, state: str, horizon: float, which: str) -> float | None:
        """Return the mean over records of the errors of the model, or of one of the guesses without it."""
        values = [getattr(error, which) for error in self.errors if error.state == state and error.horizon == horizon]
        known = [float(value) for value in values if value is not None]
        return sum(known) / len(known) if known else None


@dataclass(frozen=True, slots=True, kw_only=True)
class TableResult:
    """What comes of tables: the report, and what its page draws beside it."""

    report: TablesReport
    model: SixDofModel
    prediction: PredictedStates | None  #: The longest record that the model has not seen, one second ahead.
