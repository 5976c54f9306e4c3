"""Reports in a browser: axe-core finds nothing serious in them, bright or dark, wide or narrow, with all unfolded."""

from datetime import timedelta

import numpy as np
import pandas as pd
import pytest

from logparse import Finding, Severity
from pipeline.fleet.review import review
from pipeline.results.drift import CraftNote
from reports.pages.fleet import craft_page
from reports.pages.parameters import parameters_page
from sysid.rigid_body.physical import HEADLINE, PhysicalParameters
from tests.pipeline.builders import OCTA, START, hovering
from tests.reports.builders import page_of
from tests.reports.conftest import composed


@pytest.fixture(scope="module")
def pages(flight, other, fleet, tmp_path_factory):
    folder = tmp_path_factory.mktemp("pages")
    (folder / "flight.html").write_text(page_of(flight), encoding="utf-8")
    return {
        "flight": folder / "flight.html",
        "folder": fleet / "report.html",
        "craft": _of_a_craft(folder / "craft.html"),
        "craft over flights": _over_flights(folder / "review.html"),
        "folder without a craft": composed(folder / "alone", [flight, other]),
        "nothing": composed(folder / "nothing", []),
    }


def _of_a_craft(file):
    """Write the page of `rotorid craft`: one parameter known, one not, by two methods that disagree."""
    known, unknown = (
        (2.6, 0.02, "m/s^2, at full command", 10.4, 0.1, "N", ""),
        (None, None, "s", None, None, "", "slow"),
    )
    names = ("value", "sigma", "unit", "si_value", "si_sigma", "si_unit", "note")
    rows = {
        ("thrust over mass", HEADLINE): known,
        ("thrust over mass", "rigid body"): known,
        ("motor lag", "rigid body"): unknown,
    }
    table = pd.DataFrame.from_dict(rows, orient="index", columns=names)
    table.index = pd.MultiIndex.from_tuples(rows, names=["parameter", "method"])
    finding = Finding("methods-disagree", Severity.WARNING, "two methods disagree", "weigh the craft")
    parameters = PhysicalParameters(table, None, None, None, None, (finding,))
    file.write_text(parameters_page(parameters, OCTA, ["flight.bin"], 4.3), encoding="utf-8")
    return file


def _over_flights(file):
    """Write the page of a craft one of whose motors weakens, with new propellers before its fifth flight."""
    flights = hovering(np.random.default_rng(1), "octa", 8, weak=3, loss=0.01, scatter=0.001)
    note = CraftNote(at=START + timedelta(days=3, hours=12), text="new propellers", boundary=True)
    file.write_text(craft_page(review(flights, [note]), "our <b>octa</b>", [note]), encoding="utf-8")
    return file


@pytest.fixture(scope="module")
def page(browser):
    return browser.new_page()


NAMES = ("flight", "folder", "craft", "craft over flights", "folder without a craft", "nothing")


@pytest.mark.parametrize(
    ("name", "scheme", "width"),
    # All pages are of one style sheet: one of them shows it bright as well.
    [*((name, "dark", 390) for name in NAMES), ("flight", "light", 1280)],
)
def test_nothing_serious_is_found(pages, page, name, scheme, width):
    serious = pytest.importorskip("tests.axe").serious
    page.emulate_media(color_scheme=scheme)
    page.set_viewport_size({"width": width, "height": 800})
    page.goto(pages[name].as_uri())
    page.evaluate("document.querySelectorAll('details').forEach((each) => { each.open = true; })")
    assert serious(page) == []
    assert page.evaluate("document.documentElement.scrollWidth") <= width
