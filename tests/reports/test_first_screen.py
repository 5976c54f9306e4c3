"""The first screen: few words, what happened first, and no word that its number contradicts."""

import dataclasses
import io
import re

import numpy as np
import pandas as pd
import pytest
from rich.console import Console

from core.findings import Finding, Happening, Severity
from core.parameter import Parameter
from logparse import Vehicle
from pipeline.flight.identification import model_result
from pipeline.flight.summary import flight_report
from pipeline.results.account import Reading
from pipeline.results.answer import Advice, Picture, Tone
from pipeline.results.failure import Failure
from pipeline.results.flight import FlightResult
from pipeline.results.report import CraftReport, FleetReport
from pipeline.results.rotation import AxisMargins, AxisRotation, RotationResult, state_of
from pipeline.results.span import Span
from reports.figures.flight import first_figures
from reports.pages.fleet import fleet_page
from reports.terminal.summary import overview
from reports.views.fleet import fleet_answer, title
from sysid import Experiment, fit_thrust
from sysid.loops.known_margins import Margins
from sysid.records.motor_scaling import motor_commands
from tests.reports.accounts import CRASH, LOST, STATE, account, answered, happening
from tests.reports.builders import page_of
from tests.reports.made import made

#: The first screen has below so many words in all, captions and title with them.
MOST_WORDS = 120
#: A page of a flight, folded parts with it.
MOST_ON_PAGE = 1500


def loop(axis: str, phase: float, sigma: float = 2.0, *, stable=True) -> AxisRotation:
    nothing = Parameter(None, None, "Hz", "not measured")
    margins = Margins(
        gain_db=Parameter(12.0, 0.3, "dB"),
        phase_deg=Parameter(phase, sigma, "deg"),
        crossover_hz=nothing,
        rejection_hz=nothing,
        peak_db=nothing,
        intervals={},
        stable=stable,
        unstable=0.0,
    )
    return AxisRotation(axis=axis, loop=AxisMargins(state=state_of(margins), gains={}, computed=margins))


@pytest.fixture(scope="module")
def kinds(flight, other) -> dict[str, FlightResult]:
    """Return flights as different as they come."""
    nothing = {"experiments": {}, "models": (), "gps": None}
    unknown, grounded = Failure("trajectory", "no GPS; log it"), Failure("flight", "no flight")
    return {
        "good": answered(flight, rotation=RotationResult(axes=(loop("roll", 52.0),))),
        "lost motor": answered(flight, LOST, CRASH),
        "without models": answered(other, happening("gps-lost", 50.0, Severity.WARNING)),
        "no position": answered(flight, **nothing, trajectory=unknown),
        "no flight": answered(
            flight,
            **nothing,
            account=account(flight=None),
            flight=grounded,
            motors=None,
            modes=None,
            trajectory=unknown,
        ),
    }


def visible(page: str) -> str:
    page = re.sub(r"<(noscript|script|style)[^>]*>.*?</\1>", " ", page, flags=re.DOTALL)
    return " ".join(re.sub(r"<[^>]+>", " ", page).split())


def words(page: str) -> int:
    """Count the words of the first screen without those in plots."""
    return len(visible(page[page.index('<div class="first"') : page.index('<nav class="contents"')]).split())


def line_of(result: FlightResult, purpose: str):
    return next((line for line in result.answer.lines if line.purpose == purpose), None)


def purposes(result: FlightResult) -> list[str]:
    return [line.purpose for line in result.answer.lines]


def test_pages_have_few_words(kinds):
    for name, result in kinds.items():
        page = page_of(result)
        assert words(page) < MOST_WORDS, name
        assert len(visible(page).split()) < MOST_ON_PAGE, name


