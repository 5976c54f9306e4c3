"""Plots of parameters over flights: whether the craft changes, and whether a motor weakens."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from core.quantity import per_degree, with_unit
from pipeline.results.craft_review import Note
from pipeline.results.drift import Drift, History, MotorShares, Point
from reports.figures.figure import Drawn, Figure, Trace, layout_of, plotly_text
from reports.figures.frequency import response_overlays
from reports.pole_map import INPUT_COLORS

#: Parameters that one figure holds, a small plot for each.
MOST_PLOTS = 4
#: Fewer points show no course.
FEWEST_POINTS = 3


def drift_figures(drift: Drift | None, prefix: str, notes: Sequence[Note] = ()) -> tuple[list[Figure], list[Figure]]:
    """Draw motors and parameters over flights, with what was done to the craft where flights are dated.

    Parameters
    ----------
    drift : Drift or None
        What changes over flights; None draws nothing.
    prefix : str
        Beginning of the figures' ids.
    notes : sequence of Note
        What was done to the craft.

    Returns
    -------
    shown, folded : list of Figure
        What tells most, and all the rest: parameters that change come first.
    """
    if drift is None:
        return [], []
    shown: list[Figure] = []
    folded: list[Figure] = []
    marks = [_mark(note) for note in notes] if _dated(drift) else []
    motors = motors_over_flights(drift, f"{prefix}shares", marks)
    if motors is not None:
        shown.append(motors)
    shown += response_overlays(drift.responses, prefix)
    worth = [each for each in drift.parameters if len(each.flights) >= FEWEST_POINTS]
    worth.sort(key=lambda each: each.change is None)
    for first in range(0, len(worth), MOST_PLOTS):
        some = worth[first : first + MOST_PLOTS]
        (shown if first == 0 else folded).append(parameters_over_flights(some, drift, f"{prefix}course-{first}", marks))
    return shown, folded


def _place(drift: Drift, point: Point | MotorShares) -> Any:
    """Return the place of a flight on the axis: its start where all are known, else its name."""
    return _utc(point.start_utc) if point.start_utc and _dated(drift) else point.flight


def _utc(start: str) -> str:
    """Write a date as Plotly takes it."""
    return start[:19].replace("T", " ")


def _dated(drift: Drift) -> bool:
    points = [point for each in drift.parameters for point in each.flights]
    return drift.order == "date" and all(point.start_utc for point in points)


def _axis(drift: Drift) -> Drawn:
    if _dated(drift):
        return {"type": "date", "title": {"text": "start of the flight (UTC)"}}
    return {
        "type": "category",
        "categoryorder": "array",
        "categoryarray": list(drift.flights),
        "title": {"text": "flight"},
        "showticklabels": len(drift.flights) <= 16,
        "tickangle": -40,
        "automargin": True,
    }


def _mark(note: Note) -> Trace:
    """Draw a line where something was done to the craft; it says what under the pointer."""
    return {
        "type": "line",
        "xref": "x",
        "yref": "paper",
        "x0": _utc(note.at.isoformat()),
        "x1": _utc(note.at.isoformat()),
        "y0": 0,
        "y1": 1,
        "line": {"color": "@joint", "width": 1.5, "dash": "solid" if note.boundary else "dot"},
        "layer": "below",
    }


def _band(each: History, degrees: float, suffix: str) -> Trace:
    """Tint where 95 % of flights of an unchanged craft lie: two standard deviations, their own errors with them."""
    own = sorted(point.sigma for point in each.flights)[len(each.flights) // 2]
    reach = 2.0 * math.hypot(each.between, own, each.mean_sigma)
    return {
        "type": "rect",
        "xref": "paper",
        "yref": f"y{suffix}",
        "x0": 0,
        "x1": 1,
        "y0": _short(each.mean - reach, degrees),
        "y1": _short(each.mean + reach, degrees),
        "fillcolor": "@joint",
        "opacity": 0.1,
        "line": {"width": 0},
        "layer": "below",
    }


def parameters_over_flights(parameters: Sequence[History], drift: Drift, name: str, marks: Sequence[Trace]) -> Figure:
    """Draw parameters over the flights, a small plot for each, with the trend or step that is seen."""
    data: list[Trace] = []
    axes: Drawn = {}
    labels = []
    count = len(parameters)
    for place, each in enumerate(parameters):
        suffix = "" if place == 0 else str(place + 1)
        degrees, unit = per_degree(each.unit.partition(",")[0])
        points = each.flights
        at = [_place(drift, point) for point in points]
        color = "@bad" if each.change is not None else "@ink"
        data.append(
            {
                "type": "scatter",
                "mode": "markers",
                "x": at,
                "y": [_short(point.value, degrees) for point in points],
                "error_y": {
                    "array": [_short(point.sigma, degrees) for point in points],
                    "color": color,
                    "thickness": 1.2,
                    "width": 0,
                },
                "marker": {"color": color, "size": 6},
                "text": [plotly_text(point.flight) for point in points],
                "yaxis": f"y{suffix}",
                "showlegend": False,
                "name": "value",
                "hovertemplate": f"%{{text}}: %{{y:.4g}} {plotly_text(unit)}<extra></extra>",
            }
        )
        data += _course(each, at, degrees, suffix)
        top = 1.0 - place / count
        axes[f"yaxis{suffix}"] = {
            "domain": [top - 0.74 / count, top - 0.12 / count],
            "nticks": 4,
        }
        labels.append(
            {
                "text": plotly_text(with_unit(f"{each.parameter}, {each.method}", unit)),
                "x": 0,
                "xref": "paper",
                "xanchor": "left",
                "y": 1,
                "yref": f"y{suffix} domain",
                "yanchor": "bottom",
                "showarrow": False,
                "font": {"size": 12},
            }
        )
    axes["xaxis"] = _axis(drift) | {"anchor": f"y{count}" if count > 1 else "y"}
    bands = [
        _band(each, per_degree(each.unit.partition(",")[0])[0], "" if place == 0 else str(place + 1))
        for place, each in enumerate(parameters)
        if each.change is None
    ]
    layout = layout_of(**axes, annotations=labels, shapes=[*bands, *marks])
    layout["margin"] = layout["margin"] | {"t": 10}
    caption = (
        "Each parameter as every flight by itself gives it, with one standard error; the line is its mean, or its "
        "trend or step where one is seen, and tinted is where 95 % of flights lie. Scatter beyond the "
        "error bars is what differs between flights: wind, battery, temperature."
    )
    return Figure(name, caption, data, layout, 90 + 135 * count, time=False)


def _course(parameter: History, at: Sequence[Any], degrees: float, suffix: str) -> list[Trace]:
    """Draw the mean, or the step or trend that is more than chance; through the points, in their order."""
    mean, trend, step = parameter.mean, parameter.trend, parameter.step
    if mean is None or not at:
        return []
    numbers = [point.number for point in parameter.flights]
    if step is not None and step.significant:
        late = [float(number >= step.number) for number in numbers]
        y = [mean + step.change * (each - sum(late) / len(late)) for each in late]
    elif trend is not None and trend.significant:
        middle = sum(numbers) / len(numbers)
        y = [mean + trend.per_flight * (number - middle) for number in numbers]
    else:
        y = [mean] * len(numbers)
    return [
        {
            "type": "scatter",
            "mode": "lines",
            "x": list(at),
            "y": [_short(value, degrees) for value in y],
            "line": {"color": "@quiet", "width": 1.2, "shape": "hvh" if step and step.significant else "linear"},
            "yaxis": f"y{suffix}",
            "showlegend": False,
            "hoverinfo": "skip",
        }
    ]


def motors_over_flights(drift: Drift, name: str, marks: Sequence[Trace]) -> Figure | None:
    """Draw what each motor is commanded in hover, flight by flight; None where no flight tells."""
    motors = drift.motors
    if motors is None or not motors.points:
        return None
    names = list(dict.fromkeys(motor for point in motors.points for motor in point.shares))
    data: list[Trace] = []
    for place, motor in enumerate(names):
        points = [point for point in motors.points if motor in point.shares]
        color = INPUT_COLORS[place % len(INPUT_COLORS)]
        weak = motor == motors.weakening
        data.append(
            {
                "type": "scatter",
                "mode": "lines+markers",
                "x": [_place(drift, point) for point in points],
                "y": [_short(point.shares[motor][0]) for point in points],
                "error_y": {
                    "array": [_short(point.shares[motor][1]) for point in points],
                    "color": color,
                    "thickness": 1,
                    "width": 0,
                },
                "name": motor,
                "legendgroup": motor,
                "line": {"color": color, "width": 3 if weak else 1.2, "dash": "solid" if place < 4 else "dash"},
                "marker": {"color": color, "size": 8 if weak else 5},
                "text": [plotly_text(point.flight) for point in points],
                "hovertemplate": f"%{{text}}: %{{y:.4f}}<extra>{plotly_text(motor)}</extra>",
            }
        )
    layout = layout_of(xaxis=_axis(drift), yaxis={"title": {"text": "command over mean of all"}}, shapes=list(marks))
    caption = (
        "What each motor is commanded in hover, over the mean of all motors, flight by flight: a motor that weakens is "
        "told more from flight to flight, while its opposite is told the same."
    )
    return Figure(name, caption, data, layout, 330, time=False)


def _short(value: float | None, factor: float = 1.0) -> float | None:
    """Keep five digits: changes of a parameter are small against it."""
    return None if value is None else float(f"{value * factor:.5g}")
