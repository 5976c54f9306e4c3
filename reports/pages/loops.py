"""A tuning as a page with sliders: margins, Bode plot and step for other gains, computed in the page, offline."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from importlib.resources import files

import jinja2
from markupsafe import Markup

from core.quantity import uncertain
from core.serialization import as_json
from reports.numbers.loops import tuning_report
from reports.views.rotation import TITLES
from sysid.loops.known_margins import MARGINS, Margins
from sysid.loops.loop import RateLoop
from sysid.loops.search import AxisTuning
from sysid.loops.tuning import Tuning


@dataclass(frozen=True, slots=True, kw_only=True)
class ShownLoop:
    """An axis of the page: its margins as a table of titles and cells, and why no gains are proposed."""

    name: str
    heads: Sequence[str]
    rows: Sequence[tuple[str, Sequence[str]]]
    #: Criteria: name, as flown, as proposed (empty without a proposal), limit, its source, pass or fail of the last.
    criteria: Sequence[Sequence[str]]
    refused: str | None


def loops_page(tuning: Tuning) -> str:
    """Render a tuning; everything that a log wrote is escaped."""
    templates = files("reports") / "templates"
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined)
    template = environment.from_string((templates / "loops.html").read_text("utf-8"))
    numbers = tuning_report(tuning)
    # "</" would end the element that holds the data.
    data = as_json(numbers, None).replace("</", "<\\/")
    return template.render(
        rotorid=version("rotorid"),
        style=Markup((templates / "style.css").read_text("utf-8")),
        script=Markup((templates / "loops.js").read_text("utf-8")),
        data=Markup(data),
        tuning=numbers,
        changes=[
            (name, *(f"{each:.6g}" for each in (tuning.rollback[name], tuning.flown[name], value)))
            for name, value in sorted(tuning.proposed.items())
        ],
        axes=[_axis(axis, axis.loop) for axis in tuning.axes if axis.loop is not None],
    )


def _axis(axis: AxisTuning, loop: RateLoop) -> ShownLoop:
    tuned = axis.tuned
    columns: list[tuple[str, Margins]] = [("as flown, computed", loop.margins)]
    if loop.measured is not None:
        columns.append(("as flown, measured by the chirp", loop.measured_margins))
    if tuned is not None:
        columns.append(("proposed", tuned.margins))
    rows = []
    for name, (unit, _) in MARGINS.items():
        rows.append((f"{TITLES[name]} ({unit})", [_cell(margins, name) for _, margins in columns]))
    return ShownLoop(
        name=axis.axis, heads=[head for head, _ in columns], rows=rows, criteria=_criteria(axis), refused=axis.refused
    )


def _criteria(axis: AxisTuning) -> list[tuple[str, ...]]:
    """Return the sheet of criteria as rows of cells."""
    promised = {one.name: one for one in axis.promises}
    rows: list[tuple[str, ...]] = []
    for flown in axis.criteria:
        proposed = promised.get(flown.name)
        sign = "≥" if flown.least else "≤"
        limit = "" if flown.limit is None else f"{sign} {flown.limit:g} {flown.value.unit}".removesuffix(" 1")
        kept = (flown if proposed is None else proposed).kept
        verdict = {True: "pass", False: "FAIL", None: ""}[kept]
        after = "" if proposed is None else str(proposed.value)
        rows.append((flown.name, str(flown.value), after, limit, flown.source, verdict))
    return rows


def _cell(margins: Margins, name: str) -> str:
    estimate = getattr(margins, name)
    if estimate.value is None:
        return f"beyond the band: {estimate.reason}"
    return uncertain(estimate.value, estimate.sigma)
