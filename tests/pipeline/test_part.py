"""Models of a flight of hours are made of the half hour in which most was asked of the craft."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from logparse import Tables
from pipeline.flight.part import LONGEST, busiest, part_findings
from pipeline.results.span import Span

HOURS = Span(100.0, 100.0 + 5.0 * LONGEST)


def _log(chirps: pd.DataFrame | None = None) -> SimpleNamespace:
    """Return a flight that is steered everywhere, three times as much in the third half hour."""
    t = np.arange(HOURS.start, HOURS.stop, 0.1)
    size = np.where((t > 100.0 + 2.0 * LONGEST) & (t < 100.0 + 3.0 * LONGEST), 0.3, 0.1)
    angles = {name: size * np.sin(t + k) for k, name in enumerate(("roll", "pitch", "yaw"))}
    return SimpleNamespace(tables=Tables(setpoints=pd.DataFrame(angles, index=t), systemid=chirps))


def test_the_busiest_half_hour_is_taken_and_named() -> None:
    part = busiest(_log(), HOURS)
    assert part.stop - part.start == pytest.approx(LONGEST)
    assert part.start == pytest.approx(100.0 + 2.0 * LONGEST, abs=0.1 * LONGEST)
    (finding,) = part_findings(HOURS, part)
    assert finding.id == "part-excluded"
    assert "lasts 150 min" in finding.reason


def test_usual_flights_and_those_with_chirps_count_as_a_whole() -> None:
    usual = Span(100.0, 100.0 + LONGEST)
    assert busiest(_log(), usual) == usual
    assert part_findings(usual, usual) == ()
    assert busiest(_log(pd.DataFrame({"axis": [10.0]})), HOURS) == HOURS


def test_without_targets_and_attitude_it_is_the_first_half_hour() -> None:
    assert busiest(SimpleNamespace(tables=Tables()), HOURS) == Span(100.0, 100.0 + LONGEST)
