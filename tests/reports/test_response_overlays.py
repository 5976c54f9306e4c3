"""Responses of several flights of a craft laid over each other."""

from dataclasses import replace

from pipeline.results.entry import ResponseCurve
from reports.figures.frequency import response_overlays

CURVE = ResponseCurve(
    flight="a",
    axis="roll",
    unit="rad/s",
    source="",
    hz=(1.0, 2.0, 4.0),
    gain_db=(30.0, 24.0, 18.0),
    phase_deg=(270.0,) * 3,
)


def test_two_flights_of_an_axis_make_a_figure_and_one_makes_none():
    curves = [CURVE, replace(CURVE, flight="b", phase_deg=(-90.0,) * 3), replace(CURVE, axis="yaw")]
    (figure,) = response_overlays(curves, "craft-")
    assert figure.id == "craft-responses-roll"
    gains = [trace for trace in figure.data if trace["yaxis"] == "y"]
    phases = [trace["y"] for trace in figure.data if trace["yaxis"] == "y2"]
    assert [trace["name"] for trace in gains] == ["a", "b"]
    assert phases == [[-90.0] * 3] * 2  # a turn apart is the same


def test_motor_outputs_are_not_laid_over_the_controllers():
    curves = [CURVE, replace(CURVE, flight="b"), replace(CURVE, flight="c", source="motor outputs to gyros")]
    (figure,) = response_overlays(curves)
    assert {trace["name"] for trace in figure.data} == {"a", "b"}
