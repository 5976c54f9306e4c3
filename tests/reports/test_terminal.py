"""The tables on a terminal."""

import json

import pytest
from rich.console import Console

from reports import inspection, terminal
from reports.numbers import flight_numbers


def shown(renderable, width: int) -> str:
    console = Console(width=width, highlight=False, color_system=None)
    with console.capture() as capture:
        console.print(renderable)
    return capture.get()


def test_one_flight_reads_in_one_table_and_one_verdict(flight):
    text = shown(terminal.overview(flight_numbers(flight)), 120)
    assert "flight01" in text
    assert "60 s" in text
    assert "free run" in text


def test_narrow_terminals_keep_every_number(fleet):
    numbers = json.loads((fleet / "report.json").read_text("utf-8"))
    wide, narrow = (shown(terminal.overview(numbers, width), width) for width in (120, 80))
    errors = [cell for line in wide.splitlines() if line.startswith("flight01") for cell in line.split() if "." in cell]
    assert errors
    assert all(cell in narrow for cell in errors)
    assert max(map(len, narrow.splitlines())) <= 80


@pytest.mark.parametrize(
    ("value", "sigma", "cell"),
    [(2.55771, 0.0007, "2.558"), (2.55771, 0.03, "2.56"), (0.5, 2.0, "0.5"), (2.55771, 1e-9, "2.558"), (None, 1, "–")],
)
def test_coefficients_in_a_cell_have_no_more_than_four_digits(flight, value, sigma, cell):
    thrust = {"common": {"determined": value is not None, "per_mass": value, "sigma": sigma}}
    row = shown(terminal.overview(flight_numbers(flight) | {"thrust": thrust, "answer": None}), 120).splitlines()[2]
    assert row.split()[5] == cell


def test_a_reason_that_begins_with_the_flights_name_is_a_reason(flight):
    numbers = flight_numbers(flight) | {
        "models": [],
        "answer": None,
        "missing": {"experiment": "flight01: no motor outputs; set RCOUT"},
    }
    assert shown(terminal.overview(numbers), 120).splitlines()[2].rstrip().endswith("no motor outputs")


def test_markup_in_names_is_text(flight):
    numbers = flight_numbers(flight) | {"name": "[red]odd[/red]"}
    assert "[red]odd[/red]" in shown(terminal.overview(numbers), 120)


def test_failures_are_named_once():
    numbers = {
        "failures": [
            {"file": "a.bin", "reason": "a.bin is not a flight log"},
            {"file": "b.bin", "reason": "the file is empty"},
        ]
    }
    assert list(terminal.failures(numbers)) == ["a.bin is not a flight log", "b.bin: the file is empty"]


def test_inspection_puts_what_is_wrong_before_what_is_there():
    log = {
        "file": "a.bin",
        "format": "dataflash",
        "boots": 2,
        "boot": 1,
        "start_utc": None,
        "duration": 61.2,
        "vehicle": {"firmware": None, "autopilot": None, "version": None, "frame_class": None, "frame_type": None}
        | {"motors": []},
        "flights": [],
        "tables": [
            {"name": "imu", "rows": 1, "rate": None, "start": None, "stop": None, "gaps": 0, "longest_gap": 0.0}
            | {"columns": ["gyro_x"]}
        ],
        "messages": [{"name": "IMU", "rows": 1, "rate": None}],
        "findings": [{"severity": "error", "reason": "no motor outputs", "advice": "set RCOUT"}],
    }
    text = shown(inspection.overview(log), 100)
    assert text.index("No motor outputs.") < text.index("gyro_x")
    assert "power-up 2 of 2" in text


def test_no_model_from_any_log_is_said_with_the_reason(flight):
    numbers = flight_numbers(flight)
    bare = numbers | {"models": [], "thrust": None, "missing": {"experiment": "no motor outputs"}}
    assert terminal.no_model(numbers) == ""
    assert terminal.no_model(bare) == "no model could be identified: no motor outputs"
    assert terminal.no_model({"kind": "fleet", "flights": [bare, numbers], "groups": []}) == ""
    assert terminal.no_model({"kind": "fleet", "flights": [bare, bare], "groups": []}).endswith("no motor outputs")
    assert terminal.no_model({"kind": "fleet", "flights": [], "groups": []}) == ""
