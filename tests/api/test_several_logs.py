"""Several logs in one analysis: what the service keeps of them, and what stays on the server."""

import json

from api.worker import Task, analyze_logs
from pipeline.fleet import job, joint
from tests.pipeline import flown


def test_products_are_kept_and_places_on_the_server_are_not(tmp_path, monkeypatch):
    monkeypatch.setattr(job, "analyze_flights", flown.analyze_flights)
    monkeypatch.setattr(joint, "identify_craft", flown.identify_craft)
    logs = []
    for number in (1, 2):
        log = tmp_path / "secret-place" / str(number) / f"flight{number}.bin"
        log.parent.mkdir(parents=True)
        log.write_text(f"octa {number}")
        logs.append((log, log.name))
    told = []
    results = tmp_path / "results"
    analyze_logs(Task(logs, {"poles": 1, "zeros": 0}, results), lambda stage, fraction: told.append(fraction))
    files = {path.relative_to(results).as_posix() for path in results.rglob("*") if path.is_file()}
    assert {"report.html", "report.json", "models.json", "rmse.csv"} <= files
    assert {f"flights/flight{number}/report.html" for number in (1, 2)} <= files
    assert "plotly.min.js" not in files, "the sandbox of reports lets no script be fetched"
    assert b'id="plotly"' in (results / "flights/flight1/report.html").read_bytes()
    assert any(name.startswith("tables/trajectory/") and name.endswith(".parquet") for name in files)
    assert not [name for name in files if b"secret-place" in (results / name).read_bytes()]
    assert not [name for name in files if name.rpartition("/")[2].startswith((".", "entry", "manifest"))]
    numbers = json.loads((results / "report.json").read_text("utf-8"))
    assert [flight["name"] for flight in numbers["flights"]] == ["flight1", "flight2"]
    assert told == sorted(told)
