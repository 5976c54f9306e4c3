"""Plots of what a craft's flights covered: where models were fitted, where they were judged, and in which wind."""

from __future__ import annotations

import math
from collections.abc import Sequence

from core.quantity import per_degree
from pipeline.results.envelope import Envelope, FlightWind, RangeFlown
from reports.figures.figure import Drawn, Figure, Trace, layout_of, plotly_text

#: Parts of the flights and how they are drawn, the same in every plot.
PARTS = (("training", "fitted", "@fitted"), ("held_out", "judged", "@judged"))
#: Least seconds that the colour of a cell tells apart.
_LEAST = 0.1


def coverage_figures(coverage: Envelope | None, prefix: str) -> list[Figure]:
    """Draw map, distributions and winds of a craft; what was not measured is left out.

    Parameters
    ----------
    coverage : Envelope or None
    prefix : str
        Of the figures' ids, unique in the page.
    """
    if coverage is None:
        return []
    drawn = (
        speed_and_height(coverage, f"{prefix}cover"),
        distributions(coverage, f"{prefix}spread"),
        winds(coverage, f"{prefix}winds"),
    )
    return [figure for figure in drawn if figure is not None]


def speed_and_height(coverage: Envelope, name: str) -> Figure | None:
    """Draw the seconds flown at each speed and height: tinted where fitted, circles where judged."""
    cells, quantities = coverage.map, coverage.quantities
    if not cells.training and not cells.held_out:
        return None
    steps = cells.x_step, cells.y_step
    data: list[Trace] = []
    if cells.training:
        columns = range(min(c[0] for c in cells.training), max(c[0] for c in cells.training) + 1)
        rows = range(min(c[1] for c in cells.training), max(c[1] for c in cells.training) + 1)
        seconds = {(i, j): value for i, j, value in cells.training}
        z = [[_log(seconds.get((i, j))) for i in columns] for j in rows]
        known = [value for row in z for value in row if value is not None]
        ticks = list(range(math.floor(min(known)), math.ceil(max(known)) + 1))
        data.append(
            {
                "type": "heatmap",
                "x": [(i + 0.5) * steps[0] for i in columns],
                "y": [(j + 0.5) * steps[1] for j in rows],
                "z": z,
                "zmin": ticks[0] - 0.5,
                "zmax": max(ticks[-1], ticks[0] + 1),
                "colorscale": [[0, "@paper"], [1, "@fitted"]],
                "xgap": 1,
                "ygap": 1,
                "name": "fitted",
                "customdata": [[_short(seconds.get((i, j))) for i in columns] for j in rows],
                "hovertemplate": "%{x} m/s, %{y} m: %{customdata} s<extra>fitted</extra>",
                "colorbar": {
                    "title": {"text": "fitted (s)", "side": "top"},
                    "tickvals": ticks,
                    "ticktext": [f"{10.0**tick:g}" for tick in ticks],
                    "thickness": 12,
                    "outlinewidth": 0,
                },
            }
        )
    if cells.held_out:
        data.append(
            {
                "type": "scatter",
                "mode": "markers",
                "x": [(i + 0.5) * steps[0] for i, _, _ in cells.held_out],
                "y": [(j + 0.5) * steps[1] for _, j, _ in cells.held_out],
                "customdata": [_short(value) for _, _, value in cells.held_out],
                "name": "judged",
                "marker": {
                    "symbol": "circle-open",
                    "size": [
                        round(4.0 + 4.0 * max(math.log10(value / _LEAST), 0.0), 1) for *_, value in cells.held_out
                    ],
                    "color": "@judged",
                    "line": {"width": 2},
                },
                "hovertemplate": "%{x} m/s, %{y} m: %{customdata} s<extra>judged</extra>",
            }
        )
    axes = [quantities.get(axis) for axis in (cells.x, cells.y)]
    layout = layout_of(
        xaxis={"title": {"text": _title(axes[0], "ground speed (m/s)")}, "zeroline": False},
        yaxis={"title": {"text": _title(axes[1], "height (m)")}, "zeroline": False},
        showlegend=True,
    )
    caption = (
        "Where the craft has been: each cell is tinted by the time that flights fitted to spent there, each circle "
        "grows with the time of flights that judge. A circle on bare paper is judged outside of what was fitted."
    )
    return Figure(name, caption, data, layout, 400, time=False)


