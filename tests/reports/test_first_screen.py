"""The first screen: few words, a number or a reason on every line, and no word that its number contradicts."""

import dataclasses
import io
import re

import numpy as np
import pandas as pd
import pytest
from rich.console import Console

from core.parameter import Parameter
from logparse import FlightEvent, Severity, Vehicle
from pipeline.flight.answer import compose_answer
from pipeline.results.answer import Picture, Tone
from pipeline.results.coverage import Wind
from pipeline.results.failure import Failure
from pipeline.results.flight import FlightResult
from pipeline.results.loops import FlightLoops
from pipeline.results.report import FleetReport
from pipeline.results.rotation import AxisRotation, LoopMargins, RotationResult
from pipeline.results.signals import FlightHealth, FlightSignals, Panel, Signal
from pipeline.results.span import Span
from reports.numbers.fleet import in_short
from reports.numbers.flight import flight_report
from reports.pages.fleet import fleet_page
from reports.pages.html import flight_page
from reports.terminal.summary import overview
from reports.views import summary
from reports.views.first_screen import first_figures
from reports.views.fleet_answer import fleet_answer
from reports.views.summary import answer_lines
from sysid import Experiment, fit_thrust
from sysid.loops.loop import Margins
from sysid.records.motor_scaling import motor_commands
from tests.pipeline.coverages import coverage_of
from tests.reports.made import made

#: Issue of this page: the first screen has below so many words in all.
MOST_WORDS = 120


def event(identity: str, t: float, severity: Severity = Severity.ERROR, **evidence) -> FlightEvent:
    return FlightEvent(id=identity, t=t, end=t + 1.0, severity=severity, reason="It happened.", evidence=evidence)


def health(*events: FlightEvent, cause: FlightEvent | None = None) -> FlightHealth:
    t = np.arange(40.0, 100.0, 0.1)
    asked, flown = Signal("asked", t, 0.1 * np.sin(t)), Signal("flown", t, 0.1 * np.sin(t - 0.1))
    signals = FlightSignals(
        attitude=tuple(Panel(title=axis, unit="rad", signals=(asked, flown)) for axis in ("roll", "pitch", "yaw")),
        vibration=(
            Panel(
                title="vibration",
                unit="m/s²",
                signals=(Signal("x", t, 5.0 + np.sin(t)),),
                limits={"advised limit": 30.0},
            ),
        ),
    )
    return FlightHealth(events=events, sound=Span(40.0, 99.9), cause=cause, signals=signals)


LOST = event("motor-loss", 70.0, motor=2, thrust_loss=0.99, thrust_loss_sigma=0.01)


def loops(*axes: AxisRotation) -> RotationResult:
    return RotationResult(axes=axes)


def loop(axis: str, phase: float, gain: float = 12.0, unstable: float = 0.0, remarks=(), stable=True) -> AxisRotation:
    nothing = Parameter(None, None, "Hz", "not measured")
    margins = Margins(
        gain_db=Parameter(gain, 0.3, "dB"),
        phase_deg=Parameter(phase, 2.0, "deg"),
        crossover_hz=nothing,
        rejection_hz=nothing,
        peak_db=nothing,
        intervals={},
        stable=stable,
        unstable=unstable,
    )
    return AxisRotation(axis=axis, loop=LoopMargins(gains={}, computed=margins, remarks=remarks))


def answered(given: FlightResult, /, **changed) -> FlightResult:
    result = dataclasses.replace(given, **changed)
    return dataclasses.replace(result, answer=compose_answer(result))


@pytest.fixture(scope="module")
def kinds(flight, other) -> dict[str, FlightResult]:
    """Return flights as different as they come."""
    nothing = {"experiments": {}, "models": (), "gps": None, "baro": None}
    unknown, grounded = Failure("trajectory", "no GPS; log it"), Failure("flight", "no flight")
    return {
        "good": answered(flight, health=health(), loops=FlightLoops(), rotation=loops(loop("roll", 52.0))),
        "lost motor": answered(flight, health=health(LOST, event("crash", 72.0), cause=LOST)),
        "crash": answered(flight, health=health(event("crash", 72.0)), loops=FlightLoops(tracking_rad={"roll": 0.05})),
        "without models": answered(other, health=health(event("low-thrust-reserve", 50.0, Severity.WARNING))),
        "no position": answered(flight, health=health(), **nothing, trajectory=unknown),
        "no flight": answered(flight, flight=grounded, motors=None, modes=None, **nothing, trajectory=unknown),
    }


