"""Craft: every upload finds its own, the owner puts right what a fingerprint got wrong, models follow the flights."""

from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import httpx
import pytest

from tests.api import flights
from tests.api.conftest import served
from tests.api.programs import wait_until
from tests.api.visits import fly, only_craft, settled


@pytest.fixture
def service(tmp_path: Path) -> Iterator[httpx.Client]:
    with served(data=tmp_path, workers=2, analyze=flights.analyze) as client:
        yield client


@pytest.mark.slow
def test_uploads_find_their_craft_and_joint_models_follow(service: httpx.Client) -> None:
    assert service.get("/api/v1/crafts").json()["items"] == []
    logs = [fly(service, f"flight{day}.bin", flights.log(day)) for day in (1, 0, 2)]  # out of order
    fly(service, "other.bin", flights.log(5, craft="quad"))
    fly(service, "again.bin", flights.log(1))  # the same bytes
    listed = {craft["flights"]: craft for craft in service.get("/api/v1/crafts").json()["items"]}
    assert sorted(listed) == [1, 3]
    craft = settled(service, listed[3]["id"])
    assert craft["review"]["flights"] == ["flight0", "flight1", "flight2"]
    assert (craft["health"], craft["tone"], craft["alerts"]) == ("yes", "good", 0)
    assert craft["joint"]["flights"] == ["flight0", "flight1", "flight2"]
    assert craft["joint"]["next_at"] == 5
    model = service.get(f"/api/v1/crafts/{craft['id']}/model").json()
    assert (model["trust"], model["joint"], model["analysis"]) == ("yes", True, craft["joint"]["analysis"])
    answer = service.get(model["files"]["sitl_frame.json"])
    assert (answer.json(), answer.headers["Rotorid-Analysis"]) == ({"mass": 4.3}, model["analysis"])
    joint = craft["joint"]["analysis"]
    for path in ("/analyses", f"/analyses/{joint}", f"/analyses/{joint}/again", "/logs", "/"):
        assert service.get(path).status_code == 200, path
    names = [flight["name"] for flight in service.get(f"/api/v1/crafts/{craft['id']}/flights").json()]
    assert names == ["flight2", "flight1", "flight0"]
    one = service.get(f"/api/v1/crafts/{craft['id']}/flights").json()[0]["analysis"]
    assert f'href="/crafts/{craft["id"]}"' in service.get(f"/analyses/{one}").text
    assert f'href="/analyses/{one}"' in service.get(craft["links"]["page"]).text
    # A fourth flight enters the means, and leaves the joint models as they are.
    fly(service, "flight3.bin", flights.log(3))
    later = settled(service, craft["id"])
    assert later["joint"]["analysis"] == craft["joint"]["analysis"]
    assert len(later["review"]["drift"]["parameters"][0]["flights"]) == 4
    # A deleted log is in no joint model: they are made anew, and say so meanwhile.
    assert service.delete(f"/api/v1/logs/{logs[1]}").status_code == 204
    lost = service.get(f"/api/v1/crafts/{craft['id']}").json()["joint"]
    assert lost["analysis"] is None
    assert lost["lost"] in ("they held flight0, which was deleted", "")
    assert "two uploaded flights with a known position are needed" not in service.get(f"/crafts/{craft['id']}").text
    anew = wait_until(lambda: (j := settled(service, craft["id"])["joint"])["analysis"] and j)
    assert anew["flights"] == ["flight1", "flight2", "flight3"]
    assert anew["analysis"] != craft["joint"]["analysis"]


