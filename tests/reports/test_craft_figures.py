"""What the page on all flights says and draws of coverage and of parameters over flights."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from pipeline.fleet.drift import follow
from pipeline.fleet.envelope import envelope
from pipeline.results.account import Account, MotorsReading
from pipeline.results.coverage import QUANTITIES, Envelope
from pipeline.results.drift import Drift
from pipeline.results.fleet import FlightEntry
from reports.figures.fleet import coverage_figures, drift_figures
from reports.views.fleet import drift_sentences, drift_table
from reports.views.flight import coverage_table, outside
from sysid.rotors.steady_trims import SteadyTrims
from tests.pipeline.builders import covering, stated
from tests.pipeline.coverages import coverage_of
from tests.reports.builders import accepted

FLIGHTS = 8
MOTORS = ("m1", "m2", "m3", "m4")


def entry(number: int, speed: float, thrust: float) -> FlightEntry:
    """Make up a flight at one speed, of a craft with one thrust."""
    rng = np.random.default_rng(number)
    bins = {name: int(1.05 / QUANTITIES[name].step) for name in ("density", "altitude")} | {"ground_speed": int(speed)}
    halves = np.repeat([0.5, 1.5], 300)
    flight = covering(
        f"flight{number:02d}", **{name: (first + halves) * QUANTITIES[name].step for name, first in bins.items()}
    )
    return replace(
        flight,
        start_utc=datetime(2026, 3, 1, tzinfo=UTC) + timedelta(days=number),
        coverage=coverage_of(
            flight.coverage,
            map=[[int(speed), 1, 30.0], [int(speed) + 1, 1, 30.0]],
            wind={"speed": 3.0, "direction": 0.5 * np.pi, "north": 0.0, "east": -3.0, "sigma": 0.4},
        ),
        trims=SteadyTrims(MOTORS, (0.0, 0.0, 0.0), (1e-6,) * 3, ((0.5, 0.5, 0.5),) * 4),
        account=Account(flight=None, motors=MotorsReading(mean=dict.fromkeys("1234", 0.4), hardest="1", at_limit=0.0)),
        parameters=(
            stated(
                "thrust over mass", thrust + rng.normal(0.0, 0.004), 0.004, "m/s^2, one motor at full command", "rotor"
            ),
            stated("motor lag", 0.05 + rng.normal(0.0, 0.002), 0.002, "s", "rotor"),
        ),
    )


@pytest.fixture(scope="module")
def entries() -> list[FlightEntry]:
    """Fly a craft that loses two per cent of its thrust from flight to flight; the last one is flown fast."""
    return [entry(k, 8.0 if k == FLIGHTS - 1 else 2.0, 2.5 * (1.0 - 0.02 * k)) for k in range(FLIGHTS)]


@pytest.fixture(scope="module")
def covered(entries) -> Envelope:
    names = [flight.name for flight in entries]
    ranges = envelope(entries, names[:-2], names[-2:])
    assert ranges is not None
    return ranges


@pytest.fixture(scope="module")
def drift(entries) -> Drift:
    followed = follow(entries)
    assert followed is not None
    return followed


def test_plotly_accepts_the_figures_of_a_craft(covered, drift):
    shown, folded = drift_figures(drift, "1-")
    names = accepted([*coverage_figures(covered, "1-"), *shown, *folded])
    assert names[:4] == ["1-cover", "1-spread", "1-winds", "1-shares"]


def test_flying_beyond_what_was_fitted_is_seen_and_said(covered):
    heat, circles = coverage_figures(covered, "")[0].data
    assert max(circles["x"]) == 9.5
    assert max(heat["x"]) < 4.0
    (sentence,) = [line for line in outside(covered) if "ground speed" in line]
    assert sentence.startswith(f"flight{FLIGHTS - 1:02d}: ")
    (speed,) = [row for row in coverage_table(covered).rows if row.label.startswith("Ground speed")]
    assert speed.cells[1:] == ["2 to 4", "2 to 10"]


def test_the_wind_is_drawn_where_it_comes_from(covered):
    """It comes from the east, so its point lies to the right."""
    points = coverage_figures(covered, "")[2].data[0]
    assert points["x"] == pytest.approx([3.0] * (FLIGHTS - 2))
    assert points["y"] == pytest.approx([0.0] * (FLIGHTS - 2), abs=1e-9)


def test_what_changes_over_flights_comes_first(drift):
    thrust, lag = (
        next(parameter for parameter in drift.parameters if parameter.parameter == name)
        for name in ("thrust over mass", "motor lag")
    )
    assert thrust.change is not None
    assert lag.change is None
    assert drift_sentences(drift)[0].startswith("Thrust over mass")
    assert drift_table(drift).rows[0].label == "Thrust over mass, rotor (m/s²)"
    courses = next(figure for figure in drift_figures(drift, "")[0] if "course" in figure.id)
    points, line = courses.data[:2]
    assert points["marker"]["color"] == "@bad"
    assert line["y"] == pytest.approx(points["y"], abs=0.03)
    assert line["y"][0] > line["y"][-1]


def test_flights_without_a_date_stand_in_order_of_name(entries):
    numbers = follow([replace(flight, start_utc=None) for flight in entries])
    axis = drift_figures(numbers, "")[0][-1].layout["xaxis"]
    assert axis["type"] == "category"
    assert axis["categoryarray"] == [flight.name for flight in entries]


def test_nothing_measured_draws_nothing():
    assert coverage_figures(None, "") == []
    assert drift_figures(None, "") == ([], [])
    assert coverage_table(None) is None
    assert drift_table(None) is None
