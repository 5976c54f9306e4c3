"""Plots of models: what Plotly accepts, and bands only where something is known."""

import dataclasses

import numpy as np
import plotly.graph_objects as go

from reports.figures.models import horizon_figure, response_figures
from reports.numbers.flight import flight_report
from tests.reports.builders import themed


def test_plotly_accepts_every_figure_and_ids_are_unique(flight):
    figures = [figure for some in response_figures(flight.models[0]).values() for figure in some]
    figures.append(horizon_figure(flight_report(flight).models))
    for figure in figures:
        go.Figure(data=themed(figure.data), layout=themed(figure.layout))  # raises on unknown attributes
        assert not figure.time
    names = [figure.id for figure in figures]
    assert len(set(names)) == len(names) == 7
    assert names[0] == "bode-motors-x"


def test_the_curve_is_the_transfer_functions_own(flight):
    model = flight.models[0].model
    bode = response_figures(flight.models[0])["y"][0]
    gain = next(
        trace for trace in bode.data if trace.get("name") == "m2" and trace["yaxis"] == "y" and "fill" not in trace
    )
    expected = np.abs(model.transfer_functions["y"]["m2"].response(2.0 * np.pi * np.array(gain["x"])))
    assert np.allclose(10.0 ** (np.array(gain["y"]) / 20.0), expected, rtol=2e-3)
    bands = [trace for trace in bode.data if trace.get("fill") == "toself" and trace["legendgroup"] == "m2"]
    assert bands, "this flight determines its model"


def test_what_is_not_determined_has_no_band_and_no_ellipse(flight):
    own = flight.models[0]
    vague = {
        output: {name: dataclasses.replace(f, covariance=1e6 * f.covariance) for name, f in row.items()}
        for output, row in own.model.transfer_functions.items()
    }
    model = dataclasses.replace(own.model, transfer_functions=vague)
    bode, roots = response_figures(dataclasses.replace(own, model=model))["x"]
    assert not [trace for trace in bode.data if trace.get("fill")]
    assert {trace["mode"] for trace in roots.data} == {"markers"}
    assert {trace["opacity"] for trace in roots.data} == {0.35}


def test_the_horizon_plot_shows_the_guesses_beside_the_models(flight):
    figure = horizon_figure(flight_report(flight).models)
    names = [trace["name"] for trace in figure.data if trace["showlegend"]]
    assert names == ["constant position", "constant velocity", "motor PWM"]
    assert horizon_figure([]) is None
