"""Poles and zeros of a model on a scale on which slow and fast ones can be told apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from reports.figures.figure import Drawn, Figure, Trace, layout_of, plotly_text
from sysid import TransferFunction
from sysid.transfer_functions.transfer_function import Root, poles, zeros

#: Colours of inputs, in their order; more inputs than these start again.
INPUT_COLORS = ("@c1", "@c2", "@c3", "@c4", "@c5", "@c6", "@c7", "@c8")
#: Ratio of the fastest to the slowest known root from which a linear scale squeezes the slow ones together.
_DECADES = 20.0

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class _Radius:
    """How far from the origin a root is drawn: its magnitude, or the magnitude's logarithm where those span decades."""

    unit: float | None = None  #: Magnitude [rad/s] up to which a logarithmic scale is nearly linear; None: all of it.

    @classmethod
    def of(cls, known: Sequence[complex]) -> _Radius:
        """Choose the scale on which roots that are known can be told apart."""
        sizes = [abs(root) for root in known if abs(root) > 0.0]
        return cls(min(sizes)) if sizes and max(sizes) > _DECADES * min(sizes) else cls()

    def drawn(self, values: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return where values are drawn; directions, and with them damping, are kept."""
        if self.unit is None:
            return values
        size = np.abs(values)
        return np.asarray(values * np.log10(1.0 + size / self.unit) / np.where(size > 0.0, size, 1.0))

    def circles(self, farthest: float) -> tuple[list[Drawn], list[Drawn]]:
        """Draw circles of powers of ten, and what each of them is; none on a linear scale."""
        if self.unit is None:
            return [], []
        lowest, highest = (int(np.floor(np.log10(each))) for each in (self.unit, farthest))
        shapes: list[Drawn] = []
        labels: list[Drawn] = []
        for power in range(lowest, highest + 1):
            reach = float(np.real(self.drawn(np.array([10.0**power + 0.0j]))[0]))
            edges = {"x0": -reach, "x1": reach, "y0": -reach, "y1": reach}
            shapes.append({"type": "circle", "layer": "below", "line": {"color": "@grid", "width": 1}} | edges)
            text = {"x": 0.0, "y": reach, "text": f"{10.0**power:g}", "showarrow": False}
            labels.append(text | {"xanchor": "left", "yanchor": "bottom", "font": {"size": 10}})
        return shapes, labels


def _marks(
    source: str, kind: str, roots: Sequence[Root], symbol: str, color: str, sure: bool, radius: _Radius
) -> Trace:
    values = np.array([root.value for root in roots], dtype=np.complex128)
    places = radius.drawn(values)
    return {
        "type": "scatter",
        "mode": "markers",
        "x": _rounded(places.real),
        "y": _rounded(places.imag),
        "text": [f"{value.real:.3g} + {value.imag:.3g} i rad/s" for value in values],
        "name": plotly_text(source),
        "legendgroup": source,
        "opacity": 1.0 if sure else 0.35,
        "marker": {"symbol": symbol, "size": 9, "color": color, "line": {"color": color, "width": 2}},
        "hovertemplate": f"%{{text}}<extra>{kind} of {plotly_text(source)}</extra>",
    }


def pole_map(functions: Mapping[str, TransferFunction], name: str) -> Figure:
    """Draw poles and zeros of the transfer functions to one output, by input, with 95 % ellipses.

    Parameters
    ----------
    functions : mapping of str to TransferFunction
    name : str
        Unique in the page.
    """
    found = {source: (poles(function), zeros(function)) for source, function in functions.items()}
    known = [root.value for kinds in found.values() for roots in kinds for root in roots if root.determined]
    radius = _Radius.of(known)
    data: list[Trace] = []
    for number, (source, kinds) in enumerate(found.items()):
        color = INPUT_COLORS[number % len(INPUT_COLORS)]
        for kind, roots, symbol in zip(("pole", "zero"), kinds, ("x-thin-open", "circle-open"), strict=True):
            for sure in (True, False):
                some = [root for root in roots if root.determined is sure]
                if some:
                    data.append(_marks(source, kind, some, symbol, color, sure, radius))
            for ellipse in (radius.drawn(root.ellipse()) for root in roots if root.determined):
                outline: Trace = {"type": "scatter", "mode": "lines", "line": {"color": color, "width": 1}}
                outline |= {"x": _rounded(ellipse.real), "y": _rounded(ellipse.imag), "legendgroup": source}
                data.append(outline | {"showlegend": False, "hoverinfo": "skip"})
    named: set[str] = set()
    for trace in data:
        trace["showlegend"] = trace["mode"] == "markers" and trace["legendgroup"] not in named
        named.add(trace["legendgroup"])
    # Roots that nobody knows may lie anywhere; those that are known decide what is shown at first.
    farthest = max((abs(root) for root in known), default=0.0)
    reach = 1.15 * float(np.abs(radius.drawn(np.array([farthest + 0.0j]))[0]))
    right = 0.3 * reach
    if known:
        right = max(right, 1.1 * float(np.max(radius.drawn(np.array(known, dtype=np.complex128)).real)))
    shapes, labels = radius.circles(farthest)
    ticks = {} if radius.unit is None else {"showticklabels": False, "showgrid": False}
    real: Drawn = {"title": {"text": "real part (rad/s)"}, "zeroline": True}
    imaginary: Drawn = {"title": {"text": "imaginary part (rad/s)"}, "zeroline": True, "scaleanchor": "x"}
    layout = layout_of(
        xaxis=real | ticks | ({"range": [-reach, right]} if reach > 0.0 else {}),
        yaxis=imaginary | ticks | {"scaleratio": 1} | ({"range": [-reach, reach]} if reach > 0.0 else {}),
        shapes=shapes,
        annotations=labels,
    )
    layout["margin"] = layout["margin"] | {"t": 64}
    scale = "" if radius.unit is None else " Distances from the origin are logarithmic: circles are powers of ten."
    caption = (
        "Poles (crosses) and zeros (circles) with the ellipses in which they lie with 95 % probability. "
        "Pale ones are not determined by the data: their deviation is more than half of their distance from the "
        f"origin. The frame is chosen for those that are; a double click shows all.{scale}"
    )
    return Figure(f"roots-{name}", caption, data, layout, 430, time=False)


def _rounded(values: Floats) -> list[float | None]:
    return [float(f"{float(value):.4g}") if np.isfinite(value) else None for value in values]
