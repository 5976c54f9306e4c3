"""What methods agree on: the headline, and the finding where they do not."""

from dataclasses import replace

import pytest

from sysid.rigid_body.consensus import TRUSTED, Statement, consensus, disagreement


def said(method, value, own=0.01, curve=0.1):
    return Statement(method, value, (own**2 + curve**2) ** 0.5, curve)


def test_methods_that_agree_have_the_best_one_for_a_headline_and_no_finding():
    """The curve that they share lets them all be wrong together; it neither separates nor widens."""
    statements = [said("mean thrust", 3.32), said("rigid body", 3.33, own=0.005), said("Kim 2017", 3.35)]
    best = consensus(statements)
    assert (best.method, best.value, best.against) == ("rigid body", 3.33, ())
    assert best.sigma == pytest.approx(statements[1].sigma)
    assert disagreement({"thrust": statements}) is None


def test_wind_of_8_m_s_makes_methods_disagree_and_the_headline_covers_them():
    """2.80, 2.92, 3.32, 3.36 side by side, truth 3.33: none of four numbers with two per mille is right by itself."""
    values = {"mean thrust": 2.80, "Refinement 2020, stacked": 2.92, "Kim 2017": 3.36, "rigid body": 3.32}
    statements = [said(method, value) for method, value in values.items()]
    finding = disagreement({"thrust over mass": statements, "motor lag": [said("rigid body", 0.02)]})
    assert finding.id == "methods-disagree"
    assert finding.evidence["parameters"] == "thrust over mass"
    assert all(method in finding.reason for method in values)
    best = consensus(statements)
    assert abs(best.value - 3.33) < 2.0 * best.sigma
    assert best.sigma > 0.28
    assert best.against


def test_a_curve_that_two_methods_share_does_not_excuse_their_difference():
    """7.6 ± 0.9 N beside 9.8 ± 0.7 N, most of it by one curve: silent while it counted for both."""
    curved = [Statement("Kim 2017", 7.6, 0.9, 0.85), Statement("mean thrust", 9.8, 0.7, 0.65)]
    assert disagreement({"thrust over mass": curved}) is not None
    apart = [curved[0], replace(curved[1], method="rigid body", curve=0.0)]
    assert disagreement({"thrust over mass": apart}) is None


def test_one_against_all_is_not_the_headline():
    statements = [said("rigid body", 3.03, own=0.001), *(said(method, 3.21) for method in TRUSTED[1:])]
    best = consensus(statements)
    assert best.method == TRUSTED[1]
    assert best.against == ("rigid body",)


def test_what_is_not_trusted_makes_neither_headline_nor_finding():
    statements = [said("rotor", 9.0), said("Refinement 2020, mean", 1.0)]
    assert consensus(statements) is None
    assert disagreement({"thrust": statements}) is None
    assert consensus([*statements, said("mean thrust", 3.0)]).value == 3.0
