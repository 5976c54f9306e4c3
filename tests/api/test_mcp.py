"""An assistant that has only the machine access answers questions about flights with the numbers of report.json.

The assistant is a script: it speaks the protocol to `rotorid mcp`, a process of its own.
"""

import asyncio
import json
import sys
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest

from api.machine.tools import UnknownError
from api.server import open_folder
from api.work.craft_flights import keep
from api.work.outcome import Flown
from core.serialization import as_json
from pipeline.config import ConfigError
from pipeline.results.answer import AnswerLine, Tone
from pipeline.results.report import FlightReport
from tests.api import flights
from tests.api.conftest import served
from tests.paths import ROOT
from tests.pipeline.builders import flown
from tests.reports.made import made


@pytest.fixture
def folder(two_analysed: tuple[Path, object]) -> Path:
    return two_analysed[0]


def ask(folder: Path, *questions: tuple[str, dict[str, Any]]) -> list[Any]:
    """Put questions to `rotorid mcp`; an error is answered with its text."""
    mcp = pytest.importorskip("mcp")  # takes longer to import than all else here

    async def talk() -> list[Any]:
        program = mcp.StdioServerParameters(
            command=sys.executable, args=["-m", "rotorid", "mcp", str(folder)], cwd=ROOT
        )
        answers = []
        async with mcp.Client(program) as client:
            assert client.server_info.version == version("rotorid")
            tools = {tool.name: tool for tool in (await client.list_tools()).tools}
            assert all(tool.annotations.read_only_hint and tool.description for tool in tools.values())
            for name, arguments in questions:
                assert name in tools
                answer = await client.call_tool(name, arguments)
                answers.append(answer.content[0].text if answer.is_error else json.loads(answer.content[0].text))
        return answers

    return asyncio.run(talk())


@pytest.mark.slow
def test_an_assistant_answers_ten_questions_with_the_numbers_of_the_report(folder: Path) -> None:
    octa, quad = "octa01_zurich_calm", "quad01_davos_esc"
    truth = {name: json.loads((folder / "flights" / name / "report.json").read_text()) for name in (octa, quad)}
    listed, crafts, first, known, margins, events, ahead, changes, advice, compared, unknown = ask(
        folder,
        ("list_flights", {}),
        ("list_craft", {}),
        ("get_answers", {"flight": octa}),
        ("get_parameters", {"flight": octa}),
        ("get_margins", {"flight": octa}),
        ("get_health", {"flight": octa}),
        ("get_predictions", {"flight": octa}),
        ("get_changes", {"craft": "ArduCopter octa plus"}),
        ("what_to_fly", {"flight": octa}),
        ("compare", {"before": octa, "after": quad}),
        ("get_health", {"flight": "none of ours"}),
    )
    # Which flights are there, of how many craft, how far did they fly, were they healthy?
    assert {flight["name"] for flight in listed["flights"]} == {octa, quad}
    assert [craft["flights"] for craft in crafts["craft"]] == [1, 1]
    lines = truth[octa]["answer"]["lines"]
    assert [(q["value"], q["sigma"], q["unit"]) for q in first["answers"]] == [
        (line["value"], line["sigma"], line["unit"]) for line in lines
    ]
    # What is its thrust over mass, by which method, from which seconds of which log?
    rows = {(q["name"], q["provenance"]["method"]): q for q in known["parameters"]}
    for row in truth[octa]["parameters"]:
        stated = rows[row["parameter"], row["method"]]
        assert (stated["value"], stated["sigma"], stated["unit"]) == (row["value"], row["sigma"], row["unit"])
        assert stated["provenance"]["log"] == f"{octa}.bin"
        assert stated["provenance"]["start_s"] == truth[octa]["flight"]["start_s"]
        assert (stated["value"] is None) == stated["reason"].startswith("not determined")
    # How far up does each axis follow its target, and what are its margins, where no chirp was flown?
    for axis in truth[octa]["rotation"]["axes"]:
        said = {q["name"]: q for q in margins["margins"]}
        if axis["attitude"] is not None:
            stated, bandwidth = said[f"{axis['axis']} attitude bandwidth"], axis["attitude"]["bandwidth"]
            assert all(stated[part] == bandwidth[part] for part in ("value", "sigma", "unit"))
        assert said[f"{axis['axis']} margins"]["reason"].startswith("not determined: ")
    assert any(q["value"] is not None for q in margins["margins"])
    # What happened, and when?
    happened = [(e["id"], e["t_s"]) for e in events["events"] if e["t_s"] is not None]
    assert happened == [(e["id"], e["t"]) for e in truth[octa]["account"]["happenings"]]
    # How far ahead does which model predict?
    horizons = {q["name"]: q["value"] for q in ahead["predictions"] if q["name"].endswith(": horizon")}
    assert horizons == {f"{m['title']}: horizon": m["uses"]["prediction"]["horizon_s"] for m in truth[octa]["models"]}
    # Does the craft change? One flight cannot tell. What to fly next?
    assert changes["changes"] == []
    assert {item["id"] for item in advice["advice"]} == {item["id"] for item in truth[octa]["advice"]}
    assert compared["parameters"] == "not determined" or all("difference" in row for row in compared["parameters"])
    assert "there is no flight 'none of ours'" in unknown


