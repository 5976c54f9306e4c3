"""Results as pages that open offline: everything inside, everything from a log escaped."""

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
    """Stand in for a page that could not be drawn, and say where its numbers are."""
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
    """Fill a template of `templates/` in with all figures that it shows and its variables, each of which it must find.

    Plotly is in `script_file`, for pages that share one copy, or inside where that is "".
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
    """Write JSON that may stand inside a script element whatever text it holds."""
    text = json.dumps(value, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
    for unsafe in "<>&\u2028\u2029":
        text = text.replace(unsafe, f"\\u{ord(unsafe):04x}")
    return Markup(text)


def filled(template: str, **variables: object) -> str:
    """Fill a template in that is no page."""
    return _environment().get_template(template).render(**variables).lstrip()


def _xml(text: str) -> str:
    """Drop what XML 1.0 cannot hold."""
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
    """Compiled templates in a folder of the user's own among temporary files: compiling takes longer than a page."""

    def dump_bytecode(self, bucket: jinja2.bccache.Bucket) -> None:
        """Keep a template; a full disk is no reason to lose the page."""
        with suppress(OSError):
            super().dump_bytecode(bucket)


def _bytecode_cache() -> _CompiledTemplates | None:
    """Return the cache; None where there is no folder that only the user can write to."""
    try:
        return _CompiledTemplates()
    except (OSError, RuntimeError):
        return None


def _text(name: str) -> str:
    return (files("reports") / "templates" / name).read_text(encoding="utf-8")


@cache
def _packed_plotly() -> Markup:
    """Pack Plotly's script as base64 of gzip: 2 MB instead of 5 in every page (level 9: 1 % less in twice the time)."""
    return Markup(base64.b64encode(gzip.compress(plotly_script(), compresslevel=5, mtime=0)).decode("ascii"))
