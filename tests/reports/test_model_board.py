"""The model board: step responses by closed form, bands by sampling, models that cannot be trusted off at first."""

import numpy as np
import pytest

from pipeline.results.model_report import ModelReport
from reports.figures.models import off_by_default
from reports.views.model_board import model_board, step_response, step_sigma
from sysid import TransferFunction
from tests.reports.conftest import made_flight
from tests.reports.made import made

T = np.linspace(0.0, 5.0, 101)


@pytest.mark.parametrize(
    ("num", "den", "delay", "truth"),
    [
        ([2.0], [1.0, 0.5], 0.0, lambda t: 4.0 * (1.0 - np.exp(-0.5 * t))),
        ([1.0], [1.0, 0.0, 0.0], 0.0, lambda t: 0.5 * t**2),
        ([3.0], [1.0, -1.0], 0.0, lambda t: 3.0 * (np.exp(t) - 1.0)),
        ([1.0, 0.0], [1.0, 2.0], 0.0, lambda t: np.exp(-2.0 * t)),
        ([0.0, 4.0], [1.0, 0.0, 4.0], 0.0, lambda t: 1.0 - np.cos(2.0 * t)),
        ([2.0], [1.0, 0.5], 1.0, lambda t: np.where(t < 1.0, 0.0, 4.0 * (1.0 - np.exp(-0.5 * (t - 1.0))))),
    ],
)
def test_step_responses_follow_their_closed_form(num, den, delay, truth):
    function = TransferFunction(np.array(num), np.array(den), delay=delay)
    np.testing.assert_allclose(step_response(function, T), truth(T), rtol=1e-9, atol=1e-9)


def test_the_band_of_a_step_response_is_what_coefficients_scatter_by():
    covariance = np.diag([0.02, 0.01, 0.015]) ** 2
    function = TransferFunction(np.array([2.0]), np.array([1.0, 0.8, 1.5]), covariance=covariance)
    rng = np.random.default_rng(4)
    drawn = rng.multivariate_normal([2.0, 0.8, 1.5], covariance, 3000)
    answers = [step_response(TransferFunction(row[:1], np.append(1.0, row[1:])), T) for row in drawn]
    # 3000 draws know a standard deviation to 1.3 %; at the zeros of the sigma a floor.
    np.testing.assert_allclose(step_sigma(function, T), np.std(answers, axis=0), rtol=0.06, atol=2e-4)
    assert step_sigma(TransferFunction(np.array([2.0]), np.array([1.0, 1.0])), T) is None


def test_a_step_response_of_which_nothing_is_known_has_no_band():
    """Coefficients as far off as their sigma let the answer overflow, which was a warning out of scipy."""
    unknown = TransferFunction(np.array([1.0]), np.array([1.0, 1.0, 1.0]), covariance=np.diag([1.0, 1e24, 1e24]))
    with np.errstate(all="raise"):
        sigma = step_sigma(unknown, T)
    assert not np.all(sigma < 1e6)


def test_the_board_offers_every_model_and_axis_once_in_each_place():
    flight = made_flight()
    board = model_board(flight.models, set())
    values = [value for value, _ in board.choices]
    assert len(values) == len(set(values)) > 0
    ids = {figure.id for figure in board.figures}
    assert ids == {f"{place}-{value}" for place in board.captions for value in values}
    assert {figure.place for figure in board.figures} == set(board.captions) == {"bode", "step", "roots"}
    assert board.residuals is not None
    assert {trace["visible"] for trace in board.residuals.data} == {True}
    key = flight.models[0].key
    off = model_board(flight.models, {key}).residuals
    assert {
        trace["visible"] for trace in off.data if trace["legendgroup"] == flight.models[0].title.partition(" →")[0]
    } == {"legendonly"}


def test_only_models_beside_better_ones_are_off_at_first():
    def model(key, trust, model=True):
        return made(ModelReport, key=key, verdict={"trust": trust}, kind="rigid_body" if model else "")

    assert off_by_default([model("a", "no"), model("b", "limited")]) == {"a"}
    assert off_by_default([model("a", "no"), model("b", "no")]) == set()
    assert off_by_default([model("a", "no"), model("b", "yes", model=False)]) == set()
