"""What comes of tables of other origin: the model, its errors by horizon, and what they mean."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from logparse import Finding
from pipeline.results.answer import Answer
from sysid.rigid_body.six_dof.model import SixDofModel, SixDofReport
from sysid.validation.states import Missed, PredictedStates, StateErrors, StateVerdict


@dataclass(frozen=True, slots=True, kw_only=True)
class TableResult:
    """Analysis of one or several tables of one craft."""

    title: str
    records: tuple[str, ...]
    judged: tuple[str, ...]  #: Records, or parts of one, that the model has not seen.
    duration: float  #: Of all records, s.
    model: SixDofModel
    answer: Answer
    errors: tuple[StateErrors, ...]  #: On what the model has not seen.
    verdicts: tuple[StateVerdict, ...]  #: One for each state.
    missed: tuple[Missed, ...]  #: Accelerations that the model leaves over there.
    prediction: PredictedStates | None  #: The longest record that the model has not seen, one second ahead.
    findings: tuple[Finding, ...]

    def report(self) -> TablesReport:
        """Return what report.json holds."""
        return TablesReport(
            title=self.title,
            records=self.records,
            judged=self.judged,
            duration=self.duration,
            answer=self.answer,
            verdicts=self.verdicts,
            errors=self.errors,
            missed=self.missed,
            model=self.model.report(),
            findings=self.findings,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class TablesReport:
    """What report.json holds of an analysis of tables, see `TableResult`."""

    kind: Literal["tables"] = "tables"
    title: str
    records: tuple[str, ...]
    judged: tuple[str, ...]
    duration: float
    answer: Answer
    verdicts: tuple[StateVerdict, ...]
    errors: tuple[StateErrors, ...]
    missed: tuple[Missed, ...]
    model: SixDofReport
    findings: tuple[Finding, ...]
