"""What `reports.write` leaves in a folder: one set of numbers in every form, and no way out for text of a log."""

import csv
import dataclasses
import io
import json
import math
import re
from html import unescape
from pathlib import Path

import jsonschema
import pandas as pd
import pytest
from scipy.io import loadmat

import reports
from core.quantity import column
from logparse import Finding, Severity
from pipeline.config import ConfigError
from pipeline.flight.identification import model_result
from pipeline.flight.summary import flight_report
from pipeline.names import folder_names
from pipeline.results.failure import Failure
from pipeline.results.fleet import LogFailure
from pipeline.results.model import RmseRow
from reports.files import folder as files
from reports.files.folder import rmse_table
from reports.report_json import read_report
from reports.views import summary
from tests.reports.builders import Page, drawn, schema_of, strict, validator_of
from tests.reports.conftest import composed
from tests.reports.made import made


@pytest.mark.parametrize("name", ["=1+1", "+1", "-1", "@SUM(A1)", "\t=1", "plain", "a=b"])
def test_names_are_no_formulas_of_a_spreadsheet(name):
    errors = {kind: {"x": -0.5} for kind in ("rmse_m", "fit_percent", "rmse_mean_m")}
    text = rmse_table([made(RmseRow, flight=name, craft=name, start_s=-1.5, duration_s=-1.5, **errors)])
    (read,) = csv.DictReader(io.StringIO(text))
    assert read["flight"] == read["craft"] == (name if name[0].isalpha() else f"'{name}")
    assert read["rmse_x_m"] == "-0.5"  # numbers stay numbers


HOSTILE = "</script><script>alert(1)</script><img src=x onerror=alert(1)>\u2028"


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def visible(cell: str) -> str:
    return cell.strip("\N{FIGURE SPACE}\N{PUNCTUATION SPACE} ")


def test_json_csv_and_html_carry_the_same_numbers(flight, tmp_path):
    page = reports.write(flight, tmp_path)
    assert page == tmp_path / "report.html"
    numbers = strict((tmp_path / "report.json").read_text("utf-8"))
    html = (tmp_path / "models.html").read_text("utf-8")
    assert len(numbers["rmse"]) == 2
    assert [(row["scope"], row["model"]) for row in numbers["rmse"]] == [("own", "motors")] * 2
    for row, line in zip(numbers["rmse"], rows_of(tmp_path / "rmse.csv"), strict=True):
        assert line["flight"] == row["flight"] == "flight01"
        assert line["part"] == row["part"]
        for output, value in row["rmse_m"].items():
            assert float(line[f"rmse_{output}_m"]) == value
            assert visible(column([value])[0]) in html
    table = flight.models[0].validation.table.set_index(["trained", "output"])
    assert numbers["rmse"][0]["rmse_m"]["x"] == table.loc[(False, "x"), "rmse"]


def test_json_matlab_and_spreadsheets_hold_every_coefficient(flight, fleet, tmp_path):
    reports.write(flight, tmp_path)
    models = strict((tmp_path / "models.json").read_text("utf-8"))
    stored = models["flights"][0]["models"]["motors"]["transfer_functions"]["y"]["m2"]
    fitted = flight.models[0].model.transfer_functions["y"]["m2"]
    assert stored["num"] == fitted.num.tolist()
    assert stored["den"] == fitted.den.tolist()
    assert models["flights"][0]["thrust"] is None
    assert stored["covariance"] == fitted.covariance.tolist()
    assert "voltage" in models["flights"][0]["missing"]["thrust"]
    assert "LOG_BITMASK" in models["flights"][0]["missing"]["reference"]
    motors = loadmat(tmp_path / "models.mat", struct_as_record=False)["motors"][0, 0]
    assert motors.num[1, 1][0].tolist() == fitted.num.tolist()
    joint = loadmat(fleet / "models.mat", struct_as_record=False)["craft1"][0, 0]
    assert {"motors", "mixer"} <= set(joint._fieldnames)
    lines = [
        line
        for line in rows_of(tmp_path / "coefficients.csv")
        if (line["model"], line["output"], line["input"], line["part"]) == ("motors", "y", "m2", "den")
    ]
    assert [float(line["value"]) for line in lines] == pytest.approx(fitted.den.tolist(), rel=1e-8)
    assert lines[0]["std"] == ""


