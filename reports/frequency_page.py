"""The page of `rotorid frequency`: what every axis does, with its plots; and the table for the terminal."""

from __future__ import annotations

from rich.table import Table

from pipeline.flight.rotation import turning_of
from reports.frequency_figures import pole_figure
from reports.html import render
from reports.rotation_views import parameter_rows, parameter_table, rotation_figures
from reports.rotation_views import sentences as sentences_of
from sysid.frequency.survey import AxisSurvey, FrequencySurvey


def frequency_page(found: FrequencySurvey) -> str:
    """Render the page."""
    axes = [turning_of(axis) for axis in found.axes]
    figures = rotation_figures(axes)
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
        sentences=[sentence for axis in axes for sentence in sentences_of(axis)],
        table=parameter_table(axes),
        frequency_figures=figures,
        findings=list(findings.values()),
    )


def sentences(axis: AxisSurvey) -> list[str]:
    """Return what is known of an axis in words, or why nothing is and what to fly."""
    return sentences_of(turning_of(axis))


def terminal_table(found: FrequencySurvey) -> Table:
    """Return the table of parameters for the terminal."""
    heads, rows = parameter_rows([turning_of(axis) for axis in found.axes])
    table = Table(title="Frequency responses")
    table.add_column("axis")
    for head in heads:
        table.add_column(head, justify="right")
    for label, cells in rows:
        table.add_row(label, *cells)
    return table
