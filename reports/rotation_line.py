"""How a craft turns, in one line, from a report's numbers and without the packages that made them."""

from __future__ import annotations

from logparse.quantity import uncertain
from reports.rows import Numbers


def rotation_line(rotation: Numbers | None) -> str:
    """Sum up in a line what a flight tells of how its craft turns; empty where nothing."""
    if rotation is None:
        return ""
    known = [axis["axis"] for axis in rotation["axes"] if axis["determined"]]
    parts = ["determined in " + " and ".join(known)] if known else []
    for axis in rotation["axes"]:
        if axis["loop"] is not None:
            gain, phase = (axis["loop"]["computed"][name] for name in ("gain_db", "phase_deg"))
            told = [
                f"{title} {uncertain(each['value'], each['sigma'], each['unit'])}"
                for title, each in (("gain margin", gain), ("phase margin", phase))
                if each["value"] is not None
            ]
            parts.append(f"{axis['axis']} loop {axis['loop']['state']}" + (f" ({', '.join(told)})" if told else ""))
    return f"How it turns: {'; '.join(parts)}." if parts else ""
