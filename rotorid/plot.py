"""Plots in one line: every function returns a Plotly figure that shows itself in a notebook.

Measured is dark, models are coloured (Okabe and Ito's palette), bands are 95 %.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from logparse import FlightLog
from rotorid.flight_log import FlightLog as LoadedLog
from sysid.frequency.fit import FrequencyFit
from sysid.frequency.response import COHERENT, FrequencyResponse
from sysid.records.experiment import Experiment, ExperimentError, Floats
from sysid.transfer_functions.frequency_response import frequency_response
from sysid.transfer_functions.transfer_function import TransferFunction
from sysid.validation.assessment import Predictor

INK = "#1c2126"
#: Okabe and Ito's colours in an order that stays distinguishable in grey.
PALETTE = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#b8860b")
#: Half-width of a 95 % band in standard deviations.
_BAND = 1.96
_TEMPLATE = go.layout.Template(
    layout={
        "font": {"family": "system-ui, sans-serif", "size": 13, "color": INK},
        "paper_bgcolor": "white",
        "plot_bgcolor": "white",
        "colorway": PALETTE,
        "legend": {"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0},
        "margin": {"l": 70, "r": 20, "t": 60, "b": 50},
        "xaxis": {"gridcolor": "#e3e6e8", "zerolinecolor": "#c8cdd1"},
        "yaxis": {"gridcolor": "#e3e6e8", "zerolinecolor": "#c8cdd1"},
    }
)


def bode(*responses: FrequencyResponse | FrequencyFit | TransferFunction) -> go.Figure:
    """Draw gain, phase and coherence over frequency; measured ones in dark, models in colour."""
    measured = [each for each in responses if isinstance(each, FrequencyResponse)]
    models = [each for each in responses if not isinstance(each, FrequencyResponse)]
    span = np.concatenate([each.hz for each in measured]) if measured else np.array([0.1, 20.0])
    grid = np.geomspace(span.min(), span.max(), 200)
    rows = 3 if measured else 2
    heights = [0.45, 0.35, 0.2][:rows]
    figure = make_subplots(rows=rows, cols=1, shared_xaxes=True, vertical_spacing=0.04, row_heights=heights)
    colours = iter([INK, *PALETTE] if len(measured) == 1 else PALETTE * 3)
    for number, each in enumerate(measured, start=1):
        name = f"measured {each.axis}" + (f" {number}" if len(measured) > 1 else "")
        colour = next(colours)
        gain, phase = 20.0 * np.log10(np.abs(each.response)), np.degrees(np.unwrap(np.angle(each.response)))
        _curve(figure, 1, each.hz, gain, _BAND * each.sigma * 20.0 / np.log(10.0), name, colour)
        _curve(figure, 2, each.hz, phase, _BAND * np.degrees(each.sigma_phase), name, colour, legend=False)
        _curve(figure, 3, each.hz, each.coherence, None, name, colour, legend=False)
    for number, model in enumerate(models, start=1):
        gain, phase = _gain_and_phase(model, grid)
        name, colour = f"model {number}" if number > 1 else "model", next(colours)
        _curve(figure, 1, grid, gain, None, name, colour)
        _curve(figure, 2, grid, phase, None, name, colour, legend=False)
    if measured:
        poor = {"type": "rect", "xref": "x domain", "yref": "y3", "x0": 0, "x1": 1, "y0": 0, "y1": COHERENT}
        figure.add_shape(poor | {"fillcolor": "#9aa3ab", "opacity": 0.15, "line": {"width": 0}, "layer": "below"})
        figure.update_yaxes(title_text="coherence", range=[0, 1.02], row=3, col=1)
    figure.update_yaxes(title_text="gain (dB)", row=1, col=1)
    figure.update_yaxes(title_text="phase (deg)", row=2, col=1)
    figure.update_xaxes(type="log")
    figure.update_xaxes(title_text="frequency (Hz)", row=rows, col=1)
    return figure.update_layout(template=_TEMPLATE, height=240 * rows)


def _gain_and_phase(model: FrequencyFit | TransferFunction, hz: Floats) -> tuple[Floats, Floats]:
    """Return a model's gain [dB] and phase [deg]."""
    if isinstance(model, FrequencyFit):
        found = model.response(hz)
        return 20.0 * np.log10(np.abs(found)), np.degrees(np.unwrap(np.angle(found)))
    function = frequency_response(model, 2.0 * np.pi * hz)
    return 20.0 * np.log10(function.gain), np.degrees(function.phase)


