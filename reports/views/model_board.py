"""The models of a flight in one place: what their residuals still hold, and how each answers an input."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from pipeline.results.failure import present
from pipeline.results.flight import ModelResult
from reports.figures.figure import Drawn, Figure, Trace, layout_of, line, model_color, plotly_text, short
from reports.figures.models import response_figures
from reports.pole_map import INPUT_COLORS
from sysid import ClosedLoopModel, TransferFunction, TransferFunctionModel
from sysid.transfer_functions.frequency_response import LARGEST_SIGMA, frequency_response

Floats = NDArray[np.float64]

#: Length of a step response, s, and its samples.
_SECONDS, _SAMPLES = 5.0, 101
#: Standard deviations to either side that hold 95 % and 99 % of a normal distribution.
_95, _99 = 1.96, 2.576
#: Places of the page that show what the reader chooses, by what they begin with.
PLACES = ("bode", "step", "roots")


@dataclass(frozen=True, slots=True)
class Board:
    """What the page shows of all models together.

    `choices` are (value, label) of each model and output, determined ones first; figure ``PLACE-VALUE`` is what each of
    `PLACES` shows of it.
    """

    residuals: Figure | None
    choices: tuple[tuple[str, str], ...]
    figures: tuple[Figure, ...]
    captions: Mapping[str, tuple[str, int]]  #: Of each place with anything to show: its words and height, px.

    @property
    def every(self) -> list[Figure]:
        """All plots."""
        return [*([] if self.residuals is None else [self.residuals]), *self.figures]

    def within(self, prefix: str) -> Board:
        """Return the same board where a page has several, its plots and places called apart."""
        return Board(
            None if self.residuals is None else replace(self.residuals, id=prefix + self.residuals.id),
            self.choices,
            tuple(replace(each, id=prefix + each.id, place=prefix + each.place) for each in self.figures),
            {prefix + place: caption for place, caption in self.captions.items()},
        )


def model_board(models: Sequence[ModelResult], hidden: Collection[str]) -> Board:
    """Draw the board.

    Parameters
    ----------
    models : sequence of ModelResult
    hidden : collection of str
        Keys of models that nobody should trust: off until the reader wants them.
    """
    ordered = sorted(models, key=lambda each: each.key in hidden)
    figures: list[Figure] = []
    choices = []
    for result in ordered:
        steps = step_figures(result)
        for output, drawn in response_figures(result).items():
            choices.append((f"{result.key}-{output}", f"{short(result.title)} → {output}"))
            places = [each.id.partition("-")[0] for each in drawn]
            figures += [replace(each, place=place) for each, place in zip(drawn, places, strict=True)]
            if output in steps:
                figures.append(replace(steps[output], place="step"))
    captions = {figure.place: (figure.caption, figure.height) for figure in reversed(figures)}
    return Board(
        residual_figure(models, hidden),
        tuple(choices),
        tuple(figures),
        {each: captions[each] for each in PLACES if each in captions},
    )


def residual_figure(models: Sequence[ModelResult], hidden: Collection[str]) -> Figure | None:
    """Draw correlations of the one-sample-ahead errors with earlier ones and with earlier inputs, and their bands."""
    judged = [
        (result, validation.residuals)
        for result in models
        if (validation := present(result.validation)) is not None and validation.residuals
    ]
    if not judged:
        return None
    outputs = list(dict.fromkeys(output for _, tests in judged for output in tests))
    row = 1.0 / len(outputs)
    data: list[Trace] = []
    axes: Drawn = {}
    shapes: list[Drawn] = []
    for number, output in enumerate(outputs):
        left, right = (f"{2 * number + side}" if 2 * number + side > 1 else "" for side in (1, 2))
        upper = 1.0 - number * row
        for result, tests in judged:
            test = tests.get(output)
            if test is None:
                continue
            lags = np.arange(1, test.lags + 1)
            strongest = max(
                test.crosscorrelation.items(), key=lambda each: float(np.max(np.abs(each[1]))), default=None
            )
            name = short(result.title)
            curves = [(left, test.autocorrelation, name)]
            if strongest is not None:
                curves.append((right, strongest[1], f"{name}, {strongest[0]}"))
            for axis, values, label in curves:
                trace = line(
                    lags, values, plotly_text(label), model_color(result.key), 1.5, 3, "lag %{x:.0f}: %{y:.2f}"
                )
                data.append(
                    trace
                    | {
                        "xaxis": f"x{axis}",
                        "yaxis": f"y{axis}",
                        "legendgroup": name,
                        "showlegend": axis == "",
                        "name": plotly_text(name),
                        "visible": "legendonly" if result.key in hidden else True,
                    }
                )
        band = max(tests[output].band for _, tests in judged if output in tests)
        for axis, limit, domain in ((left, band, [0.0, 0.45]), (right, _99, [0.55, 1.0])):
            shapes += [_limit(f"x{axis}", f"y{axis}", sign * limit) for sign in (1.0, -1.0)]
            axes[f"xaxis{axis}"] = {"domain": domain, "anchor": f"y{axis}", "nticks": 6}
            axes[f"yaxis{axis}"] = {"domain": [upper - 0.78 * row, upper], "anchor": f"x{axis}", "nticks": 4}
        axes[f"yaxis{left}"]["title"] = {"text": f"{output}: with itself", "font": {"size": 10}}
        axes[f"yaxis{right}"]["title"] = {"text": "with an input", "font": {"size": 10}}
    for axis in (left, right):
        axes[f"xaxis{axis}"]["title"] = {"text": "lag (samples)"}
    layout = layout_of(**axes, shapes=shapes)
    layout["margin"] = layout["margin"] | {"t": 64}
    caption = (
        "Correlation of the errors one sample ahead with earlier errors (left) and with the input they depend on "
        "most (right, in standard deviations). A better model would foretell what lies outside the 99 % bounds."
    )
    return Figure("residuals", caption, data, layout, 80 + 150 * len(outputs), time=False)


def _limit(x: str, y: str, value: float) -> Drawn:
    return {
        "type": "line",
        "xref": f"{x} domain",
        "yref": y,
        "x0": 0,
        "x1": 1,
        "y0": value,
        "y1": value,
        "line": {"color": "@bad", "width": 1, "dash": "dash"},
    }


def step_figures(result: ModelResult) -> dict[str, Figure]:
    """Draw the answer of each output to a step of each input; nothing for other models than transfer functions."""
    model = result.model
    if not isinstance(model, TransferFunctionModel | ClosedLoopModel):
        return {}
    figures = {}
    for output in model.output_names:
        functions = {name: each for name, each in model.transfer_functions[output].items() if np.any(each.num)}
        if functions:
            figures[output] = _step(model, output, functions, f"step-{result.key}-{output}")
    return figures


def _step(
    model: TransferFunctionModel | ClosedLoopModel, output: str, functions: Mapping[str, TransferFunction], name: str
) -> Figure:
    # The same input as in the frequency response is shown first.
    omega = np.logspace(-1.0, np.log10(np.pi * model.rate), 30)
    gains = {source: float(np.median(frequency_response(each, omega).gain)) for source, each in functions.items()}
    strongest = max(gains, key=lambda source: gains[source])
    t = np.linspace(0.0, _SECONDS, _SAMPLES)
    data: list[Trace] = []
    for number, (source, function) in enumerate(functions.items()):
        color = INPUT_COLORS[number % len(INPUT_COLORS)]
        y = step_response(function, t)
        style = {"legendgroup": source, "visible": True if source == strongest else "legendonly"}
        sigma = step_sigma(function, t) if source == strongest else None
        if sigma is not None and np.all(sigma[1:] <= LARGEST_SIGMA * np.max(np.abs(y))):
            around = np.concatenate([y + _95 * sigma, (y - _95 * sigma)[::-1]])
            outline = line(np.concatenate([t, t[::-1]]), around, source, color, 0.0, 9, time=np.zeros(2 * len(t)))
            data.append(
                outline
                | style
                | {"fill": "toself", "fillcolor": color, "opacity": 0.2, "hoverinfo": "skip", "showlegend": False}
            )
        trace = line(t, y, plotly_text(source), color, 2.0, 9, "%{x:.2f} s: %{y:.3g}")
        data.append(trace | style | {"showlegend": True})
    units = {model.units.get(source, "") for source in functions}
    unit = {"us": "m per µs", "m": "m per m"}.get(next(iter(units)), "m per unit") if len(units) == 1 else "m per unit"
    layout = layout_of(
        xaxis={"title": {"text": "time after the step (s)"}},
        yaxis={"title": {"text": f"{output} ({unit})"}, "exponentformat": "power"},
    )
    layout["margin"] = layout["margin"] | {"l": 70, "t": 64}
    caption = (
        "Answer to a step of each input, with its 95 % band where the data determine it. Click a name in the legend to "
        "show or hide an input."
    )
    return Figure(name, caption, data, layout, 330, time=False)


def step_response(function: TransferFunction, t: Floats) -> Floats:
    """Return the answer to a unit step at t = 0.

    Parameters
    ----------
    function : TransferFunction
        Proper; its delay counts.
    t : ndarray, shape (n,)
        Evenly spaced from 0, s.
    """
    num, den = np.trim_zeros(function.num, "f"), function.den
    order = len(den) - 1
    if order == 0:
        return np.where(t >= function.delay, float(num[0] / den[0]), 0.0)
    padded = np.concatenate([np.zeros(order + 1 - len(num)), num]) / den[0]
    monic = den / den[0]
    direct = padded[0]
    # Controllable form, with the step as one more state that stays.
    system = np.zeros((order + 1, order + 1))
    system[0, :order] = -monic[1:]
    system[1:order, : order - 1] = np.eye(order - 1)
    system[0, order] = 1.0
    states = np.zeros((order + 1, 1))
    states[order] = 1.0
    out = np.append(padded[1:] - direct * monic[1:], direct)
    # What is far from stable is soon beyond all numbers.
    with np.errstate(over="ignore", invalid="ignore"):
        ahead = expm(system * (t[1] - t[0]))
        # As many more states again with each power of the step.
        while states.shape[1] < len(t):
            states = np.hstack([states, ahead @ states])
            ahead = ahead @ ahead
        y = out @ states[:, : len(t)]
    return np.asarray(np.interp(t - function.delay, t, y, left=0.0)) if function.delay else y


def step_sigma(function: TransferFunction, t: Floats) -> Floats | None:
    """Return the standard deviation of `step_response` by the delta method; None without a covariance."""
    deviations = function.standard_deviation
    if function.covariance is None or deviations is None:
        return None
    slopes = []
    for k, deviation in enumerate(deviations):
        reach = 1e-3 * deviation or 1e-9
        ends = []
        for sign in (1.0, -1.0):
            num, den = function.num.copy(), function.den.copy()
            if k < len(num):
                num[k] += sign * reach
            else:
                den[k - len(num) + 1] += sign * reach
            ends.append(step_response(replace(function, num=num, den=den), t))
        with np.errstate(over="ignore", invalid="ignore"):
            slopes.append((ends[0] - ends[1]) / (2.0 * reach))
    jacobian = np.array(slopes).T
    with np.errstate(over="ignore", invalid="ignore"):
        variance = np.einsum("ki,ij,kj->k", jacobian, function.covariance, jacobian)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))