def test_what_happened_comes_first_then_the_state_then_what_is_identified(kinds):
    order = ["Happened", "Flown", "Battery", "Vibration", "GPS", "Thrust", "Motors", "Loops", "Predict ahead"]
    for name, result in kinds.items():
        shown = [purpose for purpose in purposes(result) if purpose in order]
        assert shown == [purpose for purpose in order if purpose in shown], name
        assert not any("nan" in f"{line.value} {line.text}" for line in result.answer.lines), name
    assert purposes(kinds["no flight"]) == ["Happened"]


def test_a_damaged_file_is_named_before_its_numbers_and_copied_before_anything_is_set(flight):
    copy = "Copy the log again."
    damaged = Finding("file-damaged", Severity.WARNING, "About 40 messages lost: 1543 bytes are no messages.", copy)
    advice = (Advice(id="rate", rank=30, do="Set LOG_BITMASK to 1", why="", gain=""),)
    result = answered(flight, findings=(damaged,), advice=advice)
    assert purposes(result)[:2] == ["Happened", "File"]
    assert line_of(result, "File").said == "damaged about 40 messages lost"
    assert result.answer.next == copy
    assert answered(flight, LOST, findings=(damaged,)).answer.next == LOST.advice
    harmless = dataclasses.replace(damaged, severity=Severity.INFO)
    whole = answered(flight, findings=(harmless,), advice=advice)
    assert "File" not in purposes(whole)
    assert whole.answer.next == "Set LOG_BITMASK to 1."


def test_a_motor_that_failed_is_told_with_its_crash_and_its_picture(kinds):
    result = kinds["lost motor"]
    line = line_of(result, "Happened")
    assert (line.word, line.tone) == ("motor fault, crash", Tone.BAD)
    assert line.text == (
        "At 0:30 of flight (70.0 s) motor 2 lost 60 ± 5 % of its thrust; the craft hit the ground at 6 m/s at 72.0 s."
    )
    assert result.answer.next == LOST.advice
    assert result.answer.picture is Picture.MOTORS
    track, figure = first_figures(result)
    assert figure.id == "first-motors"
    low, high = figure.layout["xaxis"]["range"]
    assert low < 70.0 < high < 80.0
    assert {shape["x0"] for shape in figure.layout["shapes"] if shape.get("x0") == shape.get("x1")} >= {70.0, 72.0}
    assert {trace["name"] for trace in track.data} >= {"flown", "height", "events", "start", "end"}
    assert track.layout["yaxis"]["scaleanchor"] == "x"


def test_the_picture_is_of_the_signal_that_tells(flight):
    for identity, evidence, picture in (
        ("vibration", {}, "vibration"),
        ("failsafe", {"subsystem": "FAILSAFE_BATTERY"}, "battery"),
        ("oscillation", {"axis": "roll", "frequency_hz": 8.0}, "rates"),
        ("lift-lost", {}, "altitude"),
    ):
        result = answered(flight, happening(identity, 70.0, evidence=evidence))
        assert str(result.answer.picture) == picture
        assert first_figures(result)[-1].id == f"first-{picture}"


HEIGHTS = Reading(value=14.0, unit="m", source="barometer", others={"autopilot": 6.3, "GPS": 13.8})
SWINGING = happening("oscillation", 70.0, Severity.WARNING, evidence={"axis": "roll", "frequency_hz": 8.0})
JUMPED = happening("gps-glitch", 50.0, Severity.WARNING, evidence={"jump_m": 31.0})


def shaken(worst: float) -> dict[str, object]:
    return {"state": {"vibration": dataclasses.replace(STATE["vibration"], worst=worst)}}


def turning(*loops: AxisRotation) -> dict[str, object]:
    return {"rotation": RotationResult(axes=loops)}