def test_page_needs_no_network(flight, tmp_path):
    html = reports.write(flight, tmp_path).read_text("utf-8")
    page = Page(html)
    assert not [value for _, attrs in page.elements for name, value in attrs.items() if name in ("src", "srcset")]
    assert not page.all("link")
    assert all("://" not in (attrs.get("href") or "") for _, attrs in page.elements)
    assert "default-src 'none'" in html
    assert len(html) < 3_000_000, "Plotly travels packed: a page must stay fit for mailing"


def hostile(flight):
    """Put an attacker's text wherever a log's text can end up."""
    vehicle = dataclasses.replace(flight.vehicle, firmware=HOSTILE, version=HOSTILE, frame_class=HOSTILE)
    return dataclasses.replace(
        flight,
        name=HOSTILE,
        log=dataclasses.replace(flight.log, file=f"{HOSTILE.replace('/', '_')}.bin"),
        vehicle=vehicle,
        modes=pd.DataFrame({"mode": [HOSTILE, "AUTO"]}, index=[10.0, 80.0]),
        findings=(Finding(HOSTILE, Severity.ERROR, HOSTILE, HOSTILE, {"text": HOSTILE}),),
        thrust=Failure("thrust", HOSTILE),
    )


def test_text_from_a_log_cannot_break_out(flight, tmp_path):
    evil = hostile(flight)
    own = Page(reports.write(flight, tmp_path / "own").read_text("utf-8"))
    pages = [reports.write(evil, tmp_path / "one"), composed(tmp_path / "fleet", [evil])]
    pages += (tmp_path / "fleet" / "flights").rglob("report.html")
    assert len(pages) == 3
    for path in pages:
        html = path.read_text("utf-8")
        page = Page(html)
        assert len(page.all("script")) <= len(own.all("script"))
        assert not page.all("img")
        assert not [attrs for _, attrs in page.elements if any(name.startswith("on") for name in attrs)]
        assert "alert(1)" in "".join(page.text), "hostile text must be shown, as text"
        # Plotly reads some HTML in labels, so text must be escaped once more for it.
        labels = [note["text"] for figure in drawn(html) for note in figure["layout"].get("annotations", [])]
        assert path == pages[1] or any("&lt;script&gt;" in label for label in labels)
        assert not any("<" in label for label in labels)
    summary = (tmp_path / "fleet" / "report.md").read_text("utf-8")
    assert "alert" in summary
    assert "<script" not in summary
    assert "<img" not in summary


def test_what_is_not_finite_becomes_null(flight, tmp_path):
    own = flight.models[0]
    table = own.validation.table.copy()
    table.loc[table["output"] == "x", ["rmse", "fit_percent"]] = [math.inf, math.nan]
    own = model_result(own.key, own.title, own.model, dataclasses.replace(own.validation, table=table))
    broken = dataclasses.replace(flight, models=(own,), timings={"read": math.nan})
    page = reports.write(broken, tmp_path)
    numbers = strict((tmp_path / "report.json").read_text("utf-8"))
    assert numbers["rmse"][0]["rmse_m"]["x"] is None
    assert rows_of(tmp_path / "rmse.csv")[0]["rmse_x_m"] == ""
    text = unescape("".join(Page(page.read_text("utf-8")).text)).lower()
    assert math.isnan(read_report(tmp_path).timings_s["read"])
    assert not re.search(r"\b(nan|inf)\b", text[: text.index("figures") if "figures" in text else None][:20_000])


def test_pages_of_flights_share_the_script_of_their_plots(fleet):
    """The page on all flights stays complete in itself; those of flights say what is missing when moved away."""
    whole = (fleet / "report.html").read_text("utf-8")
    assert 'id="plotly"' in whole
    path = fleet / "flights" / "flight01" / "report.html"
    text = path.read_text("utf-8")
    (script,) = [attrs["src"] for attrs in Page(text).all("script") if "src" in attrs]
    assert (path.parent / script).resolve() == (fleet / "plotly.min.js").resolve()
    assert (fleet / "plotly.min.js").stat().st_size > 1_000_000
    assert len(text) < 500_000
    assert "script-src 'unsafe-inline' 'self' file:;" in text
    assert "this page was moved away from it" in text
    assert "'self'" not in whole.partition("</head>")[0].partition("<style>")[0]


