"""Plots of frequency responses, measured and of models: gain, phase and coherence with 95 % bands, poles, zeros."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.runs import runs
from pipeline.results.fleet import ResponseCurve
from pipeline.results.rotation import FittedResponse
from pipeline.results.span import Span
from reports.figures.figure import COLORS, DASHES, Drawn, Figure, Plot, area, band, curve, marks
from sysid import TransferFunction
from sysid.frequency.fitted import FrequencyFit
from sysid.frequency.response import COHERENT, FrequencyResponse
from sysid.transfer_functions.frequency_response import frequency_response
from sysid.transfer_functions.transfer_function import Root, poles, zeros

Floats = NDArray[np.float64]

#: Colours of curves that are laid over each other.
_OVER = ("@ink", "@body", "@mixer", "@joint", "@own")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Curve:
    """A response over frequency, shape (n,), as it is drawn."""

    name: str
    color: str
    dash: str = "solid"
    hz: Floats
    gain_db: Floats
    phase_deg: Floats
    #: Standard deviations of ln gain and of the phase, rad; without a band where infinite, None without any.
    sigma: tuple[Floats, Floats] | None = None
    coherence: Floats | None = None
    group: str = ""  #: Curves of one group are shown and hidden together.
    hidden: bool = False  #: Waits in the legend.

    @classmethod
    def of(cls, hz: Floats, response: NDArray[np.complex128], name: str, color: str, dash: str = "solid") -> Curve:
        """Return a response without errors."""
        gain = 20.0 * np.log10(np.maximum(np.abs(response), 1e-300))
        phase = np.degrees(np.unwrap(np.angle(response)))
        return cls(name=name, color=color, dash=dash, hz=hz, gain_db=gain, phase_deg=phase)


def measured(frf: FrequencyResponse, name: str = "measured", color: str = "@ink") -> Curve:
    """Return a measured response as it is drawn."""
    return Curve(
        name=name,
        color=color,
        hz=frf.hz,
        gain_db=frf.gain_db,
        phase_deg=np.degrees(frf.phase),
        sigma=(frf.sigma, frf.sigma_phase),
        coherence=frf.coherence,
    )


def of_model(function: TransferFunction, hz: Floats, name: str, color: str, *, hidden: bool = False) -> Curve:
    """Return the response of a transfer function as it is drawn, with a band where the data determine it."""
    response = frequency_response(function, 2.0 * np.pi * hz)
    sigma = tuple(
        np.where(response.determined, values, np.inf) for values in (response.sigma_gain, response.sigma_phase)
    )
    return Curve(
        name=name,
        color=color,
        hz=hz,
        gain_db=20.0 * np.log10(np.maximum(response.gain, 1e-300)),
        phase_deg=np.degrees(response.phase),
        sigma=(sigma[0], sigma[1]),
        group=name,
        hidden=hidden,
    )


def bode(curves: Sequence[Curve], name: str, caption: str, unit: str = "dB", *, shaded: Sequence[Span] = ()) -> Figure:
    """Draw gain, phase and, where one is known, coherence; `shaded` frequencies [Hz] do not count."""
    coherent: list[str | Drawn] = []
    if any(response.coherence is not None for response in curves):
        coherent = [{"title": {"text": "coherence"}, "range": [0.0, 1.0]}]
    axis = {"type": "log", "title": {"text": "frequency (Hz)"}}
    panels: list[str | Drawn] = [f"gain ({unit.replace('^2', '²')})", "phase (deg)", *coherent]
    plot = Plot(*panels, x=axis, shares=(48.0, 32.0, 20.0) if coherent else (54.0, 46.0), gap=0.1)
    first = None
    for response in curves:
        # What is a whole turn away is the same.
        about = float(np.nanmedian(response.phase_deg)) if np.isfinite(response.phase_deg).any() else 0.0
        turns = np.ceil((about - 90.0) / 360.0) if first is None else np.round((about - first) / 360.0)
        phase = response.phase_deg - 360.0 * turns
        first = about - 360.0 * turns if first is None else first
        style: Drawn = {"visible": "legendonly"} if response.hidden else {}
        gain_band, phase_band = (None, None) if response.sigma is None else response.sigma
        for panel, values, sigma, factor, hover in (
            (0, response.gain_db, gain_band, 20.0 / np.log(10.0), "%{x:.3g} Hz: %{y:.3g} dB"),
            (1, phase, phase_band, np.degrees(1.0), "%{x:.3g} Hz: %{y:.0f}°"),
        ):
            known = runs(np.isfinite(sigma)) if sigma is not None and np.any(sigma) else ()
            for part in (slice(first, last) for first, last in known if last - first > 1):
                assert sigma is not None
                # A 95 % band, at most three times the gain wide.
                reach = factor * np.minimum(1.96 * sigma[part], 3.0)
                shade = area(
                    response.hz[part], values[part] - reach, values[part] + reach, response.name, response.color
                )
                plot.add(shade, panel, group=response.group, **style)
            line = curve(response.hz, values, response.name, response.color, 2.0, response.dash, hover)
            plot.add(line, panel, group=response.group, legend=panel == 0, **style)
        if response.coherence is not None:
            plot.add(curve(response.hz, response.coherence, response.name, response.color), 2, legend=False)
    plot.shapes += [band(span, "@grid", 0.35) for span in shaded]
    return plot.figure(name, caption, 520 if coherent else 440, margin={"l": 70, "t": 64})


def bode_figure(fitted: FittedResponse, name: str) -> Figure:
    """Draw one measured response, its model, and plain regression beside it."""
    hz, gain, phase, coherence, sigma, sigma_phase = (
        np.array(values, dtype=np.float64)
        for values in (
            *(fitted.hz, fitted.gain_db, fitted.phase_deg, fitted.coherence),
            *(fitted.sigma, fitted.sigma_phase),
        )
    )
    errors = (sigma, sigma_phase)
    curves = [
        Curve(name="measured", color="@ink", hz=hz, gain_db=gain, phase_deg=phase, sigma=errors, coherence=coherence)
    ]
    for drawn, label, color, dash in (
        (fitted.direct, "plain regression (biased)", "@own", "dot"),
        (fitted.model, "model", "@body", "dash"),
    ):
        if drawn:
            gain, phase = (np.array(values, dtype=np.float64) for values in drawn)
            curves.append(Curve(name=label, color=color, dash=dash, hz=hz, gain_db=gain, phase_deg=phase))
    unit = "dB" if fitted.unit == "rad/rad" else f"dB of {fitted.unit} per unit"
    caption = (
        f"{fitted.axis.capitalize()}: {fitted.input} to {fitted.output}, measured (dark, with 95 % bands) and fitted "
        "(dashed). Where the coherence is below 0.6 (shaded) nothing counts."
    )
    return bode(curves, name, caption, unit, shaded=_incoherent(hz, coherence))


def response_overlays(curves: Sequence[ResponseCurve], prefix: str = "") -> list[Figure]:
    """Overlay the responses of several flights, a figure for each axis that two or more have."""
    figures = []
    for axis in dict.fromkeys(response.axis for response in curves):
        mine = [response for response in curves if response.axis == axis and response.hz]
        # What stands for the controller's outputs has another scale.
        source = Counter(response.source for response in mine).most_common(1)[0][0] if mine else ""
        mine = [response for response in mine if response.source == source]
        if len(mine) < 2:
            continue
        drawn = [
            Curve(
                name=response.flight,
                color=_OVER[k % len(_OVER)],
                dash=DASHES[k // len(_OVER) % len(DASHES)],
                hz=np.array(response.hz),
                gain_db=np.array(response.gain_db),
                phase_deg=np.array(response.phase_deg),
            )
            for k, response in enumerate(mine)
        ]
        caption = (
            f"{axis.capitalize()}: answers to the command by flight, where it is coherent. Curves that lie apart "
            "by more than a decibel or some degrees are another craft, another load or another battery."
        )
        figures.append(bode(drawn, f"{prefix}responses-{axis}", caption, f"dB of {mine[0].unit} per unit"))
    return figures


def pole_figure(fits: Sequence[tuple[str, FrequencyFit]]) -> Figure | None:
    """Draw the poles of fits to frequency responses; None without any."""
    by_fit = {label: (poles(fit.transfer_function()), ()) for label, fit in fits}
    return root_map(by_fit, "poles") if by_fit else None


def pole_map(functions: Mapping[str, TransferFunction], name: str) -> Figure:
    """Draw poles and zeros of the transfer functions to one output, by input."""
    return root_map(
        {source: (poles(function), zeros(function)) for source, function in functions.items()}, f"roots-{name}"
    )


def root_map(by_source: Mapping[str, tuple[Sequence[Root], Sequence[Root]]], name: str) -> Figure:
    """Draw poles and zeros by what they are of, with 95 % ellipses of those that are determined.

    Distances from the origin are logarithmic where the known roots span decades; directions, and with them damping, are
    kept.
    """
    known = [root.value for kinds in by_source.values() for roots in kinds for root in roots if root.determined]
    sizes = [abs(root) for root in known if abs(root) > 0.0]
    # Ratio of the fastest to the slowest known root from which a linear scale squeezes the slow ones together.
    unit = min(sizes) if sizes and max(sizes) > 20.0 * min(sizes) else None

    def place(values: Sequence[complex] | NDArray[np.complex128]) -> NDArray[np.complex128]:
        roots = np.asarray(values, dtype=np.complex128)
        if unit is None:
            return roots
        size = np.abs(roots)
        return np.asarray(roots * np.log10(1.0 + size / unit) / np.where(size > 0.0, size, 1.0))

    axis: Drawn = {"zeroline": True}
    if known:
        # Roots that nobody knows may lie anywhere; those that are known decide what is shown at first.
        at = place(known)
        reach = 1.15 * float(np.max(np.abs(at)))
        right = max(0.3 * reach, 1.1 * float(np.max(at.real)))
        axis |= {"range": [-reach, reach]}
    real = axis | {"title": {"text": "real part (rad/s)"}} | ({"range": [-reach, right]} if known else {})
    imaginary = axis | {"title": {"text": "imaginary part (rad/s)"}, "scaleanchor": "x", "scaleratio": 1}
    plain = {} if unit is None else {"showticklabels": False, "showgrid": False}
    plot = Plot(imaginary | plain, x=real | plain)
    for number, (source, kinds) in enumerate(by_source.items()):
        color, first = COLORS[number % len(COLORS)], True
        for kind, roots, symbol in zip(("pole", "zero"), kinds, ("x-thin-open", "circle-open"), strict=True):
            for sure in (True, False):
                some = [root.value for root in roots if root.determined is sure]
                if some:
                    at, words = place(some), [f"{value.real:.3g} + {value.imag:.3g} i rad/s" for value in some]
                    hover = f"%{{text}}<extra>{kind}</extra>"
                    drawn = marks(at.real, at.imag, source, color, symbol=symbol, size=9, text=words, hover=hover)
                    plot.add(drawn, group=source, legend=first, opacity=1.0 if sure else 0.35)
                    first = False
            for outline in (place(root.ellipse()) for root in roots if root.determined):
                edge = curve(outline.real, outline.imag, source, color, 1.0)
                plot.add(edge | {"hoverinfo": "skip"}, group=source, legend=False)
    scale = ""
    if unit is not None:
        scale = " Distances from the origin are logarithmic: circles are powers of ten."
        lowest, highest = (int(np.floor(np.log10(value))) for value in (unit, max(sizes)))
        for power in range(lowest, highest + 1):
            rim = float(place([10.0**power]).real[0])
            circle = {"type": "circle", "layer": "below", "line": {"color": "@grid", "width": 1}}
            plot.shapes.append(circle | {"x0": -rim, "x1": rim, "y0": -rim, "y1": rim})
            text = {"x": 0.0, "y": rim, "text": f"{10.0**power:g}", "showarrow": False, "font": {"size": 10}}
            plot.notes.append(text | {"xanchor": "left", "yanchor": "bottom"})
    caption = (
        "Poles (crosses) and zeros (circles) with the ellipses in which they lie with 95 % probability. "
        "Pale ones are not determined by the data: their deviation is more than half of their distance from the "
        f"origin. The frame is chosen for those that are; a double click shows all.{scale}"
    )
    return plot.figure(name, caption, 430, margin={"t": 64})


def _incoherent(hz: Floats, coherence: Floats) -> list[Span]:
    """Return the stretches of frequency in which the coherence is below 0.6, Hz."""
    last = len(hz) - 1
    return [Span(float(hz[max(a - 1, 0)]), float(hz[min(b, last)])) for a, b in runs(coherence < COHERENT)]