def words(page: str) -> int:
    """Count the words of the first screen without those in plots."""
    first = page[page.index('id="first"') : page.index('class="contents"')]
    first = re.sub(r"<noscript>.*?</noscript>", "", first, flags=re.DOTALL)
    return len(re.sub(r"<[^>]+>", " ", first.partition(">")[2]).split())


def test_the_first_screen_has_few_words(kinds):
    for name, result in kinds.items():
        assert words(flight_page(result, flight_report(result))) < MOST_WORDS, name


def test_every_line_has_a_number_or_a_reason(kinds):
    for name, result in kinds.items():
        lines = answer_lines(flight_report(result).answer)
        assert [shown.line.purpose for shown in lines] == [
            "Flown",
            "Healthy",
            "Loops",
            "Predict ahead",
            "Parameters",
            "Simulate",
        ]
        for shown in lines:
            assert shown.line.word, name
            assert shown.number or len(shown.line.text.split()) >= 2, (name, shown)
            assert "nan" not in f"{shown.number} {shown.line.text}", (name, shown)


def line_of(result: FlightResult, purpose: str):
    return next(line for line in result.answer.lines if line.purpose == purpose)


def test_a_lost_motor_is_named_with_its_second(kinds):
    line = line_of(kinds["lost motor"], "Healthy")
    assert (line.word, line.tone) == ("no", Tone.BAD)
    # 99 ± 1 % is all of it.
    assert (line.value, line.sigma) == (None, None)
    assert "motor 2 lost all its thrust" in line.text
    assert "70.0 s" in line.text
    assert kinds["lost motor"].answer.picture is Picture.MOTORS
    figure = first_figures(kinds["lost motor"])[-1]
    low, high = figure.layout["xaxis"]["range"]
    assert low < 70.0 < high < 80.0
    assert figure.layout["shapes"][-1]["x0"] in (70.0, 72.0)


def test_events_of_another_flight_do_not_choose_the_picture(flight):
    """A log of three flights showed the wrong time range: backwards, and empty."""
    elsewhere = answered(flight, health=health(event("crash", 5.0)))
    line = line_of(elsewhere, "Healthy")
    assert "in another flight" in line.text
    assert line.word == "no"
    assert elsewhere.answer.around is None
    assert elsewhere.answer.picture is Picture.PREDICTION


def test_words_follow_a_load_that_was_dropped(flight):
    """After a fifth of the mass was dropped the first screen said "predict yes 3.4 s" and a thrust of one part."""
    t = np.arange(0.0, 60.0, 0.1)
    walk = np.random.default_rng(0).normal(0.0, 20.0, (len(t), 1)).cumsum(axis=0).clip(-80.0, 80.0)
    pwm = 1500.0 + walk + np.zeros(4)
    pull = 0.1 * motor_commands(pwm, Vehicle()).sum(axis=1) * 50.0
    context = pd.DataFrame({"f_z": -pull * np.where(t < 30.0, 1.0, 1.25), "voltage": 16.0, "density": 1.2}, index=t)
    record = Experiment.from_arrays(t, pwm, np.zeros((len(t), 3)), context=context)
    dropped = answered(flight, thrust=fit_thrust([record], 1.5), health=health())
    healthy, ahead, parameters = (line_of(dropped, each) for each in ("Healthy", "Predict ahead", "Parameters"))
    assert line_of(answered(flight), "Predict ahead").tone is Tone.GOOD
    assert (ahead.word, ahead.tone) == ("with care", Tone.CARE)
    assert parameters.word != "known"
    assert (healthy.word, healthy.tone) == ("check", Tone.CARE)
    told = re.compile(r"thrust/mass changed by \+\d+ % at (29|30|31) s")
    assert all(told.search(line.text) for line in (healthy, ahead, parameters))


def test_healthy_means_no_event_and_motors_that_were_looked_at(flight):
    assert line_of(answered(flight, health=health()), "Healthy").word == "yes"
    unchecked = dataclasses.replace(health(), motors_missing="no motor outputs")
    line = line_of(answered(flight, health=unchecked), "Healthy")
    assert line.word != "yes"
    assert "motors not checked" in line.text


