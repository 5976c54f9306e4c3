"""Two reports against each other: a change is found when it is larger than flights differ, and only then."""

import json
import math

import numpy as np
import pytest
from typer.testing import CliRunner

from core.serialization import as_json
from pipeline.config import ConfigError
from pipeline.fleet.comparison import compare_reports
from pipeline.results.report import FleetReport
from reports.pages import html
from reports.pages.comparison import comparison_markdown, comparison_page
from rotorid.cli.main import app
from tests.reports.made import made

VEHICLE = {"frame_class": "quad", "frame_type": "x", "spin_min": 0.15, "board_id": "7"}


def model(errors, trust="limited", key="reference", title="position target → position"):
    rows = [
        {"flight": f"flight{k}", "part": "held-out", "rmse_m": {"x": error}, "rmse_mean_m": {"x": 4.0}}
        for k, error in enumerate(errors)
    ]
    return {
        "key": key,
        "title": title,
        "verdict": {"trust": trust, "sentence": ""},
        "rmse": rows,
        "rmse_average_m": {"x": float(np.mean(errors))},
    }


def craft(thrust, sigma=0.02, *, lag=(), errors=(0.2, 0.21, 0.19), name="quad x", vehicle=VEHICLE):
    """Make a craft with as many flights as values of thrust."""
    names = [f"flight{k}" for k in range(len(thrust))]

    def followed(parameter, values, unit, sigma):
        return {
            "parameter": parameter,
            "method": "rigid body",
            "unit": unit,
            "others": {},
            "flights": [{"flight": name, "value": v, "sigma": sigma} for name, v in zip(names, values, strict=False)],
        }

    return {
        "name": name,
        "vehicle": vehicle,
        "training": names[::2],
        "held_out": names[1::2],
        "models": [model(errors)],
        "drift": {
            "parameters": [
                followed("thrust over mass", thrust, "m/s^2, one motor at full command", sigma),
                followed("motor lag", lag, "s", 0.004),
            ]
        },
    }


def report(*crafts, **config):
    names = dict.fromkeys(name for side in crafts for name in (*side["training"], *side["held_out"]))
    return made(
        FleetReport,
        rotorid="0.1.0",
        config={"rate": 10.0} | config,
        groups=list(crafts),
        flights=[{"name": name, "log": {"start_utc": f"2026-03-{k + 1:02d}T10:00:00"}} for k, name in enumerate(names)],
    )


def only(numbers, parameter="thrust over mass"):
    (pair,) = numbers.pairs
    return next(row for row in pair.parameters if row.parameter == parameter)


def test_a_change_beyond_the_scatter_of_flights_is_found_with_its_size():
    rng = np.random.default_rng(5)
    before = rng.normal(7.0, 0.05, 6)
    after = rng.normal(7.7, 0.05, 6)
    row = only(compare_reports(report(craft(before)), report(craft(after)), ("a", "b")))
    assert row.significant
    assert abs(row.difference_percent - 10.0) < 3.0 * row.difference_sigma / 7.0 * 100.0
    assert row.interval_percent[0] < 10.0 < row.interval_percent[1]
    assert row.between_flights == pytest.approx(0.05, abs=0.03)


def test_single_flights_are_compared_by_their_fits_and_the_limit_of_that_is_said():
    numbers = compare_reports(report(craft([7.0])), report(craft([7.1])), ("a", "b"))
    row = only(numbers)
    assert row.difference_sigma == pytest.approx(0.02 * math.sqrt(2.0))
    assert row.between_flights is None
    assert any(
        "one flight on each side that tells it (thrust over mass)" in sentence
        for sentence in numbers.pairs[0].sentences
    )


def test_only_what_both_sides_determined_is_compared():
    numbers = compare_reports(report(craft([7.0, 7.1], lag=[0.04, 0.05])), report(craft([7.0, 7.1])), ("a", "b"))
    assert [row.parameter for row in numbers.pairs[0].parameters] == ["thrust over mass"]
    nothing = compare_reports(report(craft([], lag=[0.1])), report(craft([7.0])), ("a", "b"))
    assert nothing.pairs[0].parameters == ()
    assert "No parameter is determined on both sides" in nothing.pairs[0].sentences[0]


