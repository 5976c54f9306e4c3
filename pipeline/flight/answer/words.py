"""Words that several lines of the answer share."""

from __future__ import annotations

import re

from pipeline.results.failure import Failure
from pipeline.results.flight import FlightResult
from sysid.rotors.thrust_regression import THRUST_CHANGED

#: Words of a reason that a line has room for.
_BRIEF = 12


def brief(reason: str) -> str:
    """Return the first clause of a reason, cut to what a line has room for; the whole stands further down.

    It follows a word in the line, and begins with a small letter as that does.
    """
    clause = re.split(r"[:;(]|\. ", reason, maxsplit=1)[0].strip().rstrip(".")
    clause = re.sub(r"^(The|A|An|No|Only|It|There|Nothing|Too) ", lambda found: found[0].lower(), clause)
    words = clause.split()
    return clause if len(words) <= _BRIEF else " ".join(words[:_BRIEF]) + " …"


def changed_load(result: FlightResult) -> str:
    """Describe from when on the same commands gave another thrust per mass; empty when they did not."""
    findings = () if isinstance(result.thrust, Failure) else result.thrust.findings
    evidence = next((finding.evidence for finding in findings if finding.id == THRUST_CHANGED), None)
    if evidence is None:
        return ""
    change, time = (float(evidence[name] or 0.0) for name in ("change", "time"))
    return f"thrust/mass changed by {100.0 * change:+.0f} % at {time:.0f} s"
