"""Plots of frequency responses: Bode with bands, coherence below, poles with their ellipses."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
from scipy.special import chdtri as chi2_isf

from pipeline.results.entry import ResponseCurve
from pipeline.results.rotation import FittedResponse
from reports.figures.figure import Figure, Trace, layout_of
from sysid.frequency.fit import FrequencyFit
from sysid.frequency.response import COHERENT, Floats, FrequencyResponse

#: Half-width of a 95 % band in standard deviations.
_BAND = 1.96

#: Beyond this a band says nothing more.
_WIDEST = 3.0


def bode_figure(fitted: FittedResponse, name: str) -> Figure:
    """Draw gain, phase and coherence of one response with 95 % bands, its model, and plain regression beside it."""
    frf, model = fitted.measured, fitted.model
    hz = _plain(frf.hz, 4)
    gain, phase = frf.gain_db, np.degrees(frf.phase)
    wide = np.minimum(_BAND * np.nan_to_num(frf.sigma, posinf=_WIDEST), _WIDEST)
    in_db, in_deg = wide * 20.0 / np.log(10.0), np.degrees(wide)
    data: list[Trace] = [*_band(hz, gain - in_db, gain + in_db, "y"), *_band(hz, phase - in_deg, phase + in_deg, "y2")]
    if frf.method == "instrument":
        direct = 20.0 * np.log10(np.maximum(np.abs(frf.direct), 1e-12))
        data.append(_line(hz, direct, "plain regression (biased)", "@own", "y", dash="dot"))
    data.append(_line(hz, gain, "measured", "@ink", "y"))
    data.append(_line(hz, phase, "measured", "@ink", "y2", legend=False))
    if model is not None:
        turns = 360.0 * np.round(np.median(phase - np.degrees(np.unwrap(np.angle(model)))) / 360.0)
        data.append(_line(hz, 20.0 * np.log10(np.abs(model)), "model", "@body", "y", dash="dash"))
        data.append(_line(hz, np.degrees(np.unwrap(np.angle(model))) + turns, "model", "@body", "y2", "dash", False))
    data.append(_line(hz, frf.coherence, "coherence", "@ink", "y3", legend=False))
    unit = "dB" if frf.unit == "rad/rad" else f"dB of {frf.unit} per unit"
    layout = layout_of(
        xaxis={"type": "log", "title": {"text": "frequency (Hz)"}, "anchor": "y3"},
        yaxis={"title": {"text": f"gain ({unit})"}, "domain": [0.56, 1.0]},
        yaxis2={"title": {"text": "phase (deg)"}, "domain": [0.24, 0.52]},
        yaxis3={"title": {"text": "coherence"}, "domain": [0.0, 0.2], "range": [0.0, 1.0]},
        shapes=[_shade(low, high) for low, high in _incoherent(frf)],
    )
    caption = (
        f"{frf.axis.capitalize()}: {frf.input} to {frf.output}, measured (dark, with 95 % bands) and fitted (dashed). "
        "Where the coherence is below 0.6 (shaded) nothing counts."
    )
    return Figure(name, caption, data, layout, 520, False)


#: Colours of curves that are laid over each other, and how they are drawn beyond those.
_OVER = ("@ink", "@body", "@mixer", "@joint", "@own")
_DASHES = ("solid", "dash", "dot", "dashdot")


def response_overlays(curves: Sequence[ResponseCurve], prefix: str = "") -> list[Figure]:
    """Lay the responses of several flights over each other, a figure for each axis that two or more tell."""
    figures = []
    for axis in dict.fromkeys(curve.axis for curve in curves):
        mine = [curve for curve in curves if curve.axis == axis and curve.hz]
        # What stands for the controller's outputs has another scale.
        source = Counter(curve.source for curve in mine).most_common(1)[0][0] if mine else ""
        mine = [curve for curve in mine if curve.source == source]
        if len(mine) < 2:
            continue
        data: list[Trace] = []
        for k, curve in enumerate(mine):
            color, dash = _OVER[k % len(_OVER)], _DASHES[k // len(_OVER) % len(_DASHES)]
            hz, phase = _plain(np.array(curve.hz), 4), np.array(curve.phase_deg)
            turns = 360.0 * np.ceil((np.median(phase) - 90.0) / 360.0)
            data.append(_line(hz, np.array(curve.gain_db), curve.flight, color, "y", dash))
            data.append(_line(hz, phase - turns, curve.flight, color, "y2", dash, legend=False))
        layout = layout_of(
            xaxis={"type": "log", "title": {"text": "frequency (Hz)"}, "anchor": "y2"},
            yaxis={"title": {"text": f"gain (dB of {mine[0].unit} per unit)"}, "domain": [0.52, 1.0]},
            yaxis2={"title": {"text": "phase (deg)"}, "domain": [0.0, 0.46]},
        )
        caption = (
            f"{axis.capitalize()}: answers to the command by flight, where it is coherent. Curves that lie apart "
            "by more than a decibel or some degrees are another craft, another load or another battery."
        )
        figures.append(Figure(f"{prefix}responses-{axis}", caption, data, layout, 420, False))
    return figures


def pole_figure(fits: Sequence[tuple[str, FrequencyFit]]) -> Figure | None:
    """Draw the poles of models with 95 % ellipses; None without any."""
    data: list[Trace] = []
    colors = ("@own", "@joint", "@mixer", "@body")
    far, high = 5.0, 2.0
    for k, (label, fit) in enumerate(fits):
        model = fit.transfer_function()
        shown = [
            (pole, covariance)
            for pole, covariance in zip(model.poles, model.pole_covariance, strict=True)
            if np.isfinite(covariance).all() and np.sqrt(np.max(np.linalg.eigvalsh(covariance))) < 0.5 * abs(pole) + 1.0
        ]
        for j, (pole, covariance) in enumerate(shown):
            far, high = max(far, abs(pole.real)), max(high, abs(pole.imag))
            mark = {"x": [round(pole.real, 3)], "y": [round(pole.imag, 3)], "type": "scatter", "mode": "markers"}
            style = {"symbol": "x", "size": 9, "color": colors[k % 4]}
            data.append(mark | {"name": label, "showlegend": j == 0, "marker": style})
            values, vectors = np.linalg.eigh(covariance)
            radii = np.sqrt(np.maximum(values, 0.0) * chi2_isf(2, 0.05))
            angle = np.linspace(0.0, 2.0 * np.pi, 40)
            around = vectors @ (radii[:, None] * np.array([np.cos(angle), np.sin(angle)]))
            x, y = _plain(pole.real + around[0], 3), _plain(pole.imag + around[1], 3)
            outline = {"type": "scatter", "mode": "lines", "x": x, "y": y, "showlegend": False, "hoverinfo": "skip"}
            data.append(outline | {"name": label, "line": {"color": colors[k % 4], "width": 1}})
    if not data:
        return None
    layout = layout_of(
        xaxis={"title": {"text": "real part (rad/s)"}, "range": [-1.2 * far, 0.2 * far]},
        yaxis={"title": {"text": "imaginary part (rad/s)"}, "range": [-1.2 * high, 1.2 * high]},
    )
    return Figure("poles", "Poles of the models with 95 % ellipses.", data, layout, 360, False)


def _incoherent(frf: FrequencyResponse) -> list[tuple[float, float]]:
    """Return the stretches of frequency in which the coherence is below 0.6."""
    bad = np.concatenate([[False], frf.coherence < COHERENT, [False]])
    edges = np.flatnonzero(np.diff(bad.astype(int)))
    last = len(frf.hz) - 1
    return [
        (float(frf.hz[max(a - 1, 0)]), float(frf.hz[min(b, last)]))
        for a, b in zip(edges[::2], edges[1::2], strict=True)
    ]


def _shade(low: float, high: float) -> dict[str, object]:
    """Tint a stretch of frequency over all three plots."""
    shape = {"type": "rect", "xref": "x", "yref": "paper", "x0": low, "x1": high, "y0": 0, "y1": 1}
    return shape | {"fillcolor": "@grid", "opacity": 0.35, "line": {"width": 0}, "layer": "below"}


def _band(hz: list[float], low: Floats, high: Floats, axis: str) -> list[Trace]:
    edge: Trace = {"type": "scatter", "mode": "lines", "yaxis": axis, "line": {"width": 0}, "showlegend": False}
    edge |= {"hoverinfo": "skip"}
    return [
        edge | {"x": hz, "y": _plain(low, 3), "name": "95 %"},
        edge | {"x": hz, "y": _plain(high, 3), "name": "95 %", "fill": "tonexty", "fillcolor": "@grid"},
    ]


def _line(
    hz: list[float], values: Floats, name: str, color: str, axis: str, dash: str = "solid", legend: bool = True
) -> Trace:
    return {
        "type": "scatter",
        "mode": "lines",
        "x": hz,
        "y": _plain(values, 3),
        "name": name,
        "yaxis": axis,
        "showlegend": legend,
        "line": {"color": color, "width": 2, "dash": dash},
    }


def _plain(values: Floats, decimals: int) -> list[float]:
    return [round(float(value), decimals) for value in np.nan_to_num(values)]