def distributions(coverage: Envelope, name: str) -> Figure | None:
    """Draw how much time was spent at which values, one small plot for each quantity, fitted over judged."""
    quantities = [each for each in coverage.quantities.values() if any(each.training) or any(each.held_out)]
    if not quantities:
        return None
    data: list[Trace] = []
    axes: Drawn = {}
    rows = math.ceil(len(quantities) / 2)
    for place, each in enumerate(quantities):
        suffix = "" if place == 0 else str(place + 1)
        row, column = divmod(place, 2)
        degrees, unit = per_degree(each.unit)
        for part, word, color in PARTS:
            total = sum(getattr(each, part)) or 1.0
            edges = [(each.first + k) * each.step * degrees for k in range(len(getattr(each, part)) + 1)]
            shares = [100.0 * value / total for value in getattr(each, part)]
            if not any(shares):
                continue
            fitted = part == "training"
            data.append(
                {
                    "type": "scatter",
                    "mode": "lines",
                    "x": [_short(edge) for edge in (edges[0], *edges)],
                    "y": [0.0, *(round(share, 2) for share in shares), 0.0],
                    "line": {"color": color, "width": 1.0 if fitted else 2.0, "shape": "hv"},
                    "name": word,
                    "legendgroup": word,
                    "showlegend": place == 0,
                    "xaxis": f"x{suffix}",
                    "yaxis": f"y{suffix}",
                    "hovertemplate": f"from %{{x:.3g}} {unit}: %{{y:.0f}} % of the time<extra>{word}</extra>",
                }
                | ({"fill": "tozeroy", "fillcolor": color, "opacity": 0.55} if fitted else {})
            )
        top = 1.0 - row / rows
        axes[f"xaxis{suffix}"] = {
            "domain": [0.0, 0.47] if column == 0 else [0.53, 1.0],
            "anchor": f"y{suffix}",
            "title": {"text": f"{each.title} ({unit})", "standoff": 4, "font": {"size": 11}},
            "zeroline": False,
            "nticks": 6,
        }
        axes[f"yaxis{suffix}"] = {
            "domain": [top - 0.62 / rows, top - 0.04 / rows],
            "anchor": f"x{suffix}",
            "showticklabels": False,
            "rangemode": "tozero",
            "showgrid": False,
        }
    layout = layout_of(**axes)
    layout["margin"] = layout["margin"] | {"l": 14}
    caption = (
        "How the time in the air was spent, fitted (filled) and judged (line). Where the line leaves the filled shape, "
        "the models are judged on flying that they were not fitted to."
    )
    return Figure(name, caption, data, layout, 70 + 125 * rows, time=False)


def winds(coverage: Envelope, name: str) -> Figure | None:
    """Draw the mean wind of each flight as a point in the direction that it came from."""
    known = [each for each in coverage.winds if each.speed is not None]
    if not known:
        return None
    data = [
        trace
        for part, word, color in PARTS
        if (trace := _winds_of(known, part.replace("_", "-"), word, color)) is not None
    ]
    reach = 1.15 * max(max(each.speed + (each.sigma or 0.0) for each in known), 1.0)
    layout = layout_of(
        xaxis={"title": {"text": "wind from the east (m/s)"}, "range": [-reach, reach], "zeroline": True},
        yaxis={
            "title": {"text": "wind from the north (m/s)"},
            "range": [-reach, reach],
            "zeroline": True,
            "scaleanchor": "x",
            "scaleratio": 1,
        },
    )
    caption = (
        "The mean wind of each flight, as the rigid body explains the tilt: a point lies where the wind came from, as "
        "far out as it was strong, with one standard error where that is determined. Points all on one side leave "
        "wind and trim hard to tell apart."
    )
    return Figure(name, caption, data, layout, 430, time=False)


def _winds_of(known: Sequence[FlightWind], part: str, word: str, color: str) -> Trace | None:
    some = [each for each in known if each.part == part]
    if not some:
        return None
    sigma = [_short(each.sigma) for each in some]
    return {
        "type": "scatter",
        "mode": "markers",
        "x": [_short(each.speed * math.sin(each.direction)) for each in some],
        "y": [_short(each.speed * math.cos(each.direction)) for each in some],
        "error_x": {"array": sigma, "color": color, "thickness": 1, "width": 0},
        "error_y": {"array": sigma, "color": color, "thickness": 1, "width": 0},
        "text": [
            f"{plotly_text(each.flight)}: {each.speed:.1f} m/s from {math.degrees(each.direction):.0f}°"
            + (", its error not determined" if each.sigma is None else "")
            for each in some
        ],
        "name": word,
        "marker": {
            "symbol": "circle" if part == "training" else "circle-open",
            "size": 9,
            "color": color,
            "line": {"width": 2},
        },
        "hovertemplate": f"%{{text}}<extra>{word}</extra>",
    }


def _title(quantity: RangeFlown | None, otherwise: str) -> str:
    return otherwise if quantity is None else f"{quantity.title} ({quantity.unit})"


def _log(seconds: float | None) -> float | None:
    return None if not seconds else round(math.log10(max(seconds, _LEAST)), 3)


def _short(value: float | None) -> float | None:
    """Keep four digits, which is what a plot shows."""
    return None if value is None else float(f"{value:.4g}")
