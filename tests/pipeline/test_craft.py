"""Which logs belong together, and which must not be counted twice."""

import dataclasses
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pandas as pd

import sysid
from estimation import Trajectory
from logparse import Geodetic, Vehicle
from pipeline import AnalysisConfig, FlightResult, LogFacts, Span
from pipeline.craft import by_craft, fingerprint, same_flight

OCTA = Vehicle(autopilot="ArduPilot", frame_class="octa", frame_type="plus")


def flown(
    name: str,
    *,
    start: datetime = datetime(2024, 5, 2, 9, 30, tzinfo=UTC),
    form: str = "dataflash",
    craft: str = "octa",
    lat: float = 0.8,
    sha256: str | None = None,
) -> FlightResult:
    t = np.arange(0.0, 60.0, 0.1)
    states = pd.DataFrame({"p_n": 3.0 * t, "p_e": 0.0, "p_d": -10.0}, index=t)
    trajectory = Trajectory(
        states=states,
        sigma=pd.DataFrame({"p_n": 0.5, "p_e": 0.5}, index=t),
        covariance=np.zeros((0, 9, 9)),
        origin=Geodetic(lat, 0.1, 100.0),
        method="strapdown",
    )
    return FlightResult(
        name=name,
        log=LogFacts(
            path=Path(f"{name}.bin"),
            size=1,
            sha256=sha256 or name,
            format=form,
            duration=60.0,
            start_utc=start,
            boots=1,
            vehicle=OCTA,
            craft=craft,
            flights=(Span(5.0, 55.0),),
        ),
        config=AnalysisConfig(),
        flight=Span(5.0, 55.0),
        trajectory=trajectory,
        experiments={"motors": sysid.Experiment.from_arrays(t, np.ones(len(t)), np.ones(len(t)), name=name)},
    )


def test_telemetry_of_a_flight_is_the_same_flight():
    board, ground = flown("a"), flown("b", form="tlog", start=datetime(2024, 5, 2, 9, 30, 1, tzinfo=UTC))
    assert same_flight(board, ground)
    kept = by_craft([ground, board])
    assert [[flight.name for flight in craft] for craft in kept] == [["a"]], "the on-board log has more samples"


def test_a_copy_is_the_same_flight_whatever_it_is_called():
    assert same_flight(flown("a", sha256="x"), flown("b", sha256="x", start=datetime(2020, 1, 1, tzinfo=UTC)))


def test_flights_elsewhere_at_the_same_time_are_others():
    """Simulators fly faster than the clock, so that their flights overlap in time."""
    assert not same_flight(flown("a"), flown("b", lat=0.8001))


def test_the_next_flight_is_another():
    later = datetime(2024, 5, 2, 9, 30, tzinfo=UTC) + timedelta(minutes=2)
    assert not same_flight(flown("a"), flown("b", start=later))


def test_crafts_are_kept_apart_and_flights_without_motors_left_out():
    bare = dataclasses.replace(flown("d", lat=0.3), experiments={})
    crafts = by_craft([flown("c", craft="quad", lat=0.1), flown("b"), flown("a", lat=0.2), bare])
    assert [[flight.name for flight in craft] for craft in crafts] == [["c"], ["a", "b"]]


def test_board_ids_tell_twins_apart_but_not_in_a_simulator():
    twins = [dataclasses.replace(OCTA, board_id=board) for board in ("one", "two")]
    assert len({fingerprint(twin, {}, simulated=False) for twin in twins}) == 2
    assert len({fingerprint(twin, {}, simulated=True) for twin in twins}) == 1


def test_tuning_tells_crafts_apart_where_no_board_id_does():
    gains = [{"ATC_RAT_RLL_P": 0.135}, {"ATC_RAT_RLL_P": 0.4}]
    assert len({fingerprint(OCTA, gain, simulated=False) for gain in gains}) == 2
    known = dataclasses.replace(OCTA, board_id="one")
    assert len({fingerprint(known, gain, simulated=False) for gain in gains}) == 1, "tuning must not split a craft"


def test_what_drifted_without_gps_is_no_flight_to_fit():
    lost = flown("a")
    assert lost.trajectory is not None
    drifting = dataclasses.replace(lost.trajectory, sigma=lost.trajectory.sigma * 1000.0)
    crafts = by_craft([dataclasses.replace(lost, trajectory=drifting), flown("b", lat=0.2)])
    assert [[flight.name for flight in craft] for craft in crafts] == [["b"]]
