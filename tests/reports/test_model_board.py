"""The model board: every model and axis once; models that cannot be trusted come last."""

from pipeline.results.model_report import ModelReport
from reports.figures.models import model_board, off_by_default
from tests.reports.conftest import made_flight
from tests.reports.made import made


def test_the_board_offers_every_model_and_axis_once_in_each_place():
    flight = made_flight()
    board = model_board(flight.models, set())
    values = [value for value, _ in board.choices]
    assert len(values) == len(set(values)) > 0
    ids = {figure.id for figure in board.figures}
    assert ids == {f"{place}-{value}" for place in board.captions for value in values}
    assert {figure.place for figure in board.figures} == set(board.captions) == {"bode", "roots"}


def test_only_models_beside_better_ones_are_off_at_first():
    def model(key, trust, model=True):
        return made(ModelReport, key=key, verdict={"trust": trust}, kind="rigid_body" if model else "")

    assert off_by_default([model("a", "no"), model("b", "limited")]) == {"a"}
    assert off_by_default([model("a", "no"), model("b", "no")]) == set()
    assert off_by_default([model("a", "no"), model("b", "yes", model=False)]) == set()