@pytest.mark.parametrize(
    ("axes", "word", "tone"),
    [
        ((loop("roll", 52.0), loop("pitch", 50.0)), "good", Tone.GOOD),
        ((loop("roll", 52.0), loop("pitch", 40.0)), "thin", Tone.CARE),
        ((loop("roll", 52.0, gain=4.0), loop("pitch", 50.0)), "thin", Tone.CARE),
        ((loop("roll", 52.0, unstable=0.2),), "thin", Tone.CARE),
        ((loop("roll", 20.0), loop("pitch", 50.0, stable=False)), "unstable", Tone.BAD),
        ((loop("roll", 52.0, remarks=("weak coherence",)),), "partly known", Tone.CARE),
        ((loop("roll", 52.0), AxisRotation(axis="yaw", loop_reason="no chirp")), "partly known", Tone.CARE),
        ((AxisRotation(axis="roll", loop_reason="no chirp"),), "not measured", Tone.UNKNOWN),
    ],
)
def test_the_word_of_the_loops_follows_from_the_worst_margin(flight, axes, word, tone):
    """Green is for good margins on every axis with nothing against them."""
    line = line_of(answered(flight, loops=FlightLoops(), rotation=loops(*axes)), "Loops")
    assert (line.word, line.tone) == (word, tone)


def test_an_axis_without_margins_is_not_covered_by_those_of_others(flight):
    axes = loops(loop("roll", 52.0), AxisRotation(axis="yaw", loop_reason="no chirp"))
    assert "yaw not measured" in line_of(answered(flight, loops=FlightLoops(), rotation=axes), "Loops").text


def test_how_closely_the_target_was_followed_is_no_margin_but_something(flight):
    line = line_of(answered(flight, loops=FlightLoops(tracking_rad={"roll": 0.02, "pitch": 0.05})), "Loops")
    assert (line.word, round(line.value, 2), line.unit) == ("partly known", 2.86, "°")
    assert line.text == "RMS error of pitch against its target; margins need SYSTEMID chirps"


def test_a_flight_without_parameters_still_tells_what_its_motors_gave(flight):
    """The mean is that of the logged outputs in the air, and within its error of one half of the flight."""
    lost = Failure("thrust", "the trajectory contradicts the sensors")
    line = line_of(answered(flight, thrust=lost, parameters=lost), "Parameters")
    inside = flight.motors.loc[flight.flight.start : flight.flight.stop].to_numpy()
    assert (line.word, line.unit) == ("hardly", "µs")
    assert abs(line.value - inside.mean()) < max(3.0 * line.sigma, 1.0)


def test_an_oscillation_is_said_before_any_margin(flight):
    swinging = FlightLoops(oscillations_hz={"roll": 8.0})
    line = line_of(answered(flight, loops=swinging, rotation=loops(loop("roll", 60.0))), "Loops")
    assert (line.word, line.value, line.unit) == ("oscillate", 8.0, "Hz")


def test_a_prediction_is_as_long_as_the_model_was_judged(flight):
    """The word comes from the horizon: none gives no, and a model that nobody judged gives no number."""
    line = line_of(answered(flight), "Predict ahead")
    use = flight_report(flight).models[0].uses.prediction
    horizon = use.horizon_s
    assert (line.value, line.sigma) == ((horizon if use.reach_s is None else use.reach_s), use.reach_sigma_s)
    assert (line.word in ("yes", "briefly")) == (horizon is not None)
    unjudged = dataclasses.replace(flight.models[0], validation=Failure("validation", "too short to judge"))
    line = line_of(answered(flight, models=(unjudged,)), "Predict ahead")
    assert (line.word, line.value) == ("not judged", None)


def test_the_track_shows_height_events_and_no_legend(kinds):
    track = first_figures(kinds["lost motor"])[0]
    assert track.id == "track"
    assert {trace["name"] for trace in track.data} >= {"flown", "height", "events", "start", "end"}
    assert track.layout["showlegend"] is False


def test_the_wind_stands_with_its_height(flight):
    """In sheared air a craft at 40 m meets twice as much as the number says."""
    blown = dataclasses.replace(flight, coverage=coverage_of(wind=Wind.towards(1.97, 0.72, 0.2, "rigid body")))
    assert "arrow: wind 2.1 ± 0.2 m/s at 10 m" in first_figures(blown)[0].caption


