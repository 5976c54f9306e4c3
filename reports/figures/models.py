"""Plots of the models of a flight or craft: how far ahead they predict, their free runs, and how each answers."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.results.craft import GroupResult
from pipeline.results.failure import present
from pipeline.results.flight import FlightResult, ModelResult, Prediction
from pipeline.results.model import ModelReport
from pipeline.results.span import Span
from reports.figures.figure import (
    COLORS,
    MOST_POINTS,
    Drawn,
    Figure,
    Plot,
    area,
    band,
    band_label,
    curve,
    line,
    margin,
    model_color,
    time_axis,
)
from reports.figures.frequency import bode, of_model, pole_map
from sysid import ClosedLoopModel, Experiment, TransferFunction, TransferFunctionModel
from sysid.validation.uses import Trust


def off_by_default(models: Sequence[ModelReport]) -> set[str]:
    """Return the keys of models that cannot be trusted, where there are others."""
    trust = {model.key: model.verdict.trust for model in models if model.kind}
    poor = {key for key, word in trust.items() if word is Trust.NO}
    return poor if len(poor) < len(trust) else set()


def horizon_figure(
    models: Sequence[ModelReport], name: str = "horizons", hidden: Collection[str] = ()
) -> Figure | None:
    """Draw the error over the time ahead, for every model and the guesses without one; `hidden` models off."""
    judged = [result for result in models if result.horizons]
    if not judged:
        return None
    outputs = list(dict.fromkeys(row.output for row in judged[0].horizons))
    ticks = sorted({row.horizon_s for result in judged for row in result.horizons})
    seconds = {"tickvals": ticks, "ticktext": [f"{tick:g}" for tick in ticks]}
    panels = [
        {"type": "log", "title": {"text": f"RMSE {output} (m)"}, "tickformat": "~g", "nticks": 5} for output in outputs
    ]
    plot = Plot(*panels, x={"type": "log", "title": {"text": "seconds ahead"}} | seconds, gap=0.16)
    for panel, output in enumerate(outputs):
        guesses = [row for row in judged[0].horizons if row.output == output]
        ahead = [row.horizon_s for row in guesses]
        lines = [
            (ahead, [row.constant_position_m for row in guesses], "constant position", "@quiet", "dash", False),
            (ahead, [row.constant_velocity_m for row in guesses], "constant velocity", "@quiet", "dot", False),
        ]
        for result in judged:
            rows = [row for row in result.horizons if row.output == output]
            errors = [row.rmse_m for row in rows]
            style = result.short, model_color(result.key), "solid", result.key in hidden
            lines.append(([row.horizon_s for row in rows], errors, *style))
        for x, y, label, color, dash, off in lines:
            drawn = curve(x, np.array(y, dtype=float), label, color, 2.0, dash, "%{x:g} s: %{y:.3g} m")
            shown = {"mode": "lines+markers", "visible": "legendonly" if off else True}
            plot.add(drawn, panel, group=label, legend=panel == 0, marker={"color": color, "size": 5}, **shown)
    caption = (
        "How far predictions err that start from the measured motion and know the inputs, on flight time that the "
        "models have not seen. A model is worth its name where its line runs below both grey ones."
    )
    room = {"l": 72, "t": 46 + 20 * ((len(judged) + 2) // 3)}
    return plot.figure(name, caption, 100 + 200 * len(outputs), margin=room)


@dataclass(frozen=True, slots=True)
class Board:
    """What the page shows of all models together: of each model and output how it answers, and its poles.

    `choices` are (value, label) of each model and output, determined ones first; figure ``PLACE-VALUE`` is what each
    place shows of it.
    """

    choices: tuple[tuple[str, str], ...]
    figures: tuple[Figure, ...]
    captions: Mapping[str, tuple[str, int]]  #: Of each place with anything to show: its words and height, px.

    def within(self, prefix: str) -> Board:
        """Return the same board where a page has several, its plots and places called apart."""
        figures = tuple(replace(figure, id=prefix + figure.id, place=prefix + figure.place) for figure in self.figures)
        return Board(self.choices, figures, {prefix + place: caption for place, caption in self.captions.items()})


def model_board(models: Sequence[ModelResult], hidden: Collection[str]) -> Board:
    """Draw the board; `hidden` are the keys of models that nobody should trust, which come last."""
    figures: list[Figure] = []
    choices = []
    for result in sorted(models, key=lambda model: model.key in hidden):
        for output, drawn in response_figures(result).items():
            choices.append((f"{result.key}-{output}", f"{result.report.short} → {output}"))
            figures += [replace(figure, place=figure.id.partition("-")[0]) for figure in drawn]
    captions = {figure.place: (figure.caption, figure.height) for figure in reversed(figures)}
    return Board(tuple(choices), tuple(figures), {place: captions[place] for place in ("bode", "roots") if captions})


def response_figures(result: ModelResult) -> dict[str, list[Figure]]:
    """Draw Bode plot, poles and zeros of each output of a model of transfer functions; nothing for other models."""
    model = result.model
    if not isinstance(model, TransferFunctionModel | ClosedLoopModel):
        return {}
    figures = {}
    for output in model.output_names:
        row = model.transfer_functions[output]
        functions = {name: row[name] for name in model.input_names if np.any(row[name].num)}
        if functions:
            name = f"{result.key}-{output}"
            figures[output] = [_bode(model, output, functions, name), pole_map(functions, name)]
    return figures


def _bode(
    model: TransferFunctionModel | ClosedLoopModel, output: str, functions: dict[str, TransferFunction], name: str
) -> Figure:
    hz = _frequencies(functions, model.rate)
    # The input that moves the output most is shown first; all others wait in the legend.
    gains = {
        source: float(np.median(np.abs(function.response(2.0 * np.pi * hz)))) for source, function in functions.items()
    }
    strongest = max(gains, key=lambda source: gains[source])
    units = {model.units.get(source, "") for source in functions}
    unit = {"us": "m/µs", "m": "m/m"}.get(next(iter(units)), "m per unit") if len(units) == 1 else "m per unit"
    curves = [
        of_model(function, hz, source, COLORS[number % len(COLORS)], hidden=source != strongest)
        for number, (source, function) in enumerate(functions.items())
    ]
    caption = (
        f"Frequency response of {output} to each input, with its 95 % band; where there is no band the data do not "
        "determine it. Click a name in the legend to show or hide an input."
    )
    return bode(curves, f"bode-{name}", caption, f"dB of {unit}")


def _frequencies(functions: dict[str, TransferFunction], rate: float) -> NDArray[np.float64]:
    """Return frequencies from a third of the slowest pole to Nyquist's, Hz; the data tell nothing beyond."""
    slowest = min(float(np.min(np.abs(f.poles))) for f in functions.values()) / (2.0 * np.pi)
    highest = 0.5 * rate
    # Frequencies of a Bode plot.
    return np.geomspace(min(max(slowest / 3.0, highest / 3e4), highest / 30.0), highest, 60)


