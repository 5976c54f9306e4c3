"""What comes of tables of other origin: the model, its errors by horizon, and what they mean."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from logparse import Finding
from sysid.rigid_body.six_dof.model import SixDofModel


@dataclass(frozen=True, slots=True, kw_only=True)
class StateErrors:
    """Errors of predictions to one horizon on one record, RMS of norms.

    Attributes
    ----------
    record : str
    horizon : float
        s.
    state : str
        ``position`` [m], ``velocity`` [m/s], ``attitude`` [rad], ``rates`` [rad/s].
    model, held : float
        Of the model, and of the state that stays.
    carried_on : float or None
        Of constant velocity, for position; of constant rates, for attitude.
    """

    record: str
    horizon: float
    state: str
    model: float
    held: float
    carried_on: float | None

    def to_dict(self) -> dict[str, Any]:
        """Return numbers for JSON."""
        return {name: getattr(self, name) for name in self.__slots__}


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
