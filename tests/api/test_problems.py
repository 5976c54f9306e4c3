"""Every error has one shape, and every answer the safe headers."""

from collections.abc import Callable

import httpx
import pytest

NOBODY = "0" * 32


@pytest.mark.parametrize(
    ("method", "path", "status"),
    [
        ("GET", "/nothing/here", 404),
        ("GET", "/static/nothing.js", 404),
        ("GET", f"/api/v1/logs/{NOBODY}", 404),
        ("GET", "/api/v1/logs/..%2f..%2fetc", 404),
        ("GET", f"/api/v1/analyses/{NOBODY}", 404),
        ("GET", f"/api/v1/analyses/{NOBODY}/report.html", 404),
        ("GET", "/api/v1/analyses/not-an-id", 404),
        ("DELETE", "/api/v1/logs", 405),
        ("PUT", "/", 405),
        ("POST", "/api/v1/logs?analyze=perhaps", 422),
        ("POST", "/api/v1/analyses", 422),
        ("POST", "/api/v1/logs", 415),
    ],
)
def test_errors_have_one_shape(service: httpx.Client, method: str, path: str, status: int) -> None:
    response = service.request(method, path)
    assert response.status_code == status
    assert response.headers["Content-Type"] == "application/problem+json"
    problem = response.json()
    assert {"type", "title", "status", "detail"} <= problem.keys() <= {"type", "title", "status", "detail", "errors"}
    assert problem["status"] == status
    assert response.headers["X-Content-Type-Options"] == "nosniff"


def test_a_wrong_method_is_told_the_right_ones(service: httpx.Client) -> None:
    assert service.delete("/api/v1/logs").headers["Allow"] == "POST"


def test_an_invalid_request_is_told_what_and_where(service: httpx.Client) -> None:
    errors = service.post("/api/v1/analyses", json={"log": 3, "poles": 5}).json()["errors"]
    assert [error["where"] for error in errors] == ["body: log", "body: poles"]


def test_a_setting_that_is_not_known_is_refused_and_no_link_made_that_never_ends(
    service: httpx.Client, upload: Callable[..., httpx.Response]
) -> None:
    analysis = upload(service, b"good log").json()["id"]
    days = {"days": 2}  # which stand in the query
    for asked, where in (({"params": {"day": 2}}, "query: day"), ({"json": days, "params": days}, "body")):
        answer = service.post(f"/api/v1/analyses/{analysis}/shares", **asked)
        assert answer.status_code == 422
        assert [error["where"] for error in answer.json()["errors"]] == [where]


def test_ranges_of_a_result(service: httpx.Client, upload: Callable[..., httpx.Response]) -> None:
    table = upload(service, b"good log").json()["links"]["rmse.csv"]
    part = service.get(table, headers={"Range": "bytes=0-5"})
    assert (part.status_code, part.text) == (206, "flight")
    for wrong, status in (("bytes=9999-", 416), ("bytes=x", 400)):
        response = service.get(table, headers={"Range": wrong})
        assert response.status_code == status
        assert response.json()["status"] == status


def test_a_person_gets_a_page_and_a_script_json(service: httpx.Client) -> None:
    browser = {"Accept": "text/html,application/xhtml+xml"}
    page = service.get(f"/analyses/{NOBODY}", headers=browser)
    assert page.status_code == 404
    assert "There is no analysis of this id." in page.text
    assert service.get(f"/api/v1/analyses/{NOBODY}", headers=browser).json()["status"] == 404


def test_a_bug_answers_in_the_same_shape(service: httpx.Client, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise RuntimeError("surprise")

    monkeypatch.setattr("api.logs.catalog.Catalog.find_log", fail)
    response = service.get(f"/api/v1/logs/{NOBODY}")
    assert response.status_code == 500
    assert response.json()["detail"].startswith("The service made a mistake")
    assert "surprise" not in response.text
    assert response.headers["X-Content-Type-Options"] == "nosniff"


def test_a_report_is_shut_into_a_sandbox(service: httpx.Client, upload: Callable[..., httpx.Response]) -> None:
    links = upload(service, b"good log").json()["links"]
    report = service.get(links["report.html"]).headers["Content-Security-Policy"]
    assert "sandbox" in report
    assert "allow-same-origin" not in report
    page = service.get(links["page"]).headers["Content-Security-Policy"]
    assert "script-src 'self';" in page
    assert "unsafe" not in page
