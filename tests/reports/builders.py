"""What is read out of pages and their schema to be compared."""

import base64
import gzip
import json
import re
from collections.abc import Iterable
from functools import cache
from html.parser import HTMLParser

import jsonschema
import plotly.graph_objects as go

from pipeline.flight.summary import flight_report
from pipeline.results.flight import FlightResult
from reports.figures.figure import Figure
from reports.figures.flight import draw_flight
from reports.pages.flight import flight_page
from reports.report_json import schema

#: What each kind of file holds; of several that fail, an error would not name the one that matters.
KINDS = {"flight": "FlightReport", "craft": "CraftReport", "fleet": "FleetReport", "tables": "TablesReport"}
schema_of = cache(schema)


@cache
def validator_of(kind: str) -> jsonschema.Draft202012Validator:
    """Return the check of a kind of report, or of models. That its schema is one is tested once: it takes seconds."""
    if kind not in KINDS:
        return jsonschema.Draft202012Validator(schema_of(kind))
    whole = schema_of("report")
    one = {name: value for name, value in whole.items() if name != "oneOf"} | {"$ref": f"#/$defs/{KINDS[kind]}"}
    return jsonschema.Draft202012Validator(one)


class Page(HTMLParser):
    """What a browser makes of a page: elements, scripts, visible text."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.text: list[str] = []
        self.feed(html)

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    def handle_data(self, data):
        self.text.append(data)

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.elements if name == tag]


def page_of(result: FlightResult) -> str:
    """Return the page of a flight."""
    numbers = flight_report(result)
    return flight_page(numbers, draw_flight(result, numbers))


def strict(text: str) -> object:
    """Read JSON as the standard has it, without NaN and Infinity."""

    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is not JSON")

    return json.loads(text, parse_constant=refuse)


def unpack(text: str) -> dict:
    """Read what travels of a figure as the page's script does, but for differences."""
    return json.loads(gzip.decompress(base64.b64decode(text)))


def drawn(page: str) -> list[dict]:
    """Read the figures of a page as its script does."""
    travelling = re.search(r'<script type="application/json" id="figures">(.*?)</script>', page, re.DOTALL)
    assert travelling
    return [figure | unpack(figure["packed"]) for figure in strict(travelling.group(1))]


def accepted(figures: Iterable[Figure]) -> list[str]:
    """Have Plotly make figures, which raises on attributes that it does not know; return their ids."""
    names = []
    for figure in figures:
        go.Figure(data=themed(figure.data), layout=themed(figure.layout))
        assert figure.caption
        names.append(figure.id)
    return names


def themed(value):
    """Replace names of theme colours, which the page resolves, by a colour that Plotly knows."""
    if isinstance(value, dict):
        return {key: themed(item) for key, item in value.items()}
    if isinstance(value, list):
        return [themed(item) for item in value]
    return "#000" if isinstance(value, str) and value.startswith("@") else value