def test_a_flight_without_anything_says_why(flight, tmp_path):
    bare = dataclasses.replace(
        flight,
        flight=Failure("flight", "the log shows no flight"),
        trajectory=Failure("trajectory", "no GPS: set bit 2 of LOG_BITMASK"),
        experiments={},
        models=(),
        motors=None,
        modes=None,
        gps=None,
    )
    page = reports.write(bare, tmp_path).read_text("utf-8")
    assert "What could not be done" in page
    assert "set bit 2 of LOG_BITMASK" in page
    assert flight_report(bare).verdict.trust == "unknown"
    validator_of("flight").validate(json.loads((tmp_path / "report.json").read_text("utf-8")))
    assert rows_of(tmp_path / "coefficients.csv") == rows_of(tmp_path / "parameters.csv") == []
    assert [name for name in loadmat(tmp_path / "models.mat") if not name.startswith("__")] == []


@pytest.mark.parametrize(
    ("names", "folders"),
    [
        (["a", "A"], ["a", "A_2"]),
        (["../../etc/passwd"], ["etc_passwd"]),
        (["..", "."], ["flight", "flight_2"]),
        (["2016-11-09 16-33-24", "Flug über See"], ["log_2016-11-09_16-33-24", "Flug_über_See"]),
    ],
)
def test_folders_are_safe_and_unique(names, folders):
    assert list(folder_names(names).values()) == folders


def test_a_name_that_is_not_utf8_costs_nothing(flight, tmp_path):
    odd = dataclasses.replace(flight, log=dataclasses.replace(flight.log, file="bad\udcff\udcfename.bin"))
    composed(tmp_path, [odd])
    numbers = strict((tmp_path / "report.json").read_text("utf-8"))
    assert numbers["flights"][0]["log"]["file"] == r"bad\xff\xfename.bin"


def test_a_page_that_cannot_be_drawn_costs_only_itself(flight, other, tmp_path, monkeypatch):
    drawn = files.flight_page

    def failing(numbers, *arguments, **options):
        if numbers.name == "flight01":
            raise ZeroDivisionError("a <bug>")
        return drawn(numbers, *arguments, **options)

    monkeypatch.setattr(files, "flight_page", failing)
    page = composed(tmp_path, [flight, other]).read_text("utf-8")
    assert "notes.bin" in page
    assert "a &lt;bug&gt;" in (tmp_path / "flights" / "flight01" / "report.html").read_text("utf-8")
    assert "no voltage was logged" in (tmp_path / "flights" / "flight02" / "report.html").read_text("utf-8")
    assert (tmp_path / "report.json").is_file()


def test_what_was_passed_over_is_named_everywhere(flight, tmp_path):
    unused = tuple(LogFailure(f"{k}.txt", "no flight log") for k in range(7))
    copies = (LogFailure("again.bin", "a copy of flight01.BIN"),)
    page = composed(tmp_path, [flight], passed_over=unused, duplicates=copies).read_text("utf-8")
    line = "Passed over: 0.txt, 1.txt, 2.txt, 3.txt, 4.txt and 2 more (no flight log)."
    assert line in page
    numbers = strict((tmp_path / "report.json").read_text("utf-8"))
    assert numbers["passed_over"][6] == {"file": "6.txt", "reason": "no flight log"}
    assert summary.left_out(read_report(tmp_path)) == [
        line,
        "Copies, analysed once: again.bin (a copy of flight01.BIN).",
    ]
    assert unescape(page).count("6.txt") == 1, "each is named, where nobody must read it"


@pytest.mark.parametrize("name", ["report", "models"])
def test_schemas_are_schemas(name):
    jsonschema.Draft202012Validator.check_schema(schema_of(name))


def test_models_are_as_their_schema_says(flight, fleet, tmp_path):
    reports.write(flight, tmp_path)
    for folder in (fleet, fleet / "crafts" / "craft0", tmp_path):
        models = strict((folder / "models.json").read_text("utf-8"))
        validator_of("models").validate(models)
    broken = models | {"flights": [models["flights"][0] | {"models": {"motors": {"kind": "transfer-functions"}}}]}
    assert not validator_of("models").is_valid(broken)


def test_a_report_that_is_nested_too_deep_is_damaged(tmp_path):
    (tmp_path / "report.json").write_text("[" * 99_999)
    with pytest.raises(ConfigError, match=r"report\.json is damaged"):
        read_report(tmp_path)


def test_reports_are_as_their_schema_says(fleet):
    for path in ("report.json", "crafts/craft0/report.json", "flights/flight01/report.json"):
        numbers = json.loads((fleet / path).read_text("utf-8"))
        validator = validator_of(numbers["kind"])
        validator.validate(numbers)
        assert not validator.is_valid(numbers | {"undocumented": 1})
