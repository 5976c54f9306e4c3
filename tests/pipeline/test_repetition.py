"""Findings said twice, or once for each of many happenings, against what a reader needs: each thing once."""

from logparse import Finding, Severity
from pipeline.flight.health.repetition import without_repetition


def _glitch(start: float) -> Finding:
    return Finding(
        "gps-glitch",
        Severity.WARNING,
        f"GPS positions up to 44 m off were refused from t = {start:.1f} to {start + 1:.1f} s.",
        "Look at satellites.",
        {"start": start, "stop": start + 1.0, "fixes": 3},
    )


def _plain(name: str, reason: str = "Said.") -> Finding:
    return Finding(name, Severity.WARNING, reason)


def test_happenings_of_one_kind_are_one_line() -> None:
    findings = [_glitch(94.1), _plain("gps-poor"), *(_glitch(100.0 + k) for k in range(40))]

    glitch, other = without_repetition(findings)

    assert glitch.reason == (
        "GPS positions up to 44 m off were refused from t = 94.1 to 95.1 s. "
        "40 more such, the last from t = 139.0 s to 140.0 s."
    )
    assert glitch.evidence == {
        "start": 94.1,
        "stop": 95.1,
        "fixes": 3,
        "count": 41,
        "last_start": 139.0,
        "last_stop": 140.0,
    }
    assert other.id == "gps-poor"


def test_missing_sensors_are_told_once() -> None:
    log = [_plain("no-gps", "No GPS in the log."), _plain("no-mag", "No magnetometer in the log.")]
    trajectory = [_plain("no-gps", "No usable GPS fix."), _plain("no-magnetometer"), _plain("no-baro")]

    assert [f.reason for f in without_repetition([*log, *trajectory])] == [
        "No GPS in the log.",
        "No magnetometer in the log.",
        "Said.",
    ]
    assert [f.id for f in without_repetition([_plain("gps-no-fix"), _plain("no-gps")])] == ["gps-no-fix"]


def test_what_differs_stays() -> None:
    findings = [
        _plain("sensor-refused", "4% of the GPS."),
        _plain("sensor-refused", "9% of the barometer."),
        _glitch(3.0),
    ]

    assert without_repetition(findings) == tuple(findings)
    assert without_repetition([findings[0], findings[0]]) == (findings[0],)