def test_many_parameters_do_not_make_a_change_likelier():
    """A difference of 2.2 standard errors is news when it is the only one asked for, and none among two."""
    one = only(compare_reports(report(craft([7.0])), report(craft([7.0 + 2.2 * 0.02 * math.sqrt(2.0)])), ("a", "b")))
    two = only(
        compare_reports(
            report(craft([7.0], lag=[0.04])),
            report(craft([7.0 + 2.2 * 0.02 * math.sqrt(2.0)], lag=[0.041])),
            ("a", "b"),
        )
    )
    assert one.significant
    assert not two.significant
    assert two.p_adjusted == pytest.approx(2.0 * two.p)


def test_errors_of_models_settings_and_verdicts_stand_side_by_side():
    other = craft([7.0, 7.1], errors=(0.4, 0.42, 0.38), vehicle=VEHICLE | {"spin_min": 0.12})
    numbers = compare_reports(report(craft([7.0, 7.1])), report(other, rate=20.0), ("a", "b"))
    (pair,) = numbers.pairs
    (error,) = pair.errors
    assert error.ratio == pytest.approx(2.0)
    assert error.p < 0.001
    assert {row.name: (row.a, row.b) for row in pair.changed} == {
        "spin_min": (0.15, 0.12),
        "rate": (10.0, 20.0),
    }
    assert [(verdict.model, verdict.a, verdict.b) for verdict in pair.verdicts] == [("reference", "limited", "limited")]


def test_crafts_are_paired_by_name_and_the_lone_ones_named():
    a = report(craft([7.0, 7.1]), craft([3.0, 3.1], name="octa plus"), craft([1.0], name="hexa x"))
    b = report(craft([3.0, 3.2], name="octa plus"), craft([7.0, 7.1]))
    numbers = compare_reports(a, b, ("a", "b"))
    assert [(pair.a.name, pair.b.name) for pair in numbers.pairs] == [
        ("quad x", "quad x"),
        ("octa plus", "octa plus"),
    ]
    assert (numbers.unpaired.a, numbers.unpaired.b) == (("hexa x",), ())
    assert "only in a: hexa x" in comparison_page(numbers)


@pytest.fixture
def folders(tmp_path):
    rng = np.random.default_rng(3)
    for name, mean in (("march", 7.0), ("april", 7.7)):
        (tmp_path / name).mkdir()
        numbers = report(craft(rng.normal(mean, 0.05, 5)))
        (tmp_path / name / "report.json").write_text(as_json(numbers), "utf-8")
    return tmp_path


def test_the_command_prints_the_change_and_writes_page_text_and_numbers(folders):
    out = folders / "out"
    args = ["compare", str(folders / "march"), str(folders / "april" / "report.json"), "--out", str(out)]
    ran = CliRunner().invoke(app, args)
    assert ran.exit_code == 0, ran.output
    assert "Changed, of 1 parameters compared: thrust over mass +" in ran.output
    assert {path.name for path in out.iterdir()} == {"comparison.html", "comparison.md", "comparison.json"}
    numbers = json.loads((out / "comparison.json").read_text("utf-8"))
    assert (numbers["a"]["report"], numbers["b"]["report"]) == ("march", "april")
    assert "| Thrust over mass, rigid body (m/s²) |" in (out / "comparison.md").read_text("utf-8")
    assert json.loads(CliRunner().invoke(app, [*args, "--json"]).stdout) == numbers


@pytest.mark.parametrize("content", ["[1, 2]", '{"kind": "comparison"}', "\xff"])
def test_what_is_no_report_is_refused_in_a_sentence(folders, content):
    (folders / "odd.json").write_text(content, "latin-1")
    ran = CliRunner().invoke(app, ["compare", str(folders / "march"), str(folders / "odd.json")])
    assert isinstance(ran.exception, ConfigError)
    assert "odd.json" in str(ran.exception)


def test_text_of_reports_is_escaped_in_the_page(monkeypatch):
    # Templates that were compiled before, with other settings, would be taken from the disk.
    monkeypatch.setattr(html, "_bytecode_cache", lambda: None)
    html._environment.cache_clear()
    evil = craft([7.0, 7.1], name="<script>alert(1)</script>")
    page = comparison_page(compare_reports(report(evil), report(evil), ("<b>a</b>", "b")))
    assert "<script>alert(1)" not in page
    assert "<b>a</b>" not in page


def test_text_of_reports_breaks_no_table_of_the_markdown():
    odd = craft([7.0, 7.1], vehicle=VEHICLE | {"firmware": "a|b_<i>"})
    text = comparison_markdown(compare_reports(report(craft([7.0, 7.1])), report(odd), ("a", "b")))
    assert "| firmware (craft) | – | a\\|b\\_&lt;i&gt; |" in text