def test_the_same_questions_over_http(tmp_path: Path) -> None:
    with served(data=tmp_path, workers=1, analyze=flights.analyze) as client:
        for day in range(2):
            client.post(
                "/api/v1/logs", params={"analyze": True}, files={"file": (f"flight{day}.bin", flights.log(day))}
            ).raise_for_status()
        listing = client.get("/api/v1/questions/flights", params={"text": "1"}).json()
        assert ([flight["name"] for flight in listing["flights"]], listing["total"]) == (["flight1"], 1)
        answers = client.get("/api/v1/questions/answers", params={"flight": "flight1"}).json()["answers"]
        assert [answer["name"] for answer in answers] == ["Happened: yes"]
        nothing = client.get("/api/v1/questions/parameters", params={"flight": "flight1"}).json()["parameters"]
        assert nothing[0]["reason"].startswith("not determined")
        answer = client.get("/api/v1/questions/margins", params={"flight": "another"})
        assert (answer.status_code, "no flight" in answer.json()["detail"]) == (404, True)
        assert client.get("/api/v1/questions/parameters").status_code == 422  # of which flight or craft?
        assert client.get("/api/v1/questions/changes", params={"craft": "octa"}).status_code in (200, 404)


def test_lists_count_what_they_leave_out(tmp_path: Path) -> None:
    """Lists answer on a folder of many flights."""
    with served(data=tmp_path) as client:
        with client.parts.database.write() as session:
            for number in range(12):
                made = Flown(flown(f"Flight{number}", craft=f"craft{number % 2}"))
                keep(session, "", f"{number:032x}", made, (None, None, ""))

        def listed(**named: Any) -> tuple[int, int]:
            answer: dict[str, Any] = client.get("/api/v1/questions/flights", params=named).json()
            return len(answer["flights"]), answer["total"]

        craft = client.get("/api/v1/questions/craft").json()["craft"]
        assert sorted(group["flights"] for group in craft) == [6, 6]
        assert listed(limit=5) == (5, 12)
        assert listed(text="flight1") == (3, 3)
        assert listed(text="%") == (0, 0)
        assert listed(craft=craft[0]["id"], limit=2) == (2, 6)


def test_a_folder_is_read_again_when_it_changes(tmp_path: Path) -> None:
    def write(name: str, word: str) -> None:
        place = tmp_path / "flights" / name
        place.mkdir(parents=True, exist_ok=True)
        (place / "entry.json").write_text(as_json(replace(flown(name), key=f"{name} {word}")))
        line = AnswerLine(purpose="Happened", word=word, tone=Tone.GOOD, text="")
        (place / "report.json").write_text(as_json(made(FlightReport, name=name, answer={"lines": [line]})))
        (tmp_path / "manifest.json").write_text(f"{name} {word}")

    write("first", "yes")
    with open_folder(tmp_path) as tools:
        assert [flight.happened for flight in tools.list_flights().flights] == ["yes"]
        write("first", "mostly")
        write("second", "no")
        assert {flight.name: flight.happened for flight in tools.list_flights().flights} == {
            "first": "mostly",
            "second": "no",
        }
        (craft,) = tools.list_craft().craft
        assert len(tools.get_changes(craft.id).flights) == 1  # recordings of one flight
        write("third", "yes")
        assert tools.get_changes(craft.id).remarks[0].startswith("2 of the logs are further")
        with pytest.raises(UnknownError, match="no flight 'fourth'"):
            tools.get_health("fourth")


def test_a_folder_without_flights_is_refused_in_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="holds no flights of this version"), open_folder(tmp_path):
        pass