def test_a_reason_that_many_flights_share_is_said_once(flight):
    """A folder of old logs filled the terminal with one column of broken words."""
    reason = "the horizontal position is not known because no receiver had a fix for more than a second"
    bare = dataclasses.replace(flight_report(flight), models=(), missing={"trajectory": reason})
    flights = [in_short(bare, f"flights/{k}") for k in range(3)]
    console = Console(width=110, record=True, file=io.StringIO())
    console.print(overview(made(FleetReport, flights=flights), 110))
    text = console.export_text()
    assert " ".join(text.split()).count(reason) == 1
    assert "(flight01 and 2 more)" in " ".join(text.split())


def test_a_folder_without_thrust_still_tells_what_motors_gave_and_how_high(flight):
    lost = Failure("thrust", "the trajectory contradicts the sensors")
    one = in_short(flight_report(answered(flight, thrust=lost, parameters=lost)), "flights/one")
    said = {shown.line.purpose: shown for shown in fleet_answer(made(FleetReport, flights=[one], groups=()))}
    assert said["Parameters"].line.word == "hardly"
    assert said["Parameters"].number.endswith("µs")
    assert "±" in said["Parameters"].number
    assert "±" in said["Flown"].line.text


def test_a_folder_tells_first_what_its_flights_tell(kinds):
    flights = [dataclasses.replace(in_short(flight_report(each), name), name=name) for name, each in kinds.items()]
    numbers = made(FleetReport, flights=flights)
    console = Console(width=140, record=True, file=io.StringIO())
    console.print(overview(numbers, 140))
    rows = {line.split("  ")[0]: line for line in console.export_text().splitlines()}
    assert "motor 2 lost all its thrust" in rows["lost motor"]
    assert "crash at 72.0 s" in rows["crash"]
    assert " yes " in rows["good"]
    healthy = next(shown for shown in fleet_answer(numbers) if shown.line.purpose == "Healthy")
    assert (healthy.line.word, healthy.number) == ("no", "2 of 6")
    assert healthy.line.text.startswith("in danger, such as lost motor: motor 2 lost all its thrust")
    assert healthy.line.text.endswith("1 more to look into")
    assert words(fleet_page(numbers, [])) < MOST_WORDS


def test_a_folder_rounds_its_numbers_as_its_flights_do(kinds):
    flights = [dataclasses.replace(in_short(flight_report(kinds["good"]), "good"), name="good")]
    said = {each.line.purpose: each for each in fleet_answer(made(FleetReport, flights=flights))}
    own = {each.line.purpose: each for each in answer_lines(kinds["good"].answer)}
    assert said["Predict ahead"].number == own["Predict ahead"].number
    assert said["Parameters"].number == own["Parameters"].number
    assert "±" in said["Parameters"].number


def test_reasons_that_differ_in_numbers_only_are_one_with_their_range():
    reasons = ["only 7 s of 57 s", "no GPS", "only 18 s of 57 s", "only 11.5 s of 57 s"]
    assert summary.alike(reasons) == {"only 7–18 s of 57 s": [0, 2, 3], "no GPS": [1]}


def test_a_crash_is_named_with_the_loss_of_control_that_led_to_it(flight):
    crash = event("crash", 74.0)
    fallen = answered(flight, health=health(event("loss-of-control", 72.5), crash, cause=crash))
    assert line_of(fallen, "Healthy").text == "loss of control at 72.5 s, crash at 74.0 s"
    figure = first_figures(fallen)[-1]
    assert [note["text"] for note in figure.layout["annotations"]][:1] == ["loss of control"]
    assert figure.layout["xaxis"]["range"][1] <= 80.0


def test_a_crash_is_led_back_to_the_motor_that_was_at_its_limit_before_all(flight):
    crash = event("crash", 74.0)
    limit = dataclasses.replace(event("motor-at-limit", 61.0), end=73.0, evidence={"motors": "2"})
    chain = (event("loss-of-lift", 72.0), event("loss-of-control", 73.4), crash)
    fallen = answered(flight, health=health(limit, *chain, cause=crash))
    text = line_of(fallen, "Healthy").text
    assert text == "motor 2 at its limit from 61.0 s, crash at 74.0 s; 2 more events"
    assert fallen.answer.picture is Picture.MOTORS
    assert fallen.answer.around.start == pytest.approx(53.0)
    # All motors at their limit are full throttle, and one that recovered is another matter.
    everywhere = dataclasses.replace(limit, evidence={"motors": "1, 2, 3, 4"})
    for harmless in (everywhere, dataclasses.replace(limit, end=65.0)):
        text = line_of(answered(flight, health=health(harmless, *chain, cause=crash)), "Healthy").text
        assert text.startswith("loss of lift at 72.0 s, crash at 74.0 s")


