"""The plots of a flight or craft that need the result itself: drawn once and kept, so that pages can be made anew."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from pipeline.results.answer import Picture
from pipeline.results.failure import present
from pipeline.results.fleet import GroupResult
from pipeline.results.flight import FlightResult
from pipeline.results.report import CraftReport, FlightReport
from pipeline.results.span import Span
from reports.figures.figure import (
    Drawn,
    Figure,
    band_label,
    layout_of,
    limit_line,
    line,
    margin,
    mark_line,
    time_axis,
)
from reports.figures.flight import altitude, flight_figures, mode_bands, notable, track
from reports.figures.models import Board, joint_predictions, model_board, off_by_default, prediction
from reports.figures.signals import signal_figure, signal_figures


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightFigures:
    """The plots of a flight in the order of its pages."""

    first: tuple[Figure, ...]
    flight: tuple[Figure, ...]
    signals: tuple[Figure, ...]
    predicted: tuple[Figure, ...]
    board: Board


@dataclass(frozen=True, slots=True, kw_only=True)
class CraftFigures:
    """The plots of a craft: of all models, and measured and predicted position by flight."""

    board: Board
    predictions: Mapping[str, Figure]


def draw_flight(result: FlightResult, numbers: FlightReport) -> FlightFigures:
    """Draw the plots of a flight."""
    hidden = off_by_default(numbers.models)
    first = first_figures(result)
    # What the first screen shows of the whole flight is not shown twice.
    shown = {figure.id.removeprefix("first-") for figure in first if figure.time or figure.id == "track"}
    predicted = prediction(result, hidden)
    return FlightFigures(
        first=tuple(first),
        flight=tuple(each for each in flight_figures(result) if each.id not in shown),
        signals=tuple(signal_figures(result)),
        predicted=() if predicted is None else (predicted,),
        board=model_board(result.models, hidden),
    )


def draw_craft(group: GroupResult, numbers: CraftReport) -> CraftFigures:
    """Draw the plots of a craft."""
    hidden = off_by_default(numbers.models)
    return CraftFigures(board=model_board(group.models, hidden), predictions=joint_predictions(group, hidden))


#: Plots below each other for which there is room.
_PANELS = {Picture.ATTITUDE: 3, Picture.RATES: 3, Picture.BATTERY: 2}
_CAPTIONS = {
    Picture.MOTORS: "Motor outputs.",
    Picture.ATTITUDE: "Attitude asked and flown.",
    Picture.RATES: "Angular rates asked and flown.",
    Picture.VIBRATION: "Vibration.",
    Picture.BATTERY: "Battery.",
    Picture.GPS: "GPS.",
    Picture.ALTITUDE: "",  # its axis says what it is
}


def first_figures(result: FlightResult) -> list[Figure]:
    """Draw where it flew and what matters most; each is left out where nothing is known of it."""
    beside = track(result)
    figures = [] if beside is None else [_map(beside)]
    matters = _matters(result, 420 if beside is None else 270)
    return figures if matters is None else [*figures, matters]


def _map(figure: Figure) -> Figure:
    """Name start and end in the map, which takes less room than a legend."""
    layout = figure.layout | {"showlegend": False, "margin": figure.layout["margin"] | {"t": 12}}
    # A flight that ends near where it began must not write one over the other: the northern one has its name above.
    ends = sorted((each for each in figure.data if each["name"] in ("start", "end")), key=lambda each: each["y"][0])
    places = {each["name"]: place for each, place in zip(ends, ("bottom right", "top right"), strict=False)}
    named = {"mode": "markers+text", "cliponaxis": False}
    data = [
        each | named | {"textposition": places[name], "text": [name]} if name in places else each
        for each in figure.data
        for name in (each["name"],)
    ]
    return replace(figure, height=330, caption=_key(figure), data=data, layout=layout)


def _key(figure: Figure) -> str:
    """Say what a map's marks are."""
    words = [
        f"{'lines' if each['mode'] == 'lines' else 'dots'}: GPS" if each["name"] == "GPS" else "crosses: what happened"
        for each in figure.data
        if each["name"] in ("GPS", "events")
    ]
    words += [f"arrow: {note['hovertext']}" for note in figure.layout.get("annotations", ()) if note["name"] == "wind"]
    text = "; ".join(words)
    return f"{text[0].upper()}{text[1:]}." if text else ""


