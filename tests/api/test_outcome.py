"""The line that the list shows of an analysis, read from its report."""

from pathlib import Path

import pytest

from api.work.outcome import Outcome, read_outcome
from core.serialization import as_json
from pipeline.results.report import FleetReport
from tests.reports.made import made


def flight(word: str, tone: str, day: str | None = "2026-03-14T09:00:00+00:00") -> dict[str, object]:
    return {
        "vehicle": {"firmware": "ArduCopter", "autopilot": "ArduPilot", "frame_class": "octa", "frame_type": "plus"},
        "log": {"start_utc": day},
        "answer": {
            "lines": [
                {"purpose": "Loops", "word": "slow", "tone": "bad"},
                {"purpose": "Happened", "word": word, "tone": tone, "text": f"{word}."},
            ]
        },
    }


def test_of_several_flights_the_worst_counts(tmp_path: Path) -> None:
    flights = [flight("yes", "good"), flight("no", "bad", "2026-01-02T00:00:00+00:00"), flight("mostly", "care", None)]
    (tmp_path / "report.json").write_text(as_json(made(FleetReport, flights=flights)))
    found = read_outcome(tmp_path)
    assert found == Outcome(craft="ArduCopter octa plus", flown="2026-01-02", happened="no.", health="no", tone="bad")


@pytest.mark.parametrize(
    "content", [None, "{", "[]", '{"kind": "flight"}', '{"kind": "fleet", "flights": [null]}', "\udc80"]
)
def test_what_cannot_be_read_gives_no_line(tmp_path: Path, content: str | None) -> None:
    if content is not None:
        (tmp_path / "report.json").write_bytes(content.encode("utf-8", "surrogatepass"))
    assert read_outcome(tmp_path) == Outcome()
