"""The page of `rotorid frequency`: what every axis does, with its plots; and the table for the terminal."""

from __future__ import annotations

from typing import Any

import numpy as np
from rich.table import Table

from logparse.quantity import uncertain
from reports.figure import Figure
from reports.frequency_figures import bode_figure, pole_figure
from reports.html import render
from sysid.frequency.survey import AxisSurvey, FrequencySurvey
from sysid.statistics.parameter import Parameter

#: Parameters in the order in which they are read, and their units for the eye.
_SHOWN = ("gain", "damping", "lag", "lead", "delay", "mode_frequency", "mode_damping")
_HEADS = ("gain", "damping", "lag", "lead", "delay", "mode", "mode damping", "J", "coherent", "attitude bandwidth")


def frequency_page(found: FrequencySurvey) -> str:
    """Render the page."""
    figures: list[Figure] = []
    for axis in found.axes:
        if axis.response is not None:
            figures.append(bode_figure(axis.response, axis.fit, f"bode-{axis.axis}"))
        if axis.attitude is not None and axis.attitude.determined:
            figures.append(bode_figure(axis.attitude.frf, axis.attitude.fit, f"attitude-{axis.axis}"))
    poles = pole_figure([(axis.axis, axis.fit) for axis in found.axes if axis.fit is not None])
    if poles is not None:
        figures.append(poles)
    findings = {
        (finding.id, finding.reason): finding.to_dict()
        for axis in found.axes
        if axis.response is not None
        for finding in axis.response.findings
    }
    return render(
        "frequency.html",
        figures,
        title="Frequency responses",
        facts=" · ".join(found.names),
        sentences=[sentence for axis in found.axes for sentence in sentences(axis)],
        table=parameter_table(found),
        frequency_figures=figures,
        findings=list(findings.values()),
    )


def sentences(axis: AxisSurvey) -> list[str]:
    """Return what is known of an axis in words, or why nothing is and what to fly."""
    said = []
    if axis.fit is not None:
        gain, delay = axis.fit.parameters["gain"], axis.fit.parameters["delay"]
        if gain.value is not None:
            said.append(
                f"{axis.axis.capitalize()}: {_text(gain)} per unit of output"
                + (f", delay {_milliseconds(delay)}" if delay.value is not None else "")
                + f"; the fit is {axis.fit.verdict} (J {axis.fit.cost:.0f})."
            )
        else:
            said.append(f"{axis.axis.capitalize()}: the gain is not determined: {gain.reason}.")
    elif axis.reason:
        said.append(f"{axis.axis.capitalize()}: no response of the rate loop: {axis.reason}.")
    if axis.attitude is not None and axis.attitude.determined:
        bandwidth = axis.attitude.bandwidth
        said.append(
            f"The {axis.axis} attitude follows its target up to {_text(bandwidth)} "
            f"with a phase delay of {_milliseconds(axis.attitude.phase_delay)}."
        )
    elif axis.attitude is not None and not axis.determined:
        reason = axis.attitude.bandwidth.reason or axis.attitude.phase_delay.reason
        said.append(f"How the {axis.axis} attitude follows its target is not determined: {reason}.")
    elif axis.attitude_reason and not axis.determined:
        said.append(f"{axis.axis.capitalize()} attitude: {axis.attitude_reason}.")
    return said


def parameter_table(found: FrequencySurvey) -> dict[str, Any]:
    """Return the table of parameters for the page."""
    shown = _columns(found)
    return {
        "caption": "Parameters with one standard deviation; in brackets Cramér-Rao's error and insensitivity in "
        "percent. J up to 50 is excellent, up to 100 good.",
        "label": "Axis",
        "heads": [_HEADS[k] for k in shown],
        "rows": [{"kind": "", "label": axis.axis, "cells": [_cells(axis)[k] for k in shown]} for axis in found.axes],
    }


def terminal_table(found: FrequencySurvey) -> Table:
    """Return the table of parameters for the terminal."""
    table = Table(title="Frequency responses")
    shown = _columns(found)
    table.add_column("axis")
    for k in shown:
        table.add_column(_HEADS[k], justify="right")
    for axis in found.axes:
        cells = _cells(axis)
        table.add_row(axis.axis, *(cells[k] for k in shown))
    return table


def _columns(found: FrequencySurvey) -> list[int]:
    """Return which columns of the table say something of any axis."""
    rows = [_cells(axis) for axis in found.axes]
    return [k for k in range(len(_HEADS)) if any(row[k] != "–" for row in rows)]


def _cells(axis: AxisSurvey) -> list[str]:
    cells = ["–"] * len(_SHOWN)
    cost = coherent = bandwidth = "–"
    if axis.fit is not None:
        cells = [_with_errors(axis, name) for name in _SHOWN]
        cost = f"{axis.fit.cost:.1f}"
    if axis.response is not None and axis.response.usable.any():
        hz = axis.response.hz[axis.response.usable]
        coherent = f"{hz[0]:.2g}-{hz[-1]:.3g} Hz"
    if axis.attitude is not None and axis.attitude.determined:
        bandwidth = f"{_text(axis.attitude.bandwidth)}, {_milliseconds(axis.attitude.phase_delay)}"
    return [*cells, cost, coherent, bandwidth]


def _with_errors(axis: AxisSurvey, name: str) -> str:
    assert axis.fit is not None
    known = axis.fit.parameters.get(name)
    if known is None:
        return "–"
    if known.value is None or known.sigma is None:
        return "not determined"
    text = _milliseconds(known) if known.unit == "s" else _text(known)
    if known.value == 0.0 or known.unit == "s":
        return text
    insensitivity = axis.fit.insensitivity[axis.fit.names.index(name)]
    return f"{text} ({100.0 * known.sigma / abs(known.value):.1f}, {100.0 * np.abs(insensitivity):.1f} %)"


def _text(known: Parameter) -> str:
    return uncertain(known.value, known.sigma, "" if known.unit == "1" else known.unit)


def _milliseconds(known: Parameter) -> str:
    if known.value is None or known.sigma is None:
        return "not determined"
    return uncertain(1e3 * known.value, 1e3 * known.sigma, "ms")
