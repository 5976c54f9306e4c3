"""Plots of the models themselves: how far ahead they predict, their frequency responses, poles and zeros."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.results.flight import ModelResult
from pipeline.results.model_report import HorizonRow, ModelReport
from pipeline.results.verdict import Trust
from reports.figures.figure import Drawn, Figure, Trace, layout_of, model_color, plotly_text, short
from reports.pole_map import INPUT_COLORS, pole_map
from sysid import ClosedLoopModel, TransferFunction, TransferFunctionModel
from sysid.transfer_functions.frequency_response import frequency_response

#: Frequencies of a Bode plot.
POINTS = 60

Floats = NDArray[np.float64]


def off_by_default(models: Sequence[ModelReport]) -> set[str]:
    """Return the keys of models that cannot be trusted, where there are others."""
    trust = {model.key: model.verdict.trust for model in models if model.kind}
    poor = {key for key, word in trust.items() if word is Trust.NO}
    return poor if len(poor) < len(trust) else set()


def horizon_figure(
    models: Sequence[ModelReport], name: str = "horizons", hidden: Collection[str] = ()
) -> Figure | None:
    """Draw the error over the time ahead, for every model and the guesses without one.

    Parameters
    ----------
    models : sequence of ModelReport
    name : str
        Unique in the page.
    hidden : collection of str
        Keys of models that are off at first.
    """
    judged = [result for result in models if result.horizons]
    if not judged:
        return None
    outputs = list(dict.fromkeys(row.output for row in judged[0].horizons))
    block = 1.0 / len(outputs)
    data: list[Trace] = []
    axes: Drawn = {}
    for number, output in enumerate(outputs):
        suffix = "" if number == 0 else str(number + 1)
        guesses = (
            ("constant position", "constant_position_m", "dash"),
            ("constant velocity", "constant_velocity_m", "dot"),
        )
        rows = [row for row in judged[0].horizons if row.output == output]
        for label, key, dash in guesses:
            data.append(_curve(rows, key, label, "@quiet", dash, suffix, number == 0))
        for result in judged:
            rows = [row for row in result.horizons if row.output == output]
            label, color = short(result.title), model_color(result.key)
            curve = _curve(rows, "rmse_m", label, color, "solid", suffix, number == 0)
            data.append(curve | {"visible": "legendonly" if result.key in hidden else True})
        top = 1.0 - number * block
        axes[f"yaxis{suffix}"] = {
            "domain": [top - 0.84 * block, top],
            "type": "log",
            "title": {"text": f"RMSE {output} (m)"},
            "tickformat": "~g",
            "nticks": 5,
        }
    ticks = sorted({row.horizon_s for result in judged for row in result.horizons})
    axes["xaxis"] = {
        "type": "log",
        "title": {"text": "seconds ahead"},
        "tickvals": ticks,
        "ticktext": [f"{tick:g}" for tick in ticks],
        "anchor": f"y{len(outputs)}" if len(outputs) > 1 else "y",
    }
    layout = layout_of(**axes)
    layout["margin"] = layout["margin"] | {"l": 72, "t": 46 + 20 * ((len(judged) + 2) // 3)}
    caption = (
        "How far predictions err that start from the measured motion and know the inputs, on flight time that the "
        "models have not seen. A model is worth its name where its line runs below both grey ones."
    )
    return Figure(name, caption, data, layout, 100 + 200 * len(outputs), time=False)


def _curve(rows: Sequence[HorizonRow], key: str, label: str, color: str, dash: str, suffix: str, legend: bool) -> Trace:
    return {
        "type": "scatter",
        "mode": "lines+markers",
        "x": [row.horizon_s for row in rows],
        "y": [None if (error := getattr(row, key)) is None else _short(error) for row in rows],
        "name": plotly_text(label),
        "legendgroup": label,
        "showlegend": legend,
        "yaxis": f"y{suffix}",
        "line": {"color": color, "width": 2, "dash": dash},
        "marker": {"color": color, "size": 5},
        "hovertemplate": f"%{{x:g}} s: %{{y:.3g}} m<extra>{plotly_text(label)}</extra>",
    }


def response_figures(result: ModelResult, prefix: str = "") -> dict[str, list[Figure]]:
    """Draw Bode plot, poles and zeros of each output of a model of transfer functions; nothing for other models.

    Returns
    -------
    dict of str to list of Figure
        By output.
    """
    model = result.model
    if not isinstance(model, TransferFunctionModel | ClosedLoopModel):
        return {}
    figures = {}
    for output in model.output_names:
        functions = {
            name: model.transfer_functions[output][name]
            for name in model.input_names
            if np.any(model.transfer_functions[output][name].num)
        }
        if functions:
            name = f"{prefix}{result.key}-{output}"
            figures[output] = [_bode(model, output, functions, name), pole_map(functions, name)]
    return figures


def _bode(
    model: TransferFunctionModel | ClosedLoopModel, output: str, functions: dict[str, TransferFunction], name: str
) -> Figure:
    omega = _frequencies(functions, model.rate)
    responses = {source: frequency_response(function, omega) for source, function in functions.items()}
    # The input that moves the output most is shown first; all others wait in the legend.
    strongest = max(responses, key=lambda source: float(np.median(responses[source].gain)))
    units = {model.units.get(source, "") for source in functions}
    unit = {"us": "m/µs", "m": "m/m"}.get(next(iter(units)), "m per unit") if len(units) == 1 else "m per unit"
    data: list[Trace] = []
    for number, (source, response) in enumerate(responses.items()):
        color = INPUT_COLORS[number % len(INPUT_COLORS)]
        shared: Trace = {
            "type": "scatter",
            "mode": "lines",
            "legendgroup": source,
            "visible": True if source == strongest else "legendonly",
        }
        phase = np.degrees(response.phase)
        reach = 1.96 * np.degrees(response.sigma_phase)
        low, high = response.band()
        for values, lower, upper, axis, words in (
            (response.gain, low, high, "y", f"%{{x:.3g}} rad/s: %{{y:.3g}} {unit}"),
            (phase, phase - reach, phase + reach, "y2", "%{x:.3g} rad/s: %{y:.0f}°"),
        ):
            data += _band(omega, lower, upper, response.determined, color, shared | {"yaxis": axis})
            data.append(
                shared
                | {
                    "x": _rounded(omega),
                    "y": _rounded(values),
                    "name": plotly_text(source),
                    "showlegend": axis == "y",
                    "yaxis": axis,
                    "line": {"color": color, "width": 2},
                    "hovertemplate": f"{words}<extra>{plotly_text(source)}</extra>",
                }
            )
    layout = layout_of(
        xaxis={"type": "log", "title": {"text": "frequency (rad/s)"}, "anchor": "y2", "dtick": 1},
        yaxis={
            "type": "log",
            "title": {"text": f"gain ({unit})"},
            "domain": [0.46, 1.0],
            "exponentformat": "power",
            "dtick": 1,
        },
        yaxis2={"title": {"text": "phase (°)"}, "domain": [0.0, 0.40], "nticks": 6},
    )
    layout["margin"] = layout["margin"] | {"l": 70, "t": 64}
    caption = (
        f"Frequency response of {output} to each input, with its 95 % band; where there is no band the data do not "
        "determine it. Click a name in the legend to show or hide an input."
    )
    return Figure(f"bode-{name}", caption, data, layout, 460, time=False)


def _band(
    omega: Floats, lower: Floats, upper: Floats, known: NDArray[np.bool_], color: str, shared: Trace
) -> list[Trace]:
    """Shade a band over each unbroken run of frequencies at which it is known."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], known, [False]]).astype(int)))
    return [
        shared
        | {
            "x": _rounded(np.concatenate([omega[first:last], omega[first:last][::-1]])),
            "y": _rounded(np.concatenate([upper[first:last], lower[first:last][::-1]])),
            "fill": "toself",
            "fillcolor": color,
            "opacity": 0.22,
            "line": {"width": 0},
            "hoverinfo": "skip",
            "showlegend": False,
        }
        for first, last in zip(edges[::2], edges[1::2], strict=True)
        if last - first > 1
    ]


def _frequencies(functions: dict[str, TransferFunction], rate: float) -> Floats:
    """From a third of the slowest pole to the Nyquist frequency; the data tell nothing beyond."""
    slowest = min(float(np.min(np.abs(f.poles))) for f in functions.values())
    highest = np.pi * rate
    return np.logspace(np.log10(min(max(slowest / 3.0, highest / 3e4), highest / 30.0)), np.log10(highest), POINTS)


def _rounded(values: Floats) -> list[float | None]:
    return [_short(float(value)) if np.isfinite(value) else None for value in values]


def _short(value: float) -> float:
    """Keep four digits, which is what a plot shows."""
    return float(f"{value:.4g}")
