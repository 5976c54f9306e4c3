"""A tuning as a page with sliders: margins, Bode plot and step for other gains, computed in the page, offline."""

from __future__ import annotations

from importlib.resources import files

from markupsafe import Markup

from core.quantity import uncertain
from core.serialization import plain
from core.table import Row, Table
from reports.pages.html import render, script_json
from reports.views.rotation import TITLES
from sysid.loops.known_margins import MARGINS, Margins
from sysid.loops.report import AxisReport, TuningReport


def loops_page(tuning: TuningReport) -> str:
    """Render a tuning."""
    changed = [
        Row(name, [f"{number:.6g}" for number in (tuning.rollback[name], tuning.flown[name], value)])
        for name, value in sorted(tuning.proposed.items())
    ]
    return render(
        "loops.html",
        [],
        data=script_json(plain(tuning)),
        sliders=Markup((files("reports") / "templates" / "loops.js").read_text("utf-8")),
        tuning=tuning,
        changes=Table("Parameter", ["before", "during the chirps", "proposed"], changed),
        axes=[(axis, _margins(axis), _criteria(axis)) for axis in tuning.axes if axis.flown is not None],
    )


def _margins(axis: AxisReport) -> Table:
    columns = {
        "as flown, computed": None if axis.flown is None else axis.flown.margins,
        "as flown, measured by the chirp": axis.measured_margins,
        "proposed": None if axis.tuned is None else axis.tuned.margins,
    }
    known = {head: margins for head, margins in columns.items() if margins is not None}
    rows = [
        Row(f"{TITLES[name]} ({unit})", [_cell(margins, name) for margins in known.values()])
        for name, (unit, _) in MARGINS.items()
    ]
    return Table("Loop broken at the mixer", list(known), rows, texts=range(len(known)))


def _criteria(axis: AxisReport) -> Table:
    """Return the sheet of criteria; what is proposed is empty without a proposal."""
    promised = {one.name: one for one in axis.promises}
    rows = []
    for flown in axis.criteria:
        proposed = promised.get(flown.name)
        sign = "≥" if flown.least else "≤"
        limit = "" if flown.limit is None else f"{sign} {flown.limit:g} {flown.value.unit}".removesuffix(" 1")
        kept = (flown if proposed is None else proposed).kept
        verdict = {True: "pass", False: "FAIL", None: ""}[kept]
        after = "" if proposed is None else str(proposed.value)
        rows.append(Row(flown.name, [str(flown.value), after, limit, flown.source, verdict]))
    heads = ["as flown, measured", "as proposed, predicted", "limit", "source", ""]
    return Table("Criterion", heads, rows, texts=range(len(heads)))


def _cell(margins: Margins, name: str) -> str:
    estimate = getattr(margins, name)
    if estimate.value is None:
        return f"beyond the band: {estimate.reason}"
    return uncertain(estimate.value, estimate.sigma)
