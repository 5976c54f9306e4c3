"""Findings that say the same but for their numbers are shown once; others of the same kind stand by themselves."""

from core.findings import Finding, Severity, once


def finding(reason: str, **evidence: float) -> Finding:
    return Finding("gap-in-table", Severity.WARNING, reason, evidence=evidence)


def test_findings_that_differ_in_numbers_are_shown_once_with_their_count():
    (shown,) = once([finding("GPS is silent for 1.5 s.", gap=1.5), finding("GPS is silent for 12 s.", gap=12.0)])
    assert shown.reason == "GPS is silent for 1.5 s; 1 more such."
    assert shown.evidence == {"gap": 1.5, "count": 2}


def test_another_sentence_of_the_same_kind_is_not_swallowed():
    both = finding("GPS is silent for 2 s."), finding("The IMU is silent for 2 s.")
    assert once(both) == both
