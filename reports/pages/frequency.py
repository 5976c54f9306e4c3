"""The page of `rotorid frequency`: what every axis does, with its plots."""

from __future__ import annotations

from dataclasses import replace

from pipeline.flight.rotation import coupling_of, curve_of, fitted_response, turning_of
from reports.figures.frequency import pole_figure, response_overlays
from reports.pages.html import render
from reports.views.rotation import coupling_sentence, parameter_table, rotation_figures, sentences
from sysid.frequency.fitted import FrequencyFit
from sysid.frequency.response import FrequencyResponse
from sysid.frequency.survey import FrequencySurvey


def frequency_page(survey: FrequencySurvey) -> str:
    """Render the page."""
    axes = [turning_of(axis) for axis in survey.axes]
    figures = rotation_figures(axes)
    curves = [curve_of(fitted_response(frf, None), name) for name, frf in survey.single]
    if curves:
        summed = [fitted_response(_modelled(axis.fit), None) for axis in survey.axes if axis.fit is not None]
        figures += response_overlays([*curves, *(curve_of(response, "model of all") for response in summed)])
    poles = pole_figure([(axis.axis, axis.fit) for axis in survey.axes if axis.fit is not None])
    if poles is not None:
        figures.append(poles)
    findings = {
        (finding.id, finding.reason): finding
        for axis in survey.axes
        if axis.response is not None
        for finding in axis.response.findings
    } | {(finding.id, finding.reason): finding for finding in survey.findings}
    return render(
        "frequency.html",
        figures,
        title="Frequency responses",
        facts=" · ".join(survey.names),
        sentences=[
            *(sentence for axis in axes for sentence in sentences(axis)),
            *(
                coupling_sentence(coupling_of(coupling))
                for coupling in survey.couplings
                if coupling.ratio.value is not None
            ),
        ],
        table=parameter_table(axes),
        frequency_figures=figures,
        findings=list(findings.values()),
    )


def _modelled(fit: FrequencyFit) -> FrequencyResponse:
    """Return a fit's model in the place of what was measured."""
    measured = fit.responses[0]
    return replace(measured, response=fit.response(measured.hz))