def prediction(
    models: Predictor | Sequence[Predictor], experiment: Experiment, horizon: float | None = None
) -> go.Figure:
    """Draw measured outputs and what models predict of them, each with the residuals below."""
    several = tuple(models) if isinstance(models, Sequence) else (models,)
    outputs = experiment.output_names
    figure = make_subplots(
        rows=2 * len(outputs),
        cols=1,
        shared_xaxes=True,
        vertical_spacing=0.02,
        row_heights=[each for _ in outputs for each in (0.7, 0.3)],
    )
    paths = [model.simulate(experiment) if horizon is None else model.predict(experiment, horizon) for model in several]
    for k, output in enumerate(outputs):
        unit = experiment.units.get(output, "")
        row = 2 * k + 1
        _curve(figure, row, experiment.t, experiment.y[:, k], None, "measured", INK, legend=k == 0)
        for model, path, colour in zip(several, paths, PALETTE * 3, strict=False):
            name = str(getattr(model, "name", type(model).__name__))
            _curve(figure, row, experiment.t, path[:, k], None, name, colour, legend=k == 0)
            _curve(figure, row + 1, experiment.t, experiment.y[:, k] - path[:, k], None, name, colour, legend=False)
        figure.update_yaxes(title_text=f"{output} ({unit})" if unit else output, row=row, col=1)
        figure.update_yaxes(title_text="residual", row=row + 1, col=1)
    figure.update_xaxes(title_text="time on the log's clock (s)", row=2 * len(outputs), col=1)
    return figure.update_layout(template=_TEMPLATE, height=280 * len(outputs))


def track(log: LoadedLog) -> go.Figure:
    """Draw the flown track on a map of equal scales, north up, coloured by height above the start (m)."""
    states = log.trajectory.states
    if log.flight is not None:
        states = states.loc[log.flight.start : log.flight.stop]
    states = states.iloc[:: max(1, len(states) // 5000)]
    marker: dict[str, Any] = {
        "color": -(states["p_d"] - states["p_d"].iloc[0]),
        "colorscale": "Cividis",
        "size": 4,
        "colorbar": {"title": {"text": "height (m)"}},
    }
    figure = go.Figure(go.Scatter(x=states["p_e"], y=states["p_n"], mode="markers", marker=marker, name="flown"))
    figure.update_xaxes(title_text="east (m)")
    figure.update_yaxes(title_text="north (m)", scaleanchor="x", scaleratio=1)
    return figure.update_layout(template=_TEMPLATE, height=520)


def fields(log: FlightLog, *names: str) -> go.Figure:
    """Draw fields of messages over time, one axis for each unit.

    Raises
    ------
    ExperimentError
        The log has no such message or field; the message names those it has.
    """
    units: dict[str, int] = {}
    curves: list[tuple[str, str, Floats, Floats]] = []
    for name in names:
        message, _, field = name.partition(".")
        if message not in log.messages:
            raise ExperimentError(f"{log.path.name} has no message {message}; it has {', '.join(log.messages)}")
        rows = log.messages[message]
        if field not in rows:
            raise ExperimentError(f"{message} has no field {field!r}; it has {', '.join(map(str, rows.columns))}")
        unit = str(rows.attrs.get("units", {}).get(field, ""))
        units.setdefault(unit, len(units) + 1)
        curves.append((name, unit, rows.index.to_numpy(float), rows[field].to_numpy(float)))
    figure = make_subplots(rows=max(len(units), 1), cols=1, shared_xaxes=True, vertical_spacing=0.04)
    for (name, unit, t, values), colour in zip(curves, PALETTE * len(curves), strict=False):
        _curve(figure, units[unit], t, values, None, name, colour)
    for unit, row in units.items():
        figure.update_yaxes(title_text=unit or "no unit logged", row=row, col=1)
    figure.update_xaxes(title_text="time on the log's clock (s)", row=max(len(units), 1), col=1)
    return figure.update_layout(template=_TEMPLATE, height=120 + 240 * max(len(units), 1))


def _curve(
    figure: go.Figure,
    row: int,
    x: Floats,
    y: Floats,
    reach: Floats | None,
    name: str,
    colour: str,
    *,
    legend: bool = True,
) -> None:
    """Add a line, and a band of `reach` to both sides where it is given."""
    if reach is not None:
        known = np.isfinite(reach) & np.isfinite(y)
        edge = np.concatenate([y[known] + reach[known], (y[known] - reach[known])[::-1]])
        band = go.Scatter(
            x=np.concatenate([x[known], x[known][::-1]]),
            y=edge,
            fill="toself",
            fillcolor=colour,
            opacity=0.2,
            line={"width": 0},
            hoverinfo="skip",
            showlegend=False,
            legendgroup=name,
        )
        figure.add_trace(band, row=row, col=1)
    line = go.Scatter(x=x, y=y, name=name, line={"color": colour, "width": 2}, showlegend=legend, legendgroup=name)
    figure.add_trace(line, row=row, col=1)
