"""A log has one finding of each kind, which says what its parts say, each thing once."""

from core.findings import Finding, Severity, apart, gathered


def finding(reason: str, advice: str = "", severity: Severity = Severity.WARNING, **evidence: float | str) -> Finding:
    return Finding("log-gaps", severity, reason, advice, evidence)


def test_findings_that_differ_in_numbers_are_said_once_with_their_count():
    parts = finding("GPS is silent for 1.5 s.", gap=1.5), finding("GPS is silent for 12 s.", gap=12.0)
    (shown,) = gathered(parts)
    assert shown.reason == "GPS is silent for 1.5 s; 1 more such."
    assert shown.parts == parts


def test_all_sentences_of_a_kind_are_said_the_gravest_first_and_advice_once():
    note = finding("The IMU is silent for 2 s.", "Use a faster card.", Severity.INFO)
    (shown,) = gathered([note, finding("GPS is silent for 2 s", "use a faster card.")])
    assert shown.reason == "GPS is silent for 2 s. The IMU is silent for 2 s."
    assert (shown.severity, shown.advice) == (Severity.WARNING, "Use a faster card.")


def test_what_two_stages_say_of_the_same_thing_is_said_once():
    both = finding("No compass.", what="mag"), finding("No magnetometer: heading drifts.", what="mag")
    (shown,) = gathered(both)
    assert shown.reason == "No compass."
    assert tuple(apart(gathered([shown, finding("No GPS.", what="gps")])))[:2] == both
