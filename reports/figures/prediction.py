"""Measured and predicted position side by side, each with its residual below."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.results.failure import present
from pipeline.results.fleet import GroupResult
from pipeline.results.flight import FlightResult, ModelResult, Prediction
from pipeline.results.span import Span
from reports.figures.figure import (
    MOST_POINTS,
    Drawn,
    Figure,
    Trace,
    band,
    band_label,
    layout_of,
    line,
    margin,
    model_color,
    short,
    time_axis,
)
from sysid import Experiment

#: Points of all flights of a craft together that one line of one model may have: what a page can carry.
ALL_POINTS = 24_000
#: Fewest points of a line: fewer would no longer show a flight.
FEWEST_POINTS = 150


def prediction(result: FlightResult, hidden: Collection[str] = ()) -> Figure | None:
    """Draw measured and predicted x, y and z of a flight, `hidden` models off; nothing without a prediction."""
    parts = [part for each in result.models for part in each.predictions]
    if not parts:
        return None
    whole = next(iter(result.experiments.values()), parts[0].experiment)
    return compare(whole, result.models, present(result.flight), hidden=hidden)


def joint_predictions(group: GroupResult, trust: Mapping[str, str]) -> dict[str, Figure]:
    """Draw what the joint models of a craft make of each of its flights.

    Parameters
    ----------
    group : GroupResult
    trust : mapping of str to str
        How far each model can be trusted, by its key: those that cannot be wait in the legend where others can.

    Returns
    -------
    dict of str to Figure
        By flight, in the order of the group's: those that judge first.
    """
    flights = [*group.held_out, *group.training]
    most = int(np.clip(ALL_POINTS // max(len(flights), 1), FEWEST_POINTS, MOST_POINTS))
    hidden = {key for key, word in trust.items() if word == "no"}
    drawn = {result.key for result in group.models if result.predictions}
    figures = {}
    for flight in flights:
        models = [
            replace(result, predictions=parts)
            for result in group.models
            if (parts := tuple(part for part in result.predictions if part.experiment.name == flight))
        ]
        if models:
            whole = models[0].predictions[0].experiment
            figures[flight] = compare(whole, models, hidden=hidden if drawn - hidden else (), most=most)
    return figures


def compare(
    whole: Experiment,
    models: Sequence[ModelResult],
    span: Span | None = None,
    *,
    measured: bool = True,
    hidden: Collection[str] = (),
    most: int = MOST_POINTS,
) -> Figure:
    """Draw free runs beside what was measured.

    Parameters
    ----------
    whole : Experiment
        The flight, whose first sample is the zero of what is drawn.
    models : sequence of ModelResult
        With predictions of this flight only.
    span : Span, optional
        The time shown.
    measured : bool
        Whether the experiment's outputs were measured; if not, predictions stand alone.
    hidden : collection of str
        Keys of models that wait in the legend.
    most : int
        Points of a line.
    """
    runs = [(result, part) for result in models for part in result.predictions]
    outputs = whole.output_names
    data: list[Trace] = []
    axes: Drawn = {}
    for number, output in enumerate(outputs):
        main, below = ("" if number == 0 else str(2 * number + 1)), str(2 * number + 2)
        shown = []
        if measured:
            truth = whole.y[:, number]
            shown.append(truth)
            style = {"yaxis": f"y{main}", "legendgroup": "measured", "showlegend": number == 0}
            data.append(line(whole.t, truth, "measured", "@ink", width=2.2, most=most) | style)
        named: set[str] = set()
        for result, part in runs:
            y_hat = part.y_hat[:, number] + _alignment(whole, part, number)
            if result.key not in hidden:
                shown.append(y_hat)
            first = number == 0 and result.key not in named
            named.add(result.key)
            if part.drift is not None:
                data.append(_drift(result, part, y_hat, part.drift[:, number], main, hidden, most))
            data.append(_run(result, part.experiment.t, y_hat, main, hidden, most) | {"showlegend": first})
            if measured:
                residual = part.experiment.y[:, number] - part.y_hat[:, number]
                data.append(_run(result, part.experiment.t, residual, below, hidden, most, residual=True))
        axes |= _axes(output, number, len(outputs), main, below if measured else "", _readable_range(shown))
    last = 2 * len(outputs) - (0 if measured else 1)
    axes["xaxis"] = time_axis(margin(span)) | {"anchor": f"y{last}" if last > 1 else "y"}
    held = _held_out(runs)
    bands = [] if held is None else [band(held, "@held", 0.10)]
    labels = [] if held is None else [band_label(held, "held out")]
    layout = layout_of(**axes, shapes=bands, annotations=labels)
    layout["margin"] = layout["margin"] | {"t": 46 + 20 * (len(models) // 3)}
    banded = any(part.drift is not None for _, part in runs)
    return Figure("prediction", _caption(measured, held, hidden, banded=banded), data, layout, 240 * len(outputs))


def _run(
    result: ModelResult,
    t: NDArray[np.float64],
    values: NDArray[np.float64],
    axis: str,
    hidden: Collection[str],
    most: int,
    *,
    residual: bool = False,
) -> Trace:
    name = short(result.title)
    label = f"residual, {name}" if residual else name
    return line(t, values, label, model_color(result.key), width=1.2 if residual else 1.6, most=most) | {
        "yaxis": f"y{axis}",
        "legendgroup": name,
        "showlegend": False,
        "visible": "legendonly" if result.key in hidden else True,
    }


def _drift(
    result: ModelResult,
    part: Prediction,
    y_hat: NDArray[np.float64],
    width: NDArray[np.float64],
    axis: str,
    hidden: Collection[str],
    most: int,
) -> Trace:
    """Shade how far a free run may drift, where it is free."""
    free = np.flatnonzero(np.isfinite(width))
    free = free[:: max(1, -(-2 * len(free) // most))]
    t = part.experiment.t[free]
    around = np.concatenate([y_hat[free] + width[free], (y_hat[free] - width[free])[::-1]])
    name = short(result.title)
    outline = line(np.concatenate([t, t[::-1]]), around, f"drift band, {name}", model_color(result.key), 0.0, most=most)
    return outline | {
        "yaxis": f"y{axis}",
        "fill": "toself",
        "fillcolor": model_color(result.key),
        "opacity": 0.15,
        "hoverinfo": "skip",
        "legendgroup": name,
        "showlegend": False,
        "visible": "legendonly" if result.key in hidden else True,
    }


def _axes(output: str, number: int, count: int, main: str, below: str, shown: list[float]) -> Drawn:
    """Lay out the axes of one output: the signal, and its residual below where there is one."""
    block = 1.0 / count
    top = 1.0 - number * block
    axes: Drawn = {
        f"yaxis{main}": {
            "domain": [top - block * (0.60 if below else 0.90), top],
            "title": {"text": f"{output} (m)"},
            "range": shown,
        }
    }
    if below:
        axes[f"yaxis{below}"] = {
            "domain": [top - block * 0.90, top - block * 0.65],
            "title": {"text": "residual (m)", "font": {"size": 10}},
            "nticks": 4,
            "zeroline": True,
        }
    return axes


def _held_out(runs: Sequence[tuple[ModelResult, Prediction]]) -> Span | None:
    """Return the part of the flight that a model was not fitted to, where it was fitted to the rest."""
    fitted = {result.key for result, part in runs if part.training}
    return next((part.span for result, part in runs if not part.training and result.key in fitted), None)


def _caption(measured: bool, held: Span | None, hidden: Collection[str], *, banded: bool) -> str:
    if not measured:
        return "Position as the models predict it from the inputs, from rest."
    caption = (
        "Position x (north), y (east) and z (up) as measured, and as the models predict it from their inputs and the "
        "initial state alone; below each its residual."
    )
    if held is not None:
        caption += " Judge the models by the shaded part, which the fit has not seen."
    if banded:
        caption += " The pale band should hold nine tenths of a free run: what is not known of wind, thrust and craft."
    if hidden:
        caption += " Models that cannot be trusted wait in the legend; choose what is shown above the plot."
    return caption


def _alignment(whole: Experiment, part: Prediction, column: int) -> float:
    """Offset between the zero of a part's outputs and that of the whole flight's, m."""
    at = int(np.searchsorted(whole.t, part.experiment.t[0] - 1e-6))
    return float(whole.y[min(at, len(whole.t) - 1), column] - part.experiment.y[0, column])


def _readable_range(shown: Sequence[NDArray[np.float64]]) -> list[float]:
    """Keep the first signal readable when a later one runs away: at most three times its span."""
    low, high = float(np.nanmin(shown[0])), float(np.nanmax(shown[0]))
    span = max(high - low, 0.5)
    values = np.concatenate(shown)
    values = values[np.isfinite(values)]
    low_all, high_all = max(float(values.min()), low - span), min(float(values.max()), high + span)
    return [min(low, low_all) - 0.06 * span, max(high, high_all) + 0.06 * span]
