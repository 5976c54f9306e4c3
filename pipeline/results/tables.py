"""What comes of tables of other origin: the model, its errors by horizon, and what they mean."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from logparse import Finding
from pipeline.results.answer import Answer
from sysid.rigid_body.six_dof.model import SixDofModel, SixDofReport
from sysid.validation.states import Missed, PredictedStates, StateErrors, StateVerdict


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


@dataclass(frozen=True, slots=True, kw_only=True)
class TableResult:
    """What comes of tables: the report, and what its page draws beside it."""

    report: TablesReport
    model: SixDofModel
    prediction: PredictedStates | None  #: The longest record that the model has not seen, one second ahead.