@pytest.mark.parametrize(
    ("happenings", "changed", "purpose", "tone", "said"),
    [
        ((), {"state": {"height": HEIGHTS}}, "Height", Tone.CARE, "14 m by barometer (autopilot 6.3, GPS 14)"),
        ((), shaken(10.0), "Vibration", Tone.GOOD, ""),
        ((), shaken(31.0), "Vibration", Tone.CARE, ""),
        # A crash shakes the craft as well (log_0036): what is bad is what the account has found to be.
        ((CRASH,), shaken(70.0), "Vibration", Tone.CARE, ""),
        ((happening("vibration", 54.0),), shaken(70.0), "Vibration", Tone.BAD, ""),
        # Of 26-11-2014_181, whose receiver jumped by hundreds of metres, the page said "7+ satellites", in green.
        ((JUMPED,), {}, "GPS", Tone.CARE, "14+ satellites, jumped by 31 m"),
        ((), turning(loop("roll", 52.0), loop("pitch", 50.0)), "Loops", Tone.GOOD, "good margins"),
        ((), turning(loop("roll", 52.0), loop("pitch", 40.0)), "Loops", Tone.CARE, "thin margins"),
        ((), turning(loop("roll", 20.0), loop("pitch", 50.0, stable=False)), "Loops", Tone.BAD, "unstable"),
        ((), turning(loop("roll", 5.0, 11.0)), "Loops", None, ""),  # 5 ± 11 degrees were called thin margins
        ((SWINGING,), turning(loop("roll", 60.0)), "Loops", Tone.BAD, "oscillate 8 Hz"),  # before any margin
        ((), {"state": dict.fromkeys(STATE)}, "Battery", None, ""),  # the log has no such sensor
    ],
)
def test_a_line_says_no_more_than_its_numbers(flight, happenings, changed, purpose, tone, said):
    line = line_of(answered(flight, *happenings, **changed), purpose)
    assert (line and line.tone) is tone
    assert line is None or said in line.said


def test_a_calm_flight_shows_its_height_and_says_its_numbers_once(kinds):
    result = kinds["good"]
    assert line_of(result, "Happened").word == "uneventful"
    assert line_of(result, "Happened").tone is Tone.GOOD
    assert line_of(result, "Flown") is None
    assert result.answer.picture is Picture.ALTITUDE
    assert result.answer.around is None


def test_a_map_of_gps_alone_leaves_out_what_the_distance_leaves_out(flight):
    """Beside "7.5 m away" stood a map of 300 m: 26-11-2014_181."""
    lost = dataclasses.replace(flight, trajectory=Failure("trajectory", "contradicts the sensors"))
    (way, *_) = first_figures(answered(lost))[0].data
    half = float(np.mean([lost.flight.start, lost.flight.stop]))
    (seen, *_) = first_figures(answered(lost, state={"doubtful": (Span(half, np.inf),)}))[0].data
    assert (way["name"], seen["name"]) == ("GPS", "GPS, where it is credible")
    assert len(seen["x"]) == pytest.approx(len(way["x"]) / 2, abs=len(way["x"]) / 4)


def test_only_models_that_hold_have_a_number(flight):
    """A model that nobody judged, or that leaves the flight within a second, gives none."""
    line, use = line_of(answered(flight), "Predict ahead"), flight_report(flight).models[0].uses.prediction
    assert (line.word == "yes") == ((use.horizon_s or 0.0) >= 1.0)
    own = flight.models[0]
    unjudged = model_result(own.key, own.title, own.model, Failure("validation", "too short to judge"))
    line = line_of(answered(flight, models=(unjudged,)), "Predict ahead")
    assert (line.word, line.value) == ("not judged", None)
    assert line.text == "1 model tried: too short to judge"


