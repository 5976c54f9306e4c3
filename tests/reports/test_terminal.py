"""The tables on a terminal."""

import math
import re
from dataclasses import replace

import pytest
from rich.console import Console

from logparse import Finding, Severity, Vehicle
from logparse.inspection import Inspection, MessageSummary, TableSummary
from pipeline.results.answer import Answer, AnswerLine, Picture, Tone
from pipeline.results.report import FleetReport
from reports.numbers.flight import flight_report
from reports.numbers.reading import read_report
from reports.terminal import inspection
from reports.terminal import summary as terminal
from tests.reports.made import made


def shown(renderable, width: int) -> str:
    console = Console(width=width, highlight=False, color_system=None)
    with console.capture() as capture:
        console.print(renderable)
    return capture.get()


def test_one_flight_is_answered_with_what_happened_and_no_table_of_models(flight):
    text = shown(terminal.overview(flight_report(flight)), 120)
    assert text.startswith("flight01\nNothing happened")
    assert "RMSE" not in text


def test_narrow_terminals_keep_every_number(fleet):
    numbers = read_report(fleet)
    wide, narrow = (shown(terminal.overview(numbers, width), width) for width in (120, 80))
    cells = [cell for line in wide.splitlines() for cell in line.split() if re.fullmatch(r"[0-9]+[.]?[0-9]*", cell)]
    assert len(cells) > 3
    assert all(cell in narrow for cell in cells)
    assert max(map(len, narrow.splitlines())) <= 80


@pytest.mark.parametrize(
    ("value", "sigma", "cell"),
    [
        (2.55771, 0.0007, "2.558 m/s²"),
        (2.55771, 0.03, "2.56 m/s²"),
        (0.5, 2.0, "0.5 m/s²"),
        (2.55771, 1e-9, "2.558 m/s²"),
        (None, 1, "–"),
    ],
)
def test_coefficients_in_a_cell_have_no_more_than_four_digits(flight, value, sigma, cell):
    line = AnswerLine(
        purpose="Parameters",
        word="partly",
        tone=Tone.CARE,
        text="thrust/mass per motor",
        value=value,
        sigma=sigma,
        unit="m/s²",
    )
    answer = Answer(lines=(line,), picture=Picture.ALTITUDE)
    entry = replace(flight_report(flight).in_short(""), answer=answer)
    row = shown(terminal.overview(made(FleetReport, flights=[entry])), 120).splitlines()[3]
    assert row.rstrip().endswith(cell)


def test_a_reason_that_begins_with_the_flights_name_is_a_reason(flight):
    missing = {"experiment": "flight01: no motor outputs; set RCOUT"}
    numbers = replace(flight_report(flight).in_short(""), models=(), answer=None, missing=missing)
    text = shown(terminal.overview(made(FleetReport, flights=[numbers, numbers])), 120)
    assert "No model: no motor outputs (flight01 and 1 more)" in text


def test_markup_in_names_is_text(flight):
    numbers = replace(flight_report(flight), name="[red]odd[/red]")
    assert "[red]odd[/red]" in shown(terminal.overview(numbers), 120)


def test_inspection_puts_what_is_wrong_before_what_is_there():
    log = Inspection(
        file="a.bin",
        format="dataflash",
        boots=2,
        boot=1,
        start_utc=None,
        duration=61.2,
        vehicle=Vehicle(),
        flights=(),
        tables=(TableSummary("imu", 1, math.nan, math.nan, math.nan, 0, 0.0, ("gyro_x",)),),
        messages=(MessageSummary("IMU", 1, math.nan),),
        findings=(Finding("not-logged", Severity.ERROR, "no motor outputs", "set RCOUT"),),
    )
    text = shown(inspection.overview(log), 100)
    assert text.index("No motor outputs.") < text.index("gyro_x")
    assert "power-up 2 of 2" in text


def test_no_model_from_any_log_is_said_with_the_reason(flight):
    numbers = flight_report(flight)
    bare = replace(numbers, models=(), thrust=None, missing={"experiment": "no motor outputs"})
    assert terminal.no_model(numbers) == ""
    assert terminal.no_model(bare) == "no model could be identified: no motor outputs"
    short, none = numbers.in_short(""), bare.in_short("")
    assert terminal.no_model(made(FleetReport, flights=[none, short])) == ""
    assert terminal.no_model(made(FleetReport, flights=[none, none])).endswith("no motor outputs")
    assert terminal.no_model(made(FleetReport)) == ""
