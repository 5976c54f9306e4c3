"""The report on all flights: one page that stays small, opens anywhere, prints whole; and a summary in Markdown."""

import json
import re
import shutil
from dataclasses import replace

from pipeline import AnalysisConfig, FleetResult
from pipeline.names import folder_names
from pipeline.results.fleet import FlightEntry, GroupEntry
from pipeline.storage.store import open_store
from reports import write_fleet
from tests.reports.builders import drawn, strict
from tests.reports.conftest import composed
from tests.reports.made import made

FLIGHTS = 100


def test_a_hundred_flights_fold_and_stay_small(fleet, tmp_path):
    """Products of one flight stand for all: what counts here is what the page and its numbers keep of each."""
    shutil.copytree(fleet, tmp_path, dirs_exist_ok=True)
    numbers = strict((fleet / "flights" / "flight01" / "report.json").read_text("utf-8"))
    folders = []
    for number in range(FLIGHTS):
        folder = tmp_path / "flights" / f"copy{number:03d}"
        shutil.copytree(fleet / "flights" / "flight01", folder)
        (folder / "report.json").write_text(json.dumps(numbers | {"name": folder.name}), encoding="utf-8")
        folders.append(folder.name)
    write_fleet(
        FleetResult(
            flights=tuple(made(FlightEntry, folder=name) for name in folders),
            groups=(made(GroupEntry, folder="craft0"),),
            failures=(),
            config=AnalysisConfig(),
            store=open_store(tmp_path),
        )
    )
    page = (tmp_path / "report.html").read_text("utf-8")
    assert f"<details><summary>Table of {FLIGHTS} flights</summary>" in page
    assert len(page) < 10_000 * FLIGHTS + 2_000_000
    assert (tmp_path / "report.json").stat().st_size < 6600 * FLIGHTS + 500_000


def test_summaries_of_flights_lead_to_their_numbers(fleet):
    numbers = strict((fleet / "report.json").read_text("utf-8"))
    for flight in numbers["flights"]:
        own = strict((fleet / flight["folder"] / "report.json").read_text("utf-8"))
        assert (own["name"], own["log"], own["verdict"]) == (flight["name"], flight["log"], flight["verdict"])
        assert (fleet / flight["folder"] / "report.html").is_file()
    (finding,) = [number for number in numbers["findings"] if number["id"] == "gps-lag"]
    assert finding["flights"] == ["flight01", "flight02"]


def test_each_flights_predictions_can_be_chosen(fleet):
    page = (fleet / "craft1.html").read_text("utf-8")
    choices = dict(re.findall(r'<option value="([^"]+)" data-page="[^"]*">([^<]+)</option>', page))
    assert list(choices.values()) == ["flight02", "flight01"], "flights that judge come first"
    figures = {figure["id"]: figure for figure in drawn(page)}
    for name, flight in choices.items():
        assert figures[name]["place"] == "1-prediction"
        measured = next(trace for trace in figures[name]["data"] if trace["name"] == "measured")
        assert measured["y"]["deltas"], flight


def test_flights_without_a_common_craft_have_a_page(flight, other, tmp_path):
    page = composed(tmp_path, [flight, other]).read_text("utf-8")
    assert "No craft has two usable flights" in page
    assert 'href="flights/flight01/report.html"' in page
    models = strict((tmp_path / "models.json").read_text("utf-8"))
    assert [owner["name"] for owner in models["flights"]] == ["flight01", "flight02"]


def test_logs_that_all_gave_nothing_are_told_without_empty_tables(tmp_path):
    page = composed(tmp_path, []).read_text("utf-8")
    assert "No log gave a flight." in page
    assert "not a flight log: text without a single FMT row" in page.replace("Not a", "not a")
    assert 'class="flights"' not in page
    assert "| flight |" not in (tmp_path / "report.md").read_text("utf-8")


def test_names_of_folders_are_those_of_links(flight, tmp_path):
    odd = replace(flight, name="a flight #1?")
    page = composed(tmp_path, [odd]).read_text("utf-8")
    folder = folder_names([odd.name])[odd.name]
    assert f'href="flights/{folder}/report.html"' in page
