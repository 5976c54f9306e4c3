"""The plots by which a flight is judged: asked and flown, vibration, battery, estimator, GPS, compass."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from core.parameter import Parameter
from core.quantity import joined, number, per_degree, uncertain
from pipeline.results.failure import Failure, present
from pipeline.results.flight import FlightResult
from pipeline.results.signals import Panel, Peak, Spectrum
from pipeline.results.span import Span
from reports.figures.figure import (
    COLORS,
    Drawn,
    Figure,
    Plot,
    band,
    band_label,
    line,
    margin,
    mark_line,
    over_time,
    plotly_text,
    time_axis,
)

_OWN = {"asked": "@own", "flown": "@ink"}
#: Points of a line that are drawn: its own, which are thinned already.
_EVERY = 1_000_000

_CAPTIONS = {
    "attitude": "Attitude asked for and flown. They should lie on each other; where they part, the craft "
    "could not do what was asked.",
    "rates": "Angular rates asked for and flown, as the rate controller saw them.",
    "vibration": "Vibration as the autopilot measures it. Above the lower dashed line the estimate of height may "
    "suffer, above the upper it nearly always does.",
    "battery": "Battery. Voltage should fall slowly; dips show load beyond what the battery can give.",
    "estimator": "Test ratios of the estimator: innovations over what it expects. Above 1 a measurement is refused.",
    "gps": "What the GPS receiver says of its own quality.",
    "compass": "Magnetic field and throttle. A field that follows the throttle is disturbed by currents.",
}
#: Captions where the log does not hold what was asked.
_ALONE = {
    "attitude": "Attitude flown; what was asked for was not logged.",
    "rates": "Angular rates flown; what was asked for was not logged.",
}


def signal_figures(result: FlightResult) -> list[Figure]:
    """Draw what the health of the flight rests on; a plot whose data is missing is left out."""
    if isinstance(result.signals, Failure) or isinstance(result.flight, Failure):
        return []
    signals = result.signals
    marks = _marks(result)
    figures = [
        _stacked(name, panels, result.flight, marks)
        for name, panels in (
            ("attitude", signals.attitude),
            ("rates", signals.rates),
            ("vibration", signals.vibration),
            ("battery", signals.battery),
            ("estimator", signals.estimator),
            ("gps", signals.gps),
            ("compass", signals.compass),
        )
        if panels
    ]
    figures = [
        replace(figure, caption=f"{figure.caption} {_sagging(_sag(result))}")
        if figure.id == "health-battery"
        else figure
        for figure in figures
    ]
    if signals.spectrum is not None:
        figures.append(_spectrum(signals.spectrum))
    return figures


def _sagging(sag: Parameter | None) -> str:
    """Explain what the battery's resistance means for a pilot, or why it is not known."""
    if sag is None or sag.value is None or sag.sigma is None:
        return "" if sag is None else f"Its resistance is not determined: {sag.reason}."
    ohms = uncertain(1e3 * sag.value, 1e3 * sag.sigma, "mΩ")
    return f"Battery and wiring have {ohms}: every 10 A more cost {number(10.0 * sag.value, 2)} V."


def signal_figure(result: FlightResult, name: str, most: int) -> Figure | None:
    """Draw `most` plots of one group of lines, such as ``"vibration"``; None where it was not logged."""
    if isinstance(result.signals, Failure) or isinstance(result.flight, Failure):
        return None
    panels: Sequence[Panel] = getattr(result.signals, name)[:most]
    return _stacked(name, panels, result.flight, _marks(result)) if panels else None


def _stacked(name: str, panels: Sequence[Panel], flight: Span, happened: Sequence[Drawn]) -> Figure:
    """Draw panels below each other over one axis of time."""
    axis = {"title": {"font": {"size": 11}}, "nticks": 5}
    plot = over_time(panels, time_axis(margin(flight)), colors=_OWN, axis=axis, most=_EVERY, width=1.2)
    plot.shapes = [*happened, *plot.shapes]
    named = {signal.name for panel in panels for signal in panel.signals}
    caption = _ALONE[name] if name in _ALONE and "asked" not in named else _CAPTIONS[name]
    caption += " Dotted: when something happened." if happened else ""
    return plot.figure(f"health-{name}", caption, 120 + 110 * len(panels), time=True)