@pytest.mark.slow
def test_a_change_is_an_alert_once_in_list_feed_and_page(service: httpx.Client) -> None:
    logs = [
        (f"flight{day:02d}.bin", flights.log(day, 8.5 + 0.01 * (day % 3) - (1.5 if day > 7 else 0.0)))
        for day in range(14)
    ]
    # Twelve at once, of which three flew since: two more change nothing of what was told.
    together = [("file", log) for log in logs[:12]]
    assert service.post("/api/v1/logs", params={"analyze": True}, files=together).status_code == 201
    settled(service, only_craft(service)["id"])
    early = service.get("/api/v1/alerts").json()["items"]
    assert [alert["kind"] for alert in early].count("parameter-changed") == 1
    for name, content in logs[12:]:
        fly(service, name, content)
    craft = settled(service, only_craft(service)["id"])
    alerts = service.get("/api/v1/alerts").json()["items"]
    assert {alert["kind"] for alert in alerts} <= {"parameter-changed", "parameter-outside"}
    assert [alert["kind"] for alert in alerts].count("parameter-changed") == 1
    feed = service.post("/api/v1/alerts/feed").json()["url"]
    root = ElementTree.fromstring(service.get(feed).content)
    atom = "{http://www.w3.org/2005/Atom}"
    assert len(root.findall(f"{atom}entry")) == len(alerts)
    assert service.get("/feeds/wrong.atom").status_code == 404
    assert service.post("/api/v1/alerts/feed").json()["url"] != feed
    assert service.get(feed).status_code == 404
    page = service.get(f"/crafts/{craft['id']}")
    assert page.status_code == 200
    assert "alert" in page.text
    # New propellers explain it: the flights since then are a craft of their own, so to say.
    note = {"text": "new <b>propellers</b>", "at": "2025-06-08T20:00:00Z", "boundary": True}
    assert service.post(f"/api/v1/crafts/{craft['id']}/notes", json=note).status_code == 201
    parted = settled(service, craft["id"])
    assert len(parted["review"]["pooled"]) == 6
    (since,) = parted["review"]["since"]
    assert since["significant"]
    assert since["difference"] == pytest.approx(-1.5, abs=0.05)
    drawn = service.get(f"/crafts/{craft['id']}/report")
    assert drawn.status_code == 200, drawn.text
    assert "new &lt;b&gt;propellers&lt;/b&gt;" in drawn.text
    assert "sandbox" in drawn.headers["Content-Security-Policy"]


def test_flights_analysed_together_have_their_models_and_gains_under_the_stable_address(service: httpx.Client) -> None:
    """The files of several logs lie below their flights; the address of the craft leads to the newest that has them."""
    facts = [(0, {"trust": "yes"}), (1, {"gains": "ATC_RAT_RLL_P,0.12"}), (2, {"trust": "limited"})]
    files = [("file", (f"flight{day}.bin", flights.log(day, **fact))) for day, fact in facts]
    logs = [log["id"] for log in service.post("/api/v1/logs", files=files).json()["logs"]]
    ordered = service.post("/api/v1/analyses", json={"logs": logs}).json()
    wait_until(lambda: service.get(f"/api/v1/analyses/{ordered['id']}").json()["state"] == "done")
    here = f"{only_craft(service)['links']['self']}/model"
    gains = service.get(f"{here}/proposed.param")
    assert (gains.text, gains.headers["Rotorid-Analysis"]) == ("ATC_RAT_RLL_P,0.12", ordered["id"])


def test_a_board_that_was_moved_is_split_and_merged_by_its_owner(service: httpx.Client) -> None:
    for day in range(4):
        fly(service, f"flight{day}.bin", flights.log(day))
    craft = only_craft(service)
    answer = service.get(f"/api/v1/crafts/{craft['id']}/flights").json()
    theirs = [flight["id"] for flight in answer if flight["name"] in ("flight2", "flight3")]
    moved = service.post("/api/v1/crafts/flights/move", json={"flights": theirs, "later": True}).json()
    assert moved["flights"] == 2
    assert moved["id"] != craft["id"]
    fly(service, "flight4.bin", flights.log(4))  # goes where flights like it go now
    assert service.get(f"/api/v1/crafts/{moved['id']}").json()["flights"] == 3
    # Analysed again, a flight stays where its owner put it.
    log = next(flight["log"] for flight in answer if flight["name"] == "flight0")
    assert service.post("/api/v1/analyses", json={"logs": [log]}).status_code == 202
    settled(service, craft["id"])
    assert service.get(f"/api/v1/crafts/{craft['id']}").json()["flights"] == 2
    named = service.put(f"/api/v1/crafts/{moved['id']}", json={"name": "Octo  2"}).json()
    assert named["name"] == "Octo 2"
    whole = service.post(f"/api/v1/crafts/{craft['id']}/merge", json={"craft": moved["id"]}).json()
    assert (whole["flights"], whole["name"]) == (5, "Octo 2")
    assert service.get(f"/api/v1/crafts/{moved['id']}").status_code == 404
    merged = service.post(f"/api/v1/crafts/{craft['id']}/merge", json={"craft": craft["id"]})
    assert merged.status_code == 404


