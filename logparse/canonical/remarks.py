"""What building the tables had to leave out, collected into a few findings."""

from collections import defaultdict

import numpy as np
import numpy.typing as npt

from core.findings import Finding, Severity


class Remarks:
    """Collects removed values and other remarks, and reports each kind once with its count."""

    def __init__(self) -> None:
        self._removed: defaultdict[tuple[str, str], list[int]] = defaultdict(lambda: [0, 0])
        self._findings: dict[str, Finding] = {}

    def remove(
        self, values: npt.NDArray[np.float64], impossible: npt.NDArray[np.bool_], message: str, why: str
    ) -> npt.NDArray[np.float64]:
        """Replace impossible values by NaN and count them under a message and a reason."""
        count = int(np.count_nonzero(impossible))
        if count == 0:
            return values
        self.count(message, why, count, len(impossible))
        cleaned = values.copy()
        cleaned[impossible] = np.nan
        return cleaned

    def count(self, message: str, why: str, removed: int, total: int) -> None:
        """Count samples that were removed."""
        if removed:
            tally = self._removed[message, why]
            tally[0] += removed
            tally[1] += total

    def add(self, finding: Finding) -> None:
        """Add a finding; the first with its id and reason stays."""
        self._findings.setdefault(f"{finding.id}: {finding.reason}", finding)

    def take(self, other: "Remarks") -> None:
        """Add what another has collected."""
        for (message, why), (removed, total) in other._removed.items():
            self.count(message, why, removed, total)
        for finding in other._findings.values():
            self.add(finding)

    def findings(self) -> tuple[Finding, ...]:
        """Return all remarks, removed values first."""
        removed = tuple(
            Finding(
                id="impossible-values",
                severity=Severity.WARNING if removed > 0.05 * total else Severity.INFO,
                reason=f"{message}: {why} in {removed} of {total} samples; taken as missing.",
                evidence={"message": message, "removed": removed, "samples": total},
            )
            for (message, why), (removed, total) in sorted(self._removed.items())
        )
        return removed + tuple(self._findings.values())
