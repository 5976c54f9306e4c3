"""The page on all flights: the answer first, then every craft, then flights and logs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol

from reports import fleet_views, html, summary
from reports.coverage_figures import coverage_figures
from reports.craft_views import craft
from reports.drift_figures import drift_figures
from reports.figure import Figure
from reports.model_figures import horizon_figure
from reports.rows import Numbers

View = dict[str, Any]

#: Tables of more flights are folded.
MOST_UNFOLDED = 24


class Craft(Protocol):
    """Numbers of a craft, and plots that only its models could give."""

    @property
    def numbers(self) -> Numbers:
        """What its report.json holds."""
        ...

    @property
    def responses(self) -> Mapping[str, Mapping[str, list[Figure]]]:
        """Frequency responses, poles and zeros by kind of model and output."""
        ...

    @property
    def predictions(self) -> Mapping[str, Figure]:
        """Measured and predicted position by flight."""
        ...


def fleet_page(numbers: Numbers, crafts: Sequence[Craft]) -> str:
    """Render the page.

    Parameters
    ----------
    numbers : dict
        Of the fleet.
    crafts : sequence of Craft
        In the order of the numbers.
    """
    pages = fleet_views.links(numbers["flights"])
    figures: list[Figure] = []
    views = []
    for place, each in enumerate(crafts, start=1):
        view = craft(each.numbers, pages) | {"id": f"craft-{place}"}
        figures += _draw(view, each, f"{place}-", pages)
        views.append(view)
    serious, notes = fleet_views.common_findings(numbers)
    return html.render(
        "fleet.html",
        figures,
        numbers=numbers,
        title=fleet_views.title(numbers),
        facts=fleet_views.facts(numbers),
        crafts=views,
        alone=([fleet_views.ALONE] if numbers["flights"] else []),
        endangered=fleet_views.endangered(numbers),
        own_models=fleet_views.own_models(numbers),
        health=fleet_views.health_table(numbers),
        flights=fleet_views.flight_rows(numbers, pages),
        unfolded=len(numbers["flights"]) <= MOST_UNFOLDED,
        serious=serious,
        notes=notes,
        failures=[(each["file"], summary.sentence(each["reason"])) for each in numbers["failures"]],
        left_out=summary.left_out(numbers),
        unused=[(each["file"], summary.sentence(each["reason"])) for key in summary.LEFT_OUT for each in numbers[key]],
        config=[
            (name.replace("_", " "), "not given" if value is None else str(value))
            for name, value in numbers["config"].items()
        ],
    )


def _draw(view: View, craft: Craft, prefix: str, pages: Mapping[str, str]) -> list[Figure]:
    """Put every plot of a craft where it belongs, and give them all for the page."""
    ahead = horizon_figure(craft.numbers["models"], f"{prefix}horizons")
    covered = coverage_figures(craft.numbers["coverage"], prefix)
    courses, folded = drift_figures(craft.numbers["drift"], prefix)
    place = f"{prefix}prediction"
    flown = {
        flight: replace(figure, id=f"{place}-{number}", place=place, time=False)
        for number, (flight, figure) in enumerate(craft.predictions.items())
    }
    view |= {"ahead": ahead, "covered": covered, "courses": courses, "courses_folded": folded}
    view["prediction"] = _choice(place, flown, craft.numbers, pages)
    responses = {
        key: {
            output: [replace(figure, id=prefix + figure.id) for figure in figures]
            for output, figures in outputs.items()
        }
        for key, outputs in craft.responses.items()
    }
    attached = html.attach(view["models"], responses)
    return [*([ahead] if ahead else []), *flown.values(), *covered, *courses, *folded, *attached]


def _choice(place: str, figures: Mapping[str, Figure], numbers: Numbers, pages: Mapping[str, str]) -> View | None:
    """Offer the flights to choose from, those that judge first."""
    if not figures:
        return None
    parts = [
        (label, [(figures[name].id, name, pages.get(name, "")) for name in numbers[key] if name in figures])
        for key, label in (("held_out", "judge the models"), ("training", "fitted"))
    ]
    first = next(iter(figures.values()))
    return {
        "place": place,
        "parts": [(label, options) for label, options in parts if options],
        "caption": first.caption,
        "height": first.height,
        "page": next(options[0][2] for _, options in parts if options),
    }
