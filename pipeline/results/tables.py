"""What comes of tables of other origin: the model, its errors by horizon, and what they mean."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from logparse import Finding
from sysid.rigid_body.six_dof.model import SixDofModel
from sysid.validation.states import StateErrors


@dataclass(frozen=True, slots=True, kw_only=True)
class TableResult:
    """Analysis of one or several tables of one craft.

    Attributes
    ----------
    title : str
    records : tuple of str
    judged : tuple of str
        Records, or parts of one, that the model has not seen.
    duration : float
        Of all records, s.
    model : SixDofModel
    errors : tuple of StateErrors
        On what the model has not seen.
    verdicts : tuple of str
        One sentence for each state.
    findings : tuple of Finding
    """

    title: str
    records: tuple[str, ...]
    judged: tuple[str, ...]
    duration: float
    model: SixDofModel
    errors: tuple[StateErrors, ...]
    verdicts: tuple[str, ...]
    findings: tuple[Finding, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return numbers and text for JSON."""
        return {
            "kind": "tables",
            "title": self.title,
            "records": list(self.records),
            "judged": list(self.judged),
            "duration": self.duration,
            "verdicts": list(self.verdicts),
            "errors": [each.to_dict() for each in self.errors],
            "model": self.model.to_dict(),
            "findings": [finding.to_dict() for finding in self.findings],
        }