def test_words_follow_a_load_that_was_dropped(flight):
    """After a fifth of the mass was dropped the first screen said "predict yes 3.4 s" and a thrust of one part.

    A thrust that wanders as far as that is not determined, and no line states it.
    """
    t = np.arange(0.0, 60.0, 0.1)
    walk = np.random.default_rng(0).normal(0.0, 20.0, (len(t), 1)).cumsum(axis=0).clip(-80.0, 80.0)
    pwm = 1500.0 + walk + np.zeros(4)
    pull = 0.1 * motor_commands(pwm, Vehicle()).sum(axis=1) * 50.0
    context = pd.DataFrame({"f_z": -pull * np.where(t < 30.0, 1.0, 1.25), "voltage": 16.0, "density": 1.2}, index=t)
    record = Experiment.from_arrays(t, pwm, np.zeros((len(t), 3)), context=context)
    dropped = answered(flight, thrust=fit_thrust([record], 1.5))
    ahead = line_of(dropped, "Predict ahead")
    assert (ahead.word, ahead.tone) == ("with care", Tone.CARE)
    assert re.search(r"thrust/mass changed by \+\d+ % at (29|30|31) s", ahead.text)
    assert line_of(dropped, "Parameters") is None


def test_full_thrust_is_that_of_the_motors_in_the_air_of_the_flight(flight):
    """Throttle is corrected for thin air: a craft in Quito read 2.8 times its weight where its motors give 2.05."""
    t = np.arange(0.0, 60.0, 0.1)
    walk = np.random.default_rng(0).normal(0.0, 10.0, (len(t), 1)).cumsum(axis=0).clip(-60.0, 60.0)
    pwm, density = 1500.0 + walk + np.zeros(4), 0.9
    shares = motor_commands(pwm, Vehicle(thrust_expo=0.6))
    per_motor = 9.80665 / (0.4 * 0.5 + 0.6 * 0.5**2) / 4.0
    pull = per_motor * (0.4 * shares + 0.6 * shares**2).sum(axis=1)
    context = pd.DataFrame({"f_z": -pull, "voltage": 16.0, "density": density}, index=t)
    record = Experiment.from_arrays(t, pwm, np.zeros((len(t), 3)), context=context, vehicle=Vehicle(thrust_expo=0.6))
    shown = answered(flight, thrust=fit_thrust([record], 1.5), parameters=Failure("parameters", "none"))
    full = float(re.search(r"at most ([\d.]+) × weight", line_of(shown, "Thrust").text)[1])
    assert full == pytest.approx(4.0 * per_motor / 9.80665, rel=0.02)
    hardly = answered(flight, thrust=Failure("thrust", "no accelerometer"))
    assert "weight" not in line_of(hardly, "Thrust").text


def test_next_is_what_to_inspect_else_how_to_fly(flight):
    advice = Advice(id="a", rank=1, do="Log faster", why="It is slow.", gain="margins")
    calm = answered(flight, advice=(advice,))
    assert calm.answer.next == "Log faster."
    assert answered(flight, CRASH, advice=(advice,)).answer.next == CRASH.advice
    shaken = happening("vibration", 50.0, Severity.WARNING, advice="Balance the propellers.")
    assert answered(flight, shaken, advice=(advice,)).answer.next == "Balance the propellers."


def test_a_reason_that_many_flights_share_is_said_once_with_the_range_of_its_number(flight):
    """A folder of old logs filled the terminal with one column of broken words."""
    reason = "the horizontal position is not known because a receiver had a fix for {} s of 57 s"
    bare = dataclasses.replace(flight_report(flight), models=())
    missing = [{"trajectory": reason.format(seconds)} for seconds in (7, 18, 11.5)]
    flights = [dataclasses.replace(bare, missing=each).in_short(f"flights/{k}") for k, each in enumerate(missing)]
    console = Console(width=110, record=True, file=io.StringIO())
    console.print(overview(made(FleetReport, flights=flights), 110))
    text = " ".join(console.export_text().split())
    assert text.count(reason.format("7–18")) == 1
    assert "(flight01 and 2 more)" in text


