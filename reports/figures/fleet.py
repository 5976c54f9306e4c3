"""Plots over the flights of a craft or folder: when they were, what they covered, and what changed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import datetime, timedelta
from typing import Any

from core.quantity import per_degree, with_unit
from pipeline.results.answer import Tone
from pipeline.results.coverage import MAP, QUANTITIES, Envelope, RangeFlown
from pipeline.results.drift import CraftNote, Drift, FlightPoint, History, MotorWork
from pipeline.results.report import FlightReport
from reports.figures.figure import (
    COLORS,
    Drawn,
    Figure,
    Plot,
    Trace,
    curve,
    digits,
    layout_of,
    mark_line,
    marks,
    plotly_text,
    suffix,
)
from reports.figures.frequency import response_overlays

#: Parts of the flights and how they are drawn, the same in every plot.
PARTS = (("training", "fitted", "@fitted"), ("held_out", "judged", "@judged"))
#: Least seconds that the colour of a cell tells apart.
_LEAST = 0.1
#: Parameters that one figure holds, a small plot for each.
MOST_PLOTS = 4
#: Height [px] of the plot beside the answer, as that of a flight's map.
FIRST_HEIGHT = 330
#: Colour, mark and name of a flight by what happened in it.
_TONES = {
    Tone.GOOD: ("@good", "circle", "uneventful"),
    Tone.CARE: ("@care", "diamond", "to look into"),
    Tone.BAD: ("@bad", "x", "in danger"),
    Tone.UNKNOWN: ("@quiet", "circle-open", "not known"),
}


def flights_over_time(flights: Sequence[FlightReport]) -> Figure | None:
    """Draw the duration of each flight over its date, or over its place where dates are not known."""
    flown = [(flight, flight.flight) for flight in flights if flight.flight is not None]
    if len(flown) < 2:
        return None
    dated = all(flight.log.start_utc for flight, _ in flown)
    places = [str(k + 1) for k in range(len(flown))]
    if dated:
        # The log's clock is 0 at `start_utc`; several flights share it.
        places = [
            f"{datetime.fromisoformat(str(report.log.start_utc)) + timedelta(seconds=flight.start_s):%Y-%m-%d %H:%M:%S}"
            for report, flight in flown
        ]
    axis = (
        {"title": {"text": "start (UTC)"}, "type": "date"}
        if dated
        else {"title": {"text": "flight"}, "tick0": 1, "dtick": max(1, len(flown) // 10)}
    )
    plot = Plot({"title": {"text": "duration (min)"}, "rangemode": "tozero"}, x=axis)
    tones = [_tone(flight) for flight, _ in flown]
    for tone, (color, symbol, name) in _TONES.items():
        chosen = [k for k, its in enumerate(tones) if its is tone]
        if chosen:
            text = [f"{flown[k][0].name}: {flown[k][0].happened}" for k in chosen]
            minutes = [round(flown[k][1].duration_s / 60.0, 2) for k in chosen]
            hover = "%{text}<br>%{y:.1f} min<extra></extra>"
            at = [places[k] for k in chosen]
            plot.add(marks(at, minutes, name, color, symbol=symbol, size=9, text=text, hover=hover))
    return plot.figure("first-flights", "The flights over time.", FIRST_HEIGHT)


def _tone(flight: FlightReport) -> Tone:
    lines = () if flight.answer is None else flight.answer.lines
    return next((line.tone for line in lines if line.purpose == "Happened"), Tone.UNKNOWN)


def coverage_figures(coverage: Envelope | None, prefix: str) -> list[Figure]:
    """Draw map, distributions and winds of a craft; what was not measured is left out."""
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
    cells = coverage.map
    if not cells.training and not cells.held_out:
        return None
    x_step, y_step = (QUANTITIES[name].step for name in MAP)
    axes = [
        {"title": {"text": _title(coverage.quantities.get(axis), otherwise)}, "zeroline": False}
        for axis, otherwise in zip(MAP[::-1], ("height (m)", "ground speed (m/s)"), strict=True)
    ]
    plot = Plot(axes[0], x=axes[1], showlegend=True)
    if cells.training:
        columns = range(min(cell[0] for cell in cells.training), max(cell[0] for cell in cells.training) + 1)
        rows = range(min(cell[1] for cell in cells.training), max(cell[1] for cell in cells.training) + 1)
        seconds = {(i, j): value for i, j, value in cells.training}
        logs = {cell: round(math.log10(max(value, _LEAST)), 3) for cell, value in seconds.items() if value}
        z, known = [[logs.get((i, j)) for i in columns] for j in rows], list(logs.values())
        ticks = list(range(math.floor(min(known)), math.ceil(max(known)) + 1))
        scale = {"title": {"text": "fitted (s)", "side": "top"}, "thickness": 12, "outlinewidth": 0}
        scale |= {"tickvals": ticks, "ticktext": [f"{10.0**tick:g}" for tick in ticks]}
        heat: Trace = {"type": "heatmap", "name": "fitted", "z": z, "xgap": 1, "ygap": 1, "colorbar": scale}
        heat |= {"x": [(i + 0.5) * x_step for i in columns], "y": [(j + 0.5) * y_step for j in rows]}
        heat |= {"zmin": ticks[0] - 0.5, "zmax": max(ticks[-1], ticks[0] + 1)}
        heat |= {"colorscale": [[0, "@paper"], [1, "@fitted"]]}
        heat |= {"customdata": [[_short(seconds.get((i, j))) for i in columns] for j in rows]}
        plot.add(heat | {"hovertemplate": "%{x} m/s, %{y} m: %{customdata} s<extra>fitted</extra>"})
    if cells.held_out:
        x = [(i + 0.5) * x_step for i, *_ in cells.held_out]
        y = [(j + 0.5) * y_step for _, j, _ in cells.held_out]
        sizes = [round(4.0 + 4.0 * max(math.log10(value / _LEAST), 0.0), 1) for *_, value in cells.held_out]
        text = [str(_short(value)) for *_, value in cells.held_out]
        hover = "%{x} m/s, %{y} m: %{text} s<extra>judged</extra>"
        circles = marks(x, y, "judged", "@judged", symbol="circle-open", text=text, hover=hover)
        plot.add(circles | {"marker": circles["marker"] | {"size": sizes}})
    caption = (
        "Where the craft has been: each cell is tinted by the time that flights fitted to spent there, each circle "
        "grows with the time of flights that judge. A circle on bare paper is judged outside of what was fitted."
    )
    return plot.figure(name, caption, 400)


def distributions(coverage: Envelope, name: str) -> Figure | None:
    """Draw how much time was spent at which values, one small plot for each quantity, fitted over judged."""
    quantities = [flown for flown in coverage.quantities.values() if any(flown.training) or any(flown.held_out)]
    if not quantities:
        return None
    data: list[Trace] = []
    axes: Drawn = {}
    rows = math.ceil(len(quantities) / 2)
    for place, quantity in enumerate(quantities):
        row, column = divmod(place, 2)
        degrees, unit = per_degree(quantity.unit)
        for part, word, color in PARTS:
            counted = getattr(quantity, part)
            total = sum(counted) or 1.0
            edges = [(quantity.first + k) * quantity.step * degrees for k in range(len(counted) + 1)]
            shares = [100.0 * value / total for value in counted]
            if not any(shares):
                continue
            fitted = part == "training"
            hover = f"from %{{x:.3g}} {unit}: %{{y:.0f}} % of the time"
            steps = curve([edges[0], *edges], [0.0, *shares, 0.0], word, color, 1.0 if fitted else 2.0, hover=hover)
            steps["line"] |= {"shape": "hv"}
            steps |= {"fill": "tozeroy", "fillcolor": color, "opacity": 0.55} if fitted else {}
            steps |= {"legendgroup": word, "showlegend": place == 0}
            data.append(steps | {"xaxis": f"x{suffix(place)}", "yaxis": f"y{suffix(place)}"})
        top = 1.0 - row / rows
        side = {"domain": [0.0, 0.47] if column == 0 else [0.53, 1.0], "anchor": f"y{suffix(place)}"}
        title = {"text": f"{quantity.title} ({unit})", "standoff": 4, "font": {"size": 11}}
        axes[f"xaxis{suffix(place)}"] = side | {"title": title, "zeroline": False, "nticks": 6}
        upright = {"domain": [top - 0.62 / rows, top - 0.04 / rows], "anchor": f"x{suffix(place)}"}
        axes[f"yaxis{suffix(place)}"] = upright | {"showticklabels": False, "rangemode": "tozero", "showgrid": False}
    layout = layout_of(**axes)
    layout["margin"] = layout["margin"] | {"l": 14}
    caption = (
        "How the time in the air was spent, fitted (filled) and judged (line). Where the line leaves the filled shape, "
        "the models are judged on flying that they were not fitted to."
    )
    return Figure(name, caption, data, layout, 70 + 125 * rows, time=False)


def winds(coverage: Envelope, name: str) -> Figure | None:
    """Draw the mean wind of each flight as a point in the direction that it came from."""
    known = coverage.winds
    if not known:
        return None
    reach = 1.15 * max(max(wind.speed + (wind.sigma or 0.0) for wind in known), 1.0)
    axis = {"range": [-reach, reach], "zeroline": True}
    north = axis | {"title": {"text": "wind from the north (m/s)"}, "scaleanchor": "x", "scaleratio": 1}
    plot = Plot(north, x=axis | {"title": {"text": "wind from the east (m/s)"}})
    for part, word, color in PARTS:
        some = [wind for wind in known if wind.part == part.replace("_", "-")]
        if not some:
            continue
        x, y = ([wind.speed * which(wind.direction) for wind in some] for which in (math.sin, math.cos))
        text = [
            f"{wind.flight}: {wind.speed:.1f} m/s from {math.degrees(wind.direction):.0f}°"
            + (", its error not determined" if wind.sigma is None else "")
            for wind in some
        ]
        sigma = [math.nan if wind.sigma is None else wind.sigma for wind in some]
        symbol, hover = "circle" if part == "training" else "circle-open", f"%{{text}}<extra>{word}</extra>"
        drawn = marks(x, y, word, color, symbol=symbol, size=9, sigma=sigma, text=text, hover=hover)
        plot.add(drawn | {"error_x": drawn["error_y"]})
    caption = (
        "The mean wind of each flight, as the rigid body explains the tilt: a point lies where the wind came from, as "
        "far out as it was strong, with one standard error where that is determined. Points all on one side leave "
        "wind and trim hard to tell apart."
    )
    return plot.figure(name, caption, 430)


def drift_figures(
    drift: Drift | None, prefix: str, notes: Sequence[CraftNote] = ()
) -> tuple[list[Figure], list[Figure]]:
    """Draw motors and parameters over flights, with what was done to the craft where flights are dated.

    What tells most is shown, all the rest is folded; parameters that change come first.
    """
    if drift is None:
        return [], []
    lines = [
        mark_line(_utc(note.at.isoformat()), "@joint", 1.5, "solid" if note.boundary else "dot") | {"layer": "below"}
        for note in (notes if drift.order == "date" else ())
    ]
    motors = motors_over_flights(drift, f"{prefix}shares", lines)
    shown = [*([] if motors is None else [motors]), *response_overlays(drift.responses, prefix)]
    folded: list[Figure] = []
    # Fewer points show no course.
    worth = [parameter for parameter in drift.parameters if len(parameter.flights) >= 3]
    worth.sort(key=lambda history: history.change is None)
    for first in range(0, len(worth), MOST_PLOTS):
        some = worth[first : first + MOST_PLOTS]
        (shown if first == 0 else folded).append(parameters_over_flights(some, drift, f"{prefix}course-{first}", lines))
    return shown, folded


def _place(drift: Drift, point: FlightPoint | MotorWork) -> str:
    """Return the place of a flight on the axis: its start where all are known, else its name."""
    return _utc(point.start_utc) if point.start_utc and drift.order == "date" else point.flight


def _utc(start: str) -> str:
    """Write a date as Plotly takes it."""
    return start[:19].replace("T", " ")


def _axis(drift: Drift) -> Drawn:
    if drift.order == "date":
        return {"type": "date", "title": {"text": "start of the flight (UTC)"}}
    order = {"type": "category", "categoryorder": "array", "categoryarray": list(drift.flights)}
    ticks = {"showticklabels": len(drift.flights) <= 16, "tickangle": -40, "automargin": True}
    return order | ticks | {"title": {"text": "flight"}}


def parameters_over_flights(parameters: Sequence[History], drift: Drift, name: str, lines: Sequence[Drawn]) -> Figure:
    """Draw parameters over the flights, a small plot for each, with the trend or step that is seen."""
    axes: list[Drawn] = [{"nticks": 4} for _ in parameters]
    plot = Plot(*axes, x=_axis(drift), gap=0.26)
    for panel, parameter in enumerate(parameters):
        degrees, unit = per_degree(parameter.unit.partition(",")[0])
        at = [_place(drift, point) for point in parameter.flights]
        values, sigma = (
            [degrees * getattr(point, which) for point in parameter.flights] for which in ("value", "sigma")
        )
        color = "@bad" if parameter.change is not None else "@ink"
        text = [point.flight for point in parameter.flights]
        hover = f"%{{text}}: %{{y:.4g}} {plotly_text(unit)}<extra></extra>"
        plot.add(marks(at, values, "value", color, size=6, sigma=sigma, text=text, hover=hover), panel, legend=False)
        shape = "hvh" if parameter.step is not None and parameter.step.significant else "linear"
        course = {"x": at, "y": digits([degrees * value for value in _course(parameter)], 5), "hoverinfo": "skip"}
        style = {"type": "scatter", "mode": "lines", "line": {"color": "@quiet", "width": 1.2, "shape": shape}}
        plot.add(style | course, panel, legend=False)
        label: Drawn = {
            "text": plotly_text(with_unit(f"{parameter.parameter}, {parameter.method}", unit)),
            "font": {"size": 12},
        }
        label |= {"x": 0, "xref": "paper", "xanchor": "left", "y": 1, "yanchor": "bottom", "showarrow": False}
        plot.notes.append(label | {"yref": f"y{suffix(panel)} domain"})
        if parameter.change is None:
            # Where 95 % of flights of an unchanged craft lie: two standard deviations, their own errors with them.
            own = sorted(point.sigma for point in parameter.flights)[len(parameter.flights) // 2]
            reach = 2.0 * math.hypot(parameter.between, own, parameter.mean_sigma)
            low, high = digits([degrees * (parameter.mean - reach), degrees * (parameter.mean + reach)], 5)
            box = {"type": "rect", "xref": "paper", "yref": f"y{suffix(panel)}", "x0": 0, "x1": 1}
            box |= {"y0": low, "y1": high, "layer": "below"}
            plot.shapes.append(box | {"fillcolor": "@joint", "opacity": 0.1, "line": {"width": 0}})
    plot.shapes += lines
    caption = (
        "Each parameter by flight, with one standard error. Line: mean, trend or step; tinted: where 95 % of "
        "flights lie. Scatter beyond the error bars is of wind, battery, temperature."
    )
    return plot.figure(name, caption, 90 + 135 * len(parameters), margin={"t": 24})


def _course(parameter: History) -> list[float]:
    """Return the mean, or the step or trend that is more than chance, at each flight."""
    mean, trend, step = parameter.mean, parameter.trend, parameter.step
    numbers = [point.number for point in parameter.flights]
    if step is not None and step.significant:
        late = [float(number >= step.number) for number in numbers]
        return [mean + step.change * (value - sum(late) / len(late)) for value in late]
    if trend is not None and trend.significant:
        middle = sum(numbers) / len(numbers)
        return [mean + trend.per_flight * (number - middle) for number in numbers]
    return [mean] * len(numbers)


def motors_over_flights(drift: Drift, name: str, lines: Sequence[Drawn]) -> Figure | None:
    """Draw how hard each motor works, flight by flight; None where no flight tells."""
    motors = drift.motors
    names = dict.fromkeys(motor for point in motors.points for motor in point.work) if motors is not None else {}
    if motors is None or not names:
        return None
    plot = Plot("output over mean of all", x=_axis(drift))
    plot.shapes += lines
    for place, motor in enumerate(names):
        points = [point for point in motors.points if motor in point.work]
        color, weak = COLORS[place % len(COLORS)], motor == motors.weakening
        at, text = [_place(drift, point) for point in points], [point.flight for point in points]
        hover = f"%{{text}}: %{{y:.3f}}<extra>{plotly_text(motor)}</extra>"
        values = [point.work[motor] for point in points]
        drawn = marks(at, values, motor, color, size=8 if weak else 5, text=text, hover=hover)
        style = {"color": color, "width": 3 if weak else 1.2, "dash": "solid" if place < 4 else "dash"}
        plot.add(drawn, group=motor, mode="lines+markers", line=style)
    caption = (
        "How hard each motor works, over the mean of all motors, flight by flight: of a motor that weakens more is "
        "asked from flight to flight, of all others a little less."
    )
    return plot.figure(name, caption, 330, margin={"l": 78})


def _title(quantity: RangeFlown | None, otherwise: str) -> str:
    return otherwise if quantity is None else f"{quantity.title} ({quantity.unit})"


def _short(value: float | None) -> Any:
    return None if value is None else digits([value])[0]
