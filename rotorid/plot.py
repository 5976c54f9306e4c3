"""Plots in one line: every function returns a Plotly figure that shows itself in a notebook.

They are those of the pages. Measured is dark, models are coloured (Okabe and Ito's palette), bands are 95 %.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from logparse import FlightLog
from logparse.signals import logged_signal
from pipeline.flight.identification import model_result
from pipeline.results.failure import Failure
from pipeline.results.flight import Prediction
from reports.figures.figure import COLORS, MODEL_COLORS
from reports.figures.flight import track_figure
from reports.figures.frequency import Curve, measured, of_model
from reports.figures.frequency import bode as bode_plot
from reports.figures.models import compare
from reports.pages.signals import signal_figure
from rotorid.flight_log import FlightLog as LoadedLog
from sysid.frequency.fitted import FrequencyFit
from sysid.frequency.response import FrequencyResponse
from sysid.records.experiment import Experiment
from sysid.transfer_functions.transfer_function import TransferFunction
from sysid.validation.assessment import Predictor

if TYPE_CHECKING:
    import plotly.graph_objects as go


def bode(*responses: FrequencyResponse | FrequencyFit | TransferFunction) -> go.Figure:
    """Draw gain, phase and coherence over frequency; measured ones in dark, models in colour."""
    estimates = [response for response in responses if isinstance(response, FrequencyResponse)]
    models = [response for response in responses if not isinstance(response, FrequencyResponse)]
    span = np.concatenate([response.hz for response in estimates]) if estimates else np.array([0.1, 20.0])
    grid = np.geomspace(span.min(), span.max(), 200)
    colors = iter(("@ink", *COLORS) if len(estimates) == 1 else COLORS * 3)
    curves = [
        measured(response, f"measured {response.axis}" + (f" {number}" if len(estimates) > 1 else ""), next(colors))
        for number, response in enumerate(estimates, start=1)
    ]
    for number, model in enumerate(models, start=1):
        name = f"model {number}" if number > 1 else "model"
        if isinstance(model, FrequencyFit):
            curves.append(Curve.of(grid, model.response(grid), name, next(colors)))
        else:
            curves.append(of_model(model, grid, name, next(colors)))
    return bode_plot(curves, "bode", "").plotly()


def prediction(
    models: Predictor | Sequence[Predictor], experiment: Experiment, horizon: float | None = None
) -> go.Figure:
    """Draw measured outputs and what models predict of them, each with the residuals below."""
    results = []
    for number, model in enumerate(models if isinstance(models, Sequence) else (models,)):
        path = model.simulate(experiment) if horizon is None else model.predict(experiment, horizon)
        name = str(getattr(model, "name", type(model).__name__))
        part = Prediction(experiment=experiment, y_hat=path, training=False)
        key = tuple(MODEL_COLORS)[number % len(MODEL_COLORS)]
        results.append(model_result(key, name, Failure("plot", "not asked for"), predictions=(part,)))
    return compare(experiment, results).plotly()


def track(log: LoadedLog) -> go.Figure:
    """Draw the flown track on a map of equal scales, north up, coloured by height above the start (m)."""
    states = log.trajectory.states
    if log.flight is not None:
        states = states.loc[log.flight.start : log.flight.stop]
    return track_figure(states).plotly()


def fields(log: FlightLog, *names: str) -> go.Figure:
    """Draw fields of messages, or columns of canonical tables, over time, one panel for each unit.

    Raises
    ------
    SignalError
        The log has no such message or field; the message names those it has.
    """
    return signal_figure([logged_signal(log, name) for name in names]).plotly()