def _sag(result: FlightResult) -> Parameter | None:
    account = present(result.account)
    return None if account is None or account.battery is None else account.battery.sag


def _marks(result: FlightResult) -> list[Drawn]:
    """Draw each notable happening as a line where it began."""
    account = present(result.account)
    times = sorted({round(happening.t, 1) for happening in (() if account is None else account.notable)})
    return [mark_line(t, "@judged") for t in times[:40]]


def _spectrum(spectrum: Spectrum) -> Figure:
    factor, unit = per_degree(spectrum.unit)
    last = float(spectrum.hz[-1])
    # Highest frequency of a spectrum that is shown at first, Hz: rotors and a few multiples of them.
    axis = {"title": {"text": "frequency (Hz)"}, "range": [0.0, min(last, 600.0)]}
    plot = Plot({"title": {"text": f"amplitude ({unit})"}, "type": "log"}, x=axis)
    for place, (name, amplitude) in enumerate(spectrum.amplitudes.items()):
        hover = "%{x:.0f} Hz: %{y:.3g}"
        plot.add(line(spectrum.hz, factor * amplitude, name, COLORS[place], width=1.2, decimals=6, hover=hover))
    plot.shapes += [band(Span(notch.low, min(notch.high, last)), "@judged", 0.18) for notch in spectrum.notches]
    plot.shapes += [mark_line(hz, "@judged", dash="dash") for hz in spectrum.filters.values()]
    labels = [band_label(Span(hz, hz), name) for name, hz in spectrum.filters.items()]
    labels += [band_label(Span(notch.low, notch.high), notch.name) for notch in spectrum.notches[:2]]
    # Below each other: filters and notches lie close together.
    plot.notes += [label | {"y": 0, "yshift": 14 * k} for k, label in enumerate(labels)]
    highest = max(float(np.max(factor * amplitude)) for amplitude in spectrum.amplitudes.values())
    arrow = {"xref": "x", "yref": "y", "showarrow": True, "arrowhead": 0, "ax": 0, "ay": -18, "font": {"size": 10}}
    for peak in spectrum.peaks:
        at = {"x": peak.hz, "y": float(np.log10(min(factor * peak.amplitude, highest)))}
        plot.notes.append(arrow | at | {"text": plotly_text(_peak_name(peak))})
    caption = f"Spectrum of the angular rates ({spectrum.source}). {peaks_in_words(spectrum)}"
    return plot.figure("health-spectrum", caption, 330)


def _peak_name(peak: Peak) -> str:
    multiple = "" if peak.rotor_multiple < 2 else f" × {peak.rotor_multiple}"
    return f"{peak.hz:.0f} Hz" + (f" (rotors{multiple})" if peak.rotor_multiple else "")


def peaks_in_words(spectrum: Spectrum) -> str:
    """Name the peaks that are the rotors', and those that no notch covers."""
    if not spectrum.peaks:
        return "No line stands out."
    named = joined([_peak_name(peak) for peak in spectrum.peaks])
    text = f"Lines at {named}."
    open_to = [f"{peak.hz:.0f} Hz" for peak in spectrum.peaks if peak.rotor_multiple and not peak.notch]
    if spectrum.notches:
        text += " Tinted: notches."
        text += f" No notch covers {joined(open_to)}." if open_to else ""
    elif open_to:
        text += " No notch is set: INS_HNTCH_* would take the rotors' lines out."
    if spectrum.rotors_hz is not None:
        text += f" The rotors turned at {spectrum.rotors_hz[0]:.0f} to {spectrum.rotors_hz[1]:.0f} Hz by ESC telemetry."
    else:
        text += (
            " Rotor speeds were not logged, and commands alone do not tell them: that takes the motors' KV and load. "
            "A line that goes with the commands is called a rotor's."
        )
    return text
