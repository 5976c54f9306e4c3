"""Plots of models: what Plotly accepts, bands only where something is known, poles that can be told apart."""

import dataclasses
from dataclasses import replace

import numpy as np
import pytest

from pipeline.flight.rotation import fitted_response
from pipeline.flight.summary import flight_report
from pipeline.results.fleet import ResponseCurve
from pipeline.results.model import ModelReport
from reports.figures.frequency import bode_figure, pole_map, response_overlays
from reports.figures.models import horizon_figure, off_by_default, response_figures
from sysid import TransferFunction
from sysid.frequency.export import response_table
from tests.pipeline.builders import chirped
from tests.reports.builders import accepted
from tests.reports.made import made


def test_plotly_accepts_every_figure_and_ids_are_unique(flight):
    figures = [figure for some in response_figures(flight.models[0]).values() for figure in some]
    names = accepted([*figures, horizon_figure(flight_report(flight).models)])
    assert len(set(names)) == len(names) == 7
    assert names[0] == "bode-motors-x"


def test_the_curve_is_the_transfer_functions_own(flight):
    model = flight.models[0].model
    bode = response_figures(flight.models[0])["y"][0]
    gain = next(
        trace for trace in bode.data if trace.get("name") == "m2" and trace["yaxis"] == "y" and "fill" not in trace
    )
    expected = np.abs(model.transfer_functions["y"]["m2"].response(2.0 * np.pi * np.array(gain["x"])))
    # Figures travel with four digits: beyond 100 dB that is one behind the point.
    assert np.allclose(gain["y"], 20.0 * np.log10(expected), rtol=5e-4)
    bands = [trace for trace in bode.data if trace.get("fill") == "toself" and trace["legendgroup"] == "m2"]
    assert bands, "this flight determines its model"


def test_what_is_not_determined_has_no_band_and_no_ellipse(flight):
    own = flight.models[0]
    vague = {
        output: {name: dataclasses.replace(f, covariance=1e6 * f.covariance) for name, f in row.items()}
        for output, row in own.model.transfer_functions.items()
    }
    model = dataclasses.replace(own.model, transfer_functions=vague)
    bode, roots = response_figures(dataclasses.replace(own, model=model))["x"]
    assert not [trace for trace in bode.data if trace.get("fill")]
    assert {trace["mode"] for trace in roots.data} == {"markers"}
    assert {trace["opacity"] for trace in roots.data} == {0.35}


def test_only_models_beside_better_ones_are_off_at_first():
    def model(key, trust, model=True):
        return made(ModelReport, key=key, verdict={"trust": trust}, kind="rigid_body" if model else "")

    assert off_by_default([model("a", "no"), model("b", "limited")]) == {"a"}
    assert off_by_default([model("a", "no"), model("b", "no")]) == set()
    assert off_by_default([model("a", "no"), model("b", "yes", model=False)]) == set()


def function(*poles: complex) -> TransferFunction:
    den = np.real(np.poly(poles))
    return TransferFunction(num=np.array([1.0]), den=den, covariance=1e-12 * np.eye(len(den)))


def marks(figure) -> dict[str, complex]:
    traces = {}
    for trace in figure.data:
        if trace["mode"] == "markers":
            traces |= {text: complex(x, y) for text, x, y in zip(trace["text"], trace["x"], trace["y"], strict=True)}
    return traces


def test_a_lightly_damped_mode_is_within_the_scale():
    """Scaled by its distance along the real axis only, a mode at 115 rad/s lay outside of the figure."""
    figure = pole_map({"roll": function(-4.5 + 113.0j, -4.5 - 113.0j, -60.0)}, "roll")
    (left, right), (low, high) = (figure.layout[axis]["range"] for axis in ("xaxis", "yaxis"))
    assert all(left < place.real < right and low < place.imag < high for place in marks(figure).values())


def test_one_fast_pole_does_not_squeeze_the_slow_ones_together():
    figure = pole_map({"m1": function(-250.0, -1.0 + 2.0j, -1.0 - 2.0j, -0.4)}, "x")
    places = marks(figure)
    slow, swing, fast = (places[f"{place} i rad/s"] for place in ("-0.4 + 0", "-1 + 2", "-250 + 0"))
    (left, right), (low, high) = (figure.layout[axis]["range"] for axis in ("xaxis", "yaxis"))
    assert all(left < place.real < right and low < place.imag < high for place in places.values())
    # Parted by more than a twentieth of the frame (a hundredth and less on a linear scale), damping kept.
    assert abs(slow - swing) > 0.05 * (right - left)
    assert np.angle(swing) == pytest.approx(np.angle(-1.0 + 2.0j), abs=1e-3)
    assert abs(fast) > 2.0 * abs(swing)
    assert {note["text"] for note in figure.layout["annotations"]} >= {"1", "10", "100"}
    assert "logarithmic" in figure.caption


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
    motors = replace(CURVE, flight="c", source="motor outputs to gyros")  # not laid over the controllers'
    curves = [CURVE, replace(CURVE, flight="b", phase_deg=(-90.0,) * 3), replace(CURVE, axis="yaw"), motors]
    (figure,) = response_overlays(curves, "craft-")
    assert figure.id == "craft-responses-roll"
    gains = [trace for trace in figure.data if trace["yaxis"] == "y"]
    phases = [trace["y"] for trace in figure.data if trace["yaxis"] == "y2"]
    assert [trace["name"] for trace in gains] == ["a", "b"]
    assert phases == [[-90.0] * 3] * 2  # a turn apart is the same


def test_a_response_is_blank_where_nothing_was_estimated_and_nowhere_else() -> None:
    frf = chirped()
    sigma = np.concatenate([[np.inf] * 2, frf.sigma[2:]])
    blank = replace(frf, sigma=sigma, response=np.concatenate([[1.0, 1.0], frf.response[2:]]))
    data = bode_figure(fitted_response(blank, None), "roll").data
    drawn = [trace for trace in data if trace.get("name") == "measured" and "fill" not in trace]
    direct = [trace for trace in data if trace.get("name") == "plain regression (biased)"]
    for trace in (*drawn[:2], *direct):
        assert np.isfinite(np.asarray(trace["y"], dtype=np.float64)).tolist() == [False] * 2 + [True] * 38
    table = response_table(blank)
    for column in ("gain_db", "phase_deg", "real", "imag", "direct_gain_db", "direct_phase_deg"):
        assert table[column].isna().tolist() == [True] * 2 + [False] * 38
