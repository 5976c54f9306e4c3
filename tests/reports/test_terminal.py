"""The tables on a terminal."""

import math
import re
from dataclasses import replace

from rich.console import Console

from logparse import Finding, Severity, Vehicle
from logparse.inspection import Inspection, MessageSummary, TableSummary
from pipeline.flight.summary import flight_report
from pipeline.results.report import FleetReport
from reports.report_json import read_report
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
