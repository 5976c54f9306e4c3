"""HTML pages that open offline: everything is inlined, and everything from a log escaped."""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from importlib.resources import files

import jinja2
from markupsafe import Markup, escape

from core.quantity import complex_numbers, number
from reports.figures.figure import Figure
from reports.views.formula import transfer_function
from reports.views.log_words import sentence
from reports.views.models import PLACES, functions_intro, orders
from reports.views.summary import TRUST_WORDS


def failed_page(error: Exception) -> str:
    """Return the page shown instead of one that could not be drawn."""
    return (
        '<!DOCTYPE html><html lang="en"><head><meta charset="utf-8"><title>rotorid</title></head><body>'
        f"<p>This page could not be drawn ({escape(type(error).__name__)}: {escape(str(error))}). "
        "This is a bug in rotorid; please report it. All numbers are in report.json, models.json and rmse.csv.</p>"
        "</body></html>\n"
    )


def plotly_script() -> bytes:
    """Return Plotly's script, for a file that several pages share."""
    return (files("plotly") / "package_data" / "plotly.min.js").read_bytes()


def render(template: str, figures: Sequence[Figure], script_file: str = "", **variables: object) -> str:
    """Render a template of `templates/` with its figures and variables; an undefined variable is an error.

    Plotly is loaded from `script_file`, which pages may share, or inlined if that is "".
    """
    return (
        _environment()
        .get_template(template)
        .render(
            figures=figures,
            rotorid=version("rotorid"),
            figures_json=script_json([figure.packed() for figure in figures]),
            plotly=_packed_plotly() if figures and not script_file else "",
            script_file=script_file,
            style=Markup(_text("style.css")),
            script=Markup(_text("plots.js")) if figures else Markup(),
            **variables,
        )
    )


def script_json(value: object) -> Markup:
    """Return JSON that is safe inside a script element."""
    text = json.dumps(value, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
    for unsafe in "<>&\u2028\u2029":
        text = text.replace(unsafe, f"\\u{ord(unsafe):04x}")
    return Markup(text)


def render_text(template: str, **variables: object) -> str:
    """Render a template that is not a page."""
    return _environment().get_template(template).render(**variables).lstrip()


def _xml(text: str) -> str:
    """Drop characters that XML 1.0 does not allow."""
    return "".join(c for c in text if c in "\t\n" or (ord(c) >= 0x20 and ord(c) not in (0xFFFE, 0xFFFF)))


@cache
def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("reports", "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        bytecode_cache=_bytecode_cache(),
    )
    environment.filters |= {"sentence": sentence, "xml": _xml}
    environment.globals |= {
        "trust_words": TRUST_WORDS,
        "number": number,
        "complex_numbers": complex_numbers,
        "formula": transfer_function,
        "functions_intro": functions_intro,
        "orders": orders,
        "places": PLACES,
    }
    return environment


class _CompiledTemplates(jinja2.FileSystemBytecodeCache):
    """Cache of compiled templates in the user's temporary folder; compiling takes longer than rendering a page."""

    def dump_bytecode(self, bucket: jinja2.bccache.Bucket) -> None:
        """Store a template, ignoring a full disk."""
        with suppress(OSError):
            super().dump_bytecode(bucket)


def _bytecode_cache() -> _CompiledTemplates | None:
    """Return the cache; None without a folder that only the user can write to."""
    try:
        return _CompiledTemplates()
    except (OSError, RuntimeError):
        return None


def _text(name: str) -> str:
    return (files("reports") / "templates" / name).read_text(encoding="utf-8")


@cache
def _packed_plotly() -> Markup:
    """Return Plotly's script as base64 of gzip: 2 MB instead of 5 in every page (level 9: 1 % less, twice the time)."""
    return Markup(base64.b64encode(gzip.compress(plotly_script(), compresslevel=5, mtime=0)).decode("ascii"))