def test_a_folder_tells_first_how_many_flights_ended_badly_and_names_the_gravest(kinds):
    flights = [dataclasses.replace(flight_report(kind).in_short(name), name=name) for name, kind in kinds.items()]
    lost = Happening(id="gps-lost", severity=Severity.ERROR, reason="No fix.", t=5.0, end=5.0)
    less = dataclasses.replace(flights[1].account, story=(lost,))
    blind = dataclasses.replace(flights[1], name="blind", account=less)
    numbers = made(FleetReport, flights=[blind, *flights])
    assert [flight.happened for flight in flights][:2] == ["uneventful", "motor fault, crash"]
    first = fleet_answer(numbers)[0]
    assert first.tone is Tone.BAD
    assert first.text == "2 of 6 flights ended badly or were in danger, such as lost motor: motor fault, crash."
    console = Console(width=140, record=True, file=io.StringIO())
    console.print(overview(numbers, 140))
    rows = {line.split("  ")[0]: line for line in console.export_text().splitlines()}
    assert "motor fault, crash" in rows["lost motor"]
    page = fleet_page(numbers, [])
    assert words(page) < MOST_WORDS
    assert 'id="plot-first-flights"' in page


def test_a_folder_names_what_is_to_be_looked_into_though_it_came_to_nothing(flight):
    """A folder with one such flight (mbiuki) said "1 of 6 flights are to look into, such as ...#1: uneventful"."""
    given = answered(flight, happening("autopilot-error", 50.0, Severity.WARNING, evidence={"what": "EKF variance"}))
    text = fleet_answer(made(FleetReport, flights=[flight_report(given).in_short("")]))[0].text
    assert text == "1 of 1 flight should be looked into, such as flight01: EKF variance."


def test_a_folder_tells_before_all_what_changed_over_its_flights(kinds):
    """The gravest finding of a folder stood in row 288 of its text."""
    days = ["2014-11-08", "2014-11-10", "2014-11-14", "2014-11-16"]
    points = [
        {"flight": f"f{k}", "number": k + 1, "start_utc": f"{day}T10:00:00+00:00", "value": value, "sigma": 0.1}
        for k, (day, value) in enumerate(zip(days, (5.0, 5.0, 3.4, 3.4), strict=True))
    ]
    step = {
        **{"before": "f1", "after": "f2", "number": 3, "change": -1.6, "sigma": 0.15},
        **{"p": 1e-6, "significant": True},
    }
    history = {"parameter": "thrust over mass", "unit": "m/s^2", "method": "headline", "flights": points, "step": step}
    drift = {"order": "date", "flights": ["f0", "f1", "f2", "f3"], "parameters": [history]}
    flights = [flight_report(kinds["good"]).in_short("good")]
    numbers = made(FleetReport, flights=flights, groups=[{"name": "quad", "drift": drift}])
    first = fleet_answer(numbers)[0]
    assert first.text == "Thrust over mass fell by 32 ± 3 % between 10 November 2014 and 14 November 2014."
    page = fleet_page(numbers, [group for group in numbers.groups if isinstance(group, CraftReport)])
    assert 'id="plot-first-course"' in page
    assert 'href="craft1.html"' in page


def test_a_flight_that_was_recorded_twice_is_counted_once(kinds):
    flights = [
        dataclasses.replace(flight_report(kinds["good"]).in_short("good"), name=name) for name in ("bin", "tlog")
    ]
    said = fleet_answer(made(FleetReport, flights=flights))
    assert said[0].text == "Nothing happened in 2 flights."
    assert next(line for line in said if line.purpose == "Loops").number == "52 ± 2°", "as the flight's own page"
    once = made(FleetReport, flights=flights, again=("tlog",))
    assert fleet_answer(once)[0].text.endswith(" in 1 flight.")
    assert title(once).endswith("1 flight")


def test_the_terminal_shows_the_same_lines(kinds):
    result = kinds["lost motor"]
    console = Console(width=200, record=True, file=io.StringIO())
    console.print(overview(flight_report(result), 200))
    text = console.export_text()
    assert text.index(result.answer.lines[0].text) < text.index("Battery")
    assert f"Next: {LOST.advice}" in text