def _matters(result: FlightResult, height: int) -> Figure | None:
    answer = present(result.answer)
    picture = Picture.ALTITUDE if answer is None else answer.picture
    around = None if answer is None else answer.around
    drawn = {
        Picture.MOTORS: lambda: _motors(result, around),
        Picture.ALTITUDE: lambda: altitude(result),
    }.get(picture, lambda: signal_figure(result, str(picture), _PANELS.get(picture, 1)))()
    if drawn is None:
        return None
    layout = dict(drawn.layout)
    if around is not None:
        shown = Span(around.start, _end(drawn, around.stop))
        # Names of modes would cover those of what happened.
        layout["annotations"] = _names(result, shown)
        happened = [mark_line(t, "@bad", 1.5) for _, t in notable(result)[:20]]
        layout["shapes"] = [*_background(result, layout), *happened]
        layout["xaxis"] = layout["xaxis"] | {"range": [shown.start, shown.stop]}
    # A stretch of its own must not pull the other plots along, nor be pulled by them.
    return replace(
        drawn,
        id=f"first-{picture}",
        height=height,
        layout=layout,
        caption=_CAPTIONS[picture],
        time=drawn.time and around is None,
    )


def _background(result: FlightResult, layout: Drawn) -> list[Drawn]:
    """Return modes as bands, and the limits that the plot had."""
    limits = [shape for shape in layout.get("shapes", ()) if shape.get("xref") == "paper"]
    return [*mode_bands(result)["shapes"], *limits]


def _names(result: FlightResult, around: Span) -> list[Drawn]:
    """Name what happened above its line, the story first, as many as do not cover each other."""
    names: list[Drawn] = []
    taken: list[tuple[float, float]] = []
    account = present(result.account)
    story = () if account is None else account.story
    for event, t in sorted(notable(result), key=lambda each: each[0] not in story):
        text = event.id.replace("-", " ")
        # Width of a letter above a plot, as a part of the plot's width.
        width = 0.012 * len(text) * around.duration
        for side, low, high in (("left", t, t + width), ("right", t - width, t)):
            free = all(high <= other[0] or low >= other[1] for other in taken)
            if free and around.start <= low and high <= around.stop:
                taken.append((low, high))
                names.append(band_label(Span(t, t), text) | {"xanchor": side})
                break
    return names


def _end(figure: Figure, stop: float) -> float:
    """Return where a stretch of time ends that is drawn: a crash ends many lines, and nothing is to be seen after."""
    last = max((float(trace["x"][-1]) for trace in figure.data if len(trace["x"])), default=stop)
    return min(stop, last + 0.3)


def _motors(result: FlightResult, around: Span | None) -> Figure | None:
    """Draw all motor outputs in one plot."""
    if result.motors is None or result.motors.shape[1] == 0:
        return None
    span = around or margin(present(result.flight))
    table = result.motors if span is None else result.motors.loc[span.start : span.stop]
    if len(table) < 2:
        return None
    data = [
        line(table.index, table.iloc[:, k].to_numpy(float), str(name).removeprefix("m"), f"@c{k % 8 + 1}", 1.4, 0)
        for k, name in enumerate(table.columns)
    ]
    signals = present(result.signals)
    shapes = [] if signals is None else [limit_line(each, "y") for each in signals.motor_limits.values()]
    layout = layout_of(xaxis=time_axis(span), yaxis={"title": {"text": "output (µs)"}}, shapes=shapes)
    return Figure("first-motors", "", data, layout, 270)
