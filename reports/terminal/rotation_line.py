"""How a craft turns, in one line, from a report and without the packages that made it."""

from __future__ import annotations

from logparse.quantity import joined, uncertain
from pipeline.results.rotation_report import RotationReport


def rotation_line(rotation: RotationReport | None) -> str:
    """Sum up in a line what a flight tells of how its craft turns; empty where nothing."""
    if rotation is None:
        return ""
    known = [axis.axis for axis in rotation.axes if axis.determined]
    parts = ["determined in " + joined(known)] if known else []
    for axis in rotation.axes:
        if axis.loop is not None:
            margins = axis.loop.computed
            told = [
                f"{title} {uncertain(each.value, each.sigma, each.unit)}"
                for title, each in (("gain margin", margins.gain_db), ("phase margin", margins.phase_deg))
                if each.value is not None
            ]
            parts.append(f"{axis.axis} loop {axis.loop.state}" + (f" ({', '.join(told)})" if told else ""))
    return f"How it turns: {'; '.join(parts)}." if parts else ""
