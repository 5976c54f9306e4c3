"""The pages say what there is to say without scripts, and escape what they were given."""

from pathlib import Path

import httpx
import pytest

from api.routes.pages import samples
from tests.api.conftest import Upload
from tests.api.programs import wait_until
from tests.reports.builders import Page


def test_a_browser_without_scripts_is_led_from_form_to_report(service: httpx.Client) -> None:
    answer = service.post("/", files={"file": ("paper01.BIN", b"slow")})
    assert answer.status_code == 303
    page = service.get(answer.headers["Location"])
    assert "<h1" in page.text
    assert "Analysing paper01.BIN" in page.text
    assert Page(page.text).all("meta")[-1]["http-equiv"] == "refresh"
    address = answer.headers["Location"]
    wait_until(lambda: service.get(f"/api/v1{address}").json()["state"] == "done")
    frame = Page(service.get(answer.headers["Location"]).text).all("iframe")[0]
    assert frame["title"] == "Report on paper01.BIN"
    assert "<title>report</title>" in service.get(frame["src"] or "").text


def test_a_sample_is_analysed_as_if_uploaded(
    service: httpx.Client, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "calm.bin").write_bytes(b"good sample")
    (tmp_path / "calm.json").write_text('{"what": "simulated by rotorid, not flown: steps <in> place"}')
    (tmp_path / "bare.bin").write_bytes(b"good too")
    monkeypatch.setattr("api.routes.pages.samples", lambda: samples(tmp_path))
    page = service.get("/").text
    assert "calm: steps &lt;in&gt; place" in page
    assert [option["value"] for option in Page(page).all("option")] == ["bare", "calm"]
    answer = service.post("/samples", data={"name": "calm"})
    assert answer.status_code == 303
    assert service.get(f"/api/v1{answer.headers['Location']}").json()["log"]["name"] == "calm.bin"
    for name in ("../calm", "calm.json", ""):
        assert service.post("/samples", data={"name": name}).status_code == 404
    monkeypatch.setattr("api.routes.pages.samples", lambda: samples(tmp_path / "none"))
    assert "sample" not in service.get("/").text


def test_htmx_comes_from_us(service: httpx.Client) -> None:
    for script in Page(service.get("/").text).all("script"):
        assert (script["src"] or "").startswith("/static/")
    htmx = service.get("/static/htmx.min.js")
    assert (htmx.status_code, htmx.text[:8]) == (200, "var htmx")


def test_the_list_has_parts_and_logs_are_analysed_together_again(service: httpx.Client) -> None:
    files = [("file", (name, f"good {name}".encode())) for name in ("a.bin", "b.bin")]
    logs = [log["id"] for log in service.post("/api/v1/logs", files=files).json()["logs"]]
    orders = [service.post("/api/v1/analyses", json={"logs": logs}).headers["Location"] for _ in range(27)]
    wait_until(lambda: bool(service.get(orders[0]).json()["ended"]))
    for address in orders:
        service.post(f"{address}/cancel")

    def links(path: str) -> list[str]:
        return [link["href"] or "" for link in Page(service.get(path).text).all("a")]

    newest = links("/analyses")
    older = links(next(link for link in newest if "after=" in link))
    pages = [order.removeprefix("/api/v1") for order in reversed(orders)]
    assert [link for link in newest if link in pages] == pages[:25]
    assert [link for link in older if link in pages] == pages[25:]
    assert "No analysis is waiting." in service.get("/analyses?state=queued").text
    assert 'value="b.bin"' in service.get(f"{pages[-1]}/again").text
    again = service.post(f"{pages[-1]}/again", data={"training": ["b.bin"]}).headers["Location"]
    assert service.get(f"/api/v1{again}").json()["configuration"] == {"training": ["b.bin"]}


def test_buttons_work_without_scripts(service: httpx.Client, upload: Upload) -> None:
    page = upload(service, b"good buttons").json()["links"]["page"]
    shared = service.post(f"{page}/share", data={"days": "7"}).text
    link = next(field["value"] for field in Page(shared).all("input") if field.get("id") == "link") or ""
    assert Page(service.get(link).text).all("iframe")[0]["title"] == "Report on flight.bin"
    assert "taken back" in service.post(f"{page}/unshare").text
    assert service.get(link, headers={"Accept": "text/html"}).status_code == 404
    again = service.post(f"{page}/again", data={"poles": "2", "zeros": "1", "mass": ""})
    assert again.status_code == 303
    assert service.get(f"/api/v1{again.headers['Location']}").json()["configuration"] == {"poles": 2, "zeros": 1}
    for wrong, says in (({"poles": "many"}, "poles: Input should be"), ({"mass": "-1"}, "mass: Input should be")):
        refused = service.post(f"{page}/again", data=wrong)
        assert refused.status_code == 422
        assert says in refused.text.replace("Poles", "poles").replace("Mass", "mass")
    cancelled = service.post(f"{again.headers['Location']}/cancel", data={"next": "//example.com"})
    assert cancelled.headers["Location"] == "/"
    assert service.post(f"{page}/delete").headers["Location"] == "/analyses"
    assert service.get(f"/api/v1{page}").status_code == 404
    for action in ("cancel", "delete", "share", "unshare", "again"):
        assert service.post(f"{page}/{action}").status_code == 404