def test_flights_of_one_name_and_clocks_of_1980_and_none(service: httpx.Client) -> None:
    logs = [fly(service, "00000012.BIN", flights.log(day)) for day in (0, -16600, None)]  # the second in January 1980
    craft = settled(service, only_craft(service)["id"])
    names = ["00000012", "00000012 (2)", "00000012 (3)"]
    assert craft["review"]["flights"] == names
    assert f"the clock of {names[1]}, {names[2]} was not set" in craft["review"]["remarks"][0]
    assert service.get(f"/crafts/{craft['id']}").status_code == 200
    before = service.parts.crafts.log_before
    assert [before(log, "") for log in logs[:2]] == [(logs[1], "00000012.BIN"), None]
    assert before(logs[0], "bob") is None


def test_names_and_notes_hold_no_control_characters_and_times_are_in_the_calendar(service: httpx.Client) -> None:
    """A terminal would obey them, and PostgreSQL keeps no NUL; a time without one in UTC was an unexpected error."""
    fly(service, "a.bin", flights.log(0))
    here = only_craft(service)["links"]["self"]
    assert service.put(here, json={"name": "Octo\x1b[2J\x00 2\u202e"}).json()["name"] == "Octo[2J 2"
    note = service.post(f"{here}/notes", json={"text": "new\x07 propellers\nand\x9b motors\x00"}).json()
    assert note["text"] == "new propellers\nand motors"
    early = service.post(f"{here}/notes", json={"text": "x", "at": "0001-01-01T00:00:00+14:00"})
    assert early.status_code == 422


def test_forms_work_without_scripts(service: httpx.Client) -> None:
    for day in range(2):
        fly(service, f"flight{day}.bin", flights.log(day))
    craft = only_craft(service)
    here = f"/crafts/{craft['id']}"
    (flight, _) = service.get(craft["links"]["flights"]).json()
    for address, fields in [
        ("name", {"name": "Ours"}),
        ("notes", {"text": "new ESC", "day": "2025-06-01 20:00", "boundary": "true"}),
    ]:
        answer = service.post(f"{here}/{address}", data=fields)
        assert (answer.status_code, answer.headers["Location"]) == (303, here)
    assert service.post(f"{here}/notes", data={"text": "x", "day": "someday"}).status_code == 422
    text = service.get(here).text
    assert "Ours" in text
    assert "new ESC" in text
    (note,) = service.get(f"/api/v1{here}").json()["notes"]
    assert service.post(f"{here}/notes/{note['id']}/delete").status_code == 303
    moved = service.post(f"{here}/move", data={"flights": flight["id"]})
    assert moved.status_code == 303
    assert moved.headers["Location"] != here
    assert service.post(f"{moved.headers['Location']}/merge", data={"craft": craft["id"]}).status_code == 303
    assert only_craft(service)["flights"] == 2
    assert "Ours" in service.get("/crafts").text


def test_a_folder_of_the_command_line_shows_the_same_craft(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`rotorid analyze` of a folder, then `rotorid serve --out`: the same flights, craft, pages; uploads join."""
    import pipeline
    import reports
    from pipeline.fleet import crafts, job
    from tests.pipeline import flown

    monkeypatch.setattr(job, "analyze_flights", flown.analyze_flights)
    monkeypatch.setattr(crafts, "identify_craft", flown.identify_craft)
    logs, out = tmp_path / "logs", tmp_path / "out"
    logs.mkdir()

    def analyze(count: int) -> None:
        for number in range(count):
            (logs / f"flight{number}.bin").write_text(f"octa {number}")
        pipeline.analyze_fleet([logs], None, None, None, store=out, publish=reports.write)

    analyze(2)
    with served(data=tmp_path / "data", workers=1, out=out, analyze=flights.analyze) as client:
        wait_until(lambda: client.get("/api/v1/crafts").json()["items"])
        craft = settled(client, only_craft(client)["id"])
        assert craft["review"]["flights"] == ["flight0", "flight1"]
        answer = client.get(craft["links"]["flights"]).json()
        assert {flight["log"] for flight in answer} == {None}
        page = client.get(f"/folder/{answer[0]['id']}")
        assert (page.status_code, "sandbox" in page.headers["Content-Security-Policy"]) == (200, True)
        assert page.text == (out / "flights" / answer[0]["name"] / "report.html").read_text("utf-8")
        known = client.get("/api/v1/questions/parameters", params={"flight": "flight1"})
        assert known.status_code == 200
        fly(client, "upload.bin", flights.log(9))
        assert only_craft(client)["flights"] == 3
        analyze(3)
        wait_until(lambda: only_craft(client)["flights"] == 4)
        assert client.get(f"/crafts/{craft['id']}").status_code == 200