def test_vibration_above_the_limit_is_not_called_fine_without_a_word(flight):
    shaken = health()
    t = np.arange(40.0, 100.0, 0.1)
    level = np.where(np.abs(t - 60.0) < 0.06, 30.2, 5.0)
    panel = Panel(title="vibration", unit="m/s²", signals=(Signal("x", t, level),), limits={"advised limit": 30.0})
    signals = dataclasses.replace(shaken.signals, vibration=(panel,))
    line = line_of(answered(flight, health=dataclasses.replace(shaken, signals=signals)), "Healthy")
    assert line.value == 30.2
    assert "for a moment only (advised below 30)" in line.text


def test_a_model_that_follows_nothing_is_not_the_picture(flight):
    """A free run that leaves the flight at once was the plot that mattered most."""
    lost = [
        dataclasses.replace(
            each,
            validation=dataclasses.replace(
                each.validation,
                table=each.validation.table.assign(fit_percent=-100.0, rmse=100.0),
            ),
        )
        if each.validation is not None
        else each
        for each in flight.models
    ]
    result = answered(flight, health=health(), models=tuple(lost))
    assert result.answer.picture is Picture.ATTITUDE
    assert result.answer.model == ""
    kept = answered(flight, health=health())
    assert kept.answer.picture is Picture.PREDICTION
    assert kept.answer.model in {each.key for each in flight.models}


def test_the_terminal_shows_the_same_lines(kinds):
    console = Console(width=110, record=True, file=io.StringIO())
    console.print(overview(flight_report(kinds["lost motor"]), 110))
    text = console.export_text()
    assert "motor 2 lost all its thrust at 70.0 s" in text


def test_a_phone_need_not_scroll_sideways(kinds, tmp_path, browser):
    for width in (390, 1280):
        page = browser.new_page(viewport={"width": width, "height": 900})
        faults: list[str] = []
        page.on("pageerror", lambda error, faults=faults: faults.append(str(error)))
        for name in ("lost motor", "no flight"):
            path = tmp_path / "page.html"
            path.write_text(flight_page(kinds[name], flight_report(kinds[name])), encoding="utf-8")
            page.goto(path.as_uri())
            assert page.evaluate("document.documentElement.scrollWidth") <= width
            if width == 1280:
                assert page.evaluate("document.getElementById('first').getBoundingClientRect().bottom") <= 900
        assert not faults
        page.close()


def test_a_log_of_the_ground_says_why_and_what_the_autopilot_complained_of(flight):
    """Six times the same sentence helped nobody."""
    grounded = Failure("flight", "The log shows no flight: the motors never run above idle (982 us)")
    complaint = FlightEvent(
        id="failsafe-triggered", t=45.94, end=45.94, severity=Severity.INFO, reason="Failsafe: gps."
    )
    lines = answered(flight, flight=grounded, health=health(complaint)).answer.lines
    assert [line.text for line in lines] == [
        "the motors never run above idle",
        "on the ground; last failsafe reported: gps at 45.9 s",
        *["needs a flight"] * 4,
    ]
    quiet = line_of(answered(flight, flight=grounded, health=health()), "Healthy").text
    assert quiet == "on the ground; the autopilot reported no failsafe and no error"


def test_motors_that_fail_at_once_are_no_share_of_thrust(flight):
    """A quadrotor flew on for 45 s while one motor was said to have lost 83 % of its thrust, and another 32 %."""
    lost = event("motor-loss", 70.0, motor=2, thrust_loss=0.32, thrust_loss_sigma=0.03, at_once="1 and 2")
    line = line_of(answered(flight, health=health(lost, cause=lost)), "Healthy")
    assert (line.word, line.value) == ("no", None)
    assert line.text == "motors 1 and 2 out of balance at once, from 70.0 s"


def test_axes_whose_chirps_end_too_low_say_so(flight):
    reason = "{}: no crossover between 0.3 and 9.15 Hz; let the chirp reach further"
    axes = [AxisRotation(axis=axis, loop_reason=reason.format(axis)) for axis in ("roll", "pitch")]
    line = line_of(answered(flight, loops=FlightLoops(), rotation=loops(loop("yaw", 52.0), *axes)), "Loops")
    assert line.text.endswith("; roll and pitch not measured (no crossover between 0.3 and 9.15 Hz)")