def prediction(result: FlightResult, hidden: Collection[str] = ()) -> Figure | None:
    """Draw measured and predicted x, y and z of a flight, `hidden` models off; nothing without a prediction."""
    parts = [part for model in result.models for part in model.predictions]
    if not parts:
        return None
    whole = next(iter(result.experiments.values()), parts[0].experiment)
    return compare(whole, result.models, present(result.flight), hidden=hidden)


def joint_predictions(group: GroupResult, hidden: Collection[str]) -> dict[str, Figure]:
    """Draw what the joint models make of each flight of a craft, those that judge first; `hidden` models off."""
    flights = [*group.report.held_out, *group.report.training]
    # Points of all flights of a craft together that one line of one model may have: what a page can carry.
    # Fewest points of a line: fewer would no longer show a flight.
    most = int(np.clip(24_000 // max(len(flights), 1), 150, MOST_POINTS))
    figures = {}
    for flight in flights:
        models = [
            replace(result, predictions=parts)
            for result in group.models
            if (parts := tuple(part for part in result.predictions if part.experiment.name == flight))
        ]
        if models:
            whole = models[0].predictions[0].experiment
            figures[flight] = compare(whole, models, hidden=hidden, most=most)
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
    """Draw free runs beside what was measured, each with its residual below.

    The flight's first sample is the zero of what is drawn; `span` is the time shown, `hidden` models wait in the
    legend, `most` are the points of a line.
    """
    runs = [(result, part) for result in models for part in result.predictions]
    outputs = whole.output_names
    axes: list[Drawn] = []
    for number, output in enumerate(outputs):
        shown = [whole.y[:, number]] if measured else []
        shown += [
            part.y_hat[:, number] + _alignment(whole, part, number) for model, part in runs if model.key not in hidden
        ]
        unit = whole.units.get(output, "m")
        axes.append({"title": {"text": f"{output} ({unit})"}, "range": _readable_range(shown or [whole.y[:, number]])})
        if measured:
            axes.append({"title": {"text": f"residual ({unit})", "font": {"size": 10}}, "nticks": 4, "zeroline": True})
    plot = Plot(*axes, x=time_axis(margin(span)), shares=(0.62, 0.38) * len(outputs) if measured else (), gap=0.11)
    named: set[str] = set()
    for number in range(len(outputs)):
        main = (2 if measured else 1) * number
        if measured:
            truth = line(whole.t, whole.y[:, number], "measured", "@ink", width=2.2, most=most)
            plot.add(truth, main, group="measured", legend=number == 0)
        for result, part in runs:
            name, color = result.report.short, model_color(result.key)
            style: Drawn = {"group": name, "visible": "legendonly" if result.key in hidden else True}
            t, y_hat = part.experiment.t, part.y_hat[:, number] + _alignment(whole, part, number)
            if part.drift is not None:
                free = np.flatnonzero(np.isfinite(part.drift[:, number]))
                free = free[:: max(1, -(-2 * len(free) // most))]
                width = part.drift[free, number]
                shade = area(t[free], y_hat[free] - width, y_hat[free] + width, f"drift band, {name}", color, 0.15)
                plot.add(shade, main, **style)
            plot.add(line(t, y_hat, name, color, width=1.6, most=most), main, legend=name not in named, **style)
            named.add(name)
            if measured:
                residual = part.experiment.y[:, number] - part.y_hat[:, number]
                drawn = line(t, residual, f"residual, {name}", color, width=1.2, most=most)
                plot.add(drawn, main + 1, legend=False, **style)
    held = _held_out(runs)
    if held is not None:
        plot.shapes.append(band(held, "@held", 0.10))
        plot.notes.append(band_label(held, "held out"))
    caption = _caption(measured, held, hidden, banded=any(part.drift is not None for _, part in runs))
    room = {"t": 46 + 20 * (len(models) // 3)}
    return plot.figure("prediction", caption, 240 * len(outputs), time=True, margin=room)


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
    """Return the offset between the zero of a part's outputs and that of the whole flight's, m."""
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
