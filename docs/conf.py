"""Sphinx: the pages of this folder and the API reference from docstrings, as one site (`make docs`)."""

import re
from importlib.metadata import version as installed
from typing import Any

project = "rotorid"
author = "the rotorid authors"
release = version = installed("rotorid")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
html_theme = "furo"
html_title = f"rotorid {version}"
html_copy_source = False
html_show_copyright = False
highlight_language = "none"
# A page may also be reached by a link alone.
suppress_warnings = ["toc.not_included"]

myst_heading_anchors = 3

# numpydoc sections. Fields are described beside them (`#:`); one that needs no word stands with its name alone.
napoleon_google_docstring = False
napoleon_use_param = False
napoleon_use_rtype = False
napoleon_custom_sections = [("Attributes", "params_style")]

autodoc_default_options = {"members": True, "undoc-members": True}
autodoc_member_order = "bysource"
autodoc_typehints = "none"
autodoc_preserve_defaults = True


def escape_units(_app: Any, _what: str, _name: str, _of: Any, _options: Any, lines: list[str]) -> None:
    """Keep a lone unit, such as ``V.``, from being read as the head of a numbered list."""
    lines[:] = [re.sub(r"^(\s*)([A-Za-z])\.(?=\s|$)", r"\1\2\\.", line) for line in lines]


def keep_first_line(_app: Any, what: str, _name: str, _of: Any, _options: Any, lines: list[str]) -> None:
    """Keep what stands before a colon in a field's description from being read as its type."""
    if what in ("attribute", "property"):
        lines.insert(0, "\\ ")


def hide_object(_app: Any, _name: str, _of: Any, _options: Any, bases: list[Any]) -> None:
    """Report nothing of the base that every class has."""
    bases[:] = [base for base in bases if base is not object]


def setup(app: Any) -> None:
    """Connect the above, before docstrings are read."""
    app.connect("autodoc-process-docstring", escape_units, priority=400)
    app.connect("autodoc-process-docstring", keep_first_line, priority=400)
    app.connect("autodoc-process-bases", hide_object)
