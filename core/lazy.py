"""Imports deferred until first use, so that commands start quickly.

A module that is slow to load and seldom needed is imported at the top all the same: as itself for type checkers, and at
run time as a stand-in::

    if TYPE_CHECKING:
        import fsspec
    else:
        fsspec = lazy("fsspec")

A package exports its names in the same way (`exports`). Commands of `rotorid.cli` import in their functions.
"""

import ast
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any


class _Module:
    """Stand-in that imports its module when an attribute is first read."""

    __slots__ = ("_name",)

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, attribute: str) -> Any:
        return getattr(import_module(self._name), attribute)


def lazy(name: str) -> Any:
    """Return a stand-in for a module; if it is not installed, ImportError comes at first use."""
    return _Module(name)


def exports(package: str, source: str) -> tuple[Callable[[str], object], Callable[[], list[str]]]:
    """Return a package's ``__getattr__`` and ``__dir__``, for names that are imported at first use.

    Parameters
    ----------
    package : str
        Name of the package.
    source : str
        Path of its ``__init__.py``, whose block ``if TYPE_CHECKING:`` imports the exported names.
    """
    homes = {
        alias.asname or alias.name: (statement.module or package, alias.name)
        for block in ast.parse(Path(source).read_bytes()).body
        if isinstance(block, ast.If) and ast.unparse(block.test) == "TYPE_CHECKING"
        for statement in block.body
        if isinstance(statement, ast.ImportFrom)
        for alias in statement.names
    }

    def find(name: str) -> object:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        home, original = homes[name]
        module = import_module(home)
        is_attribute = home != package and hasattr(module, original)  # else a submodule
        exported = getattr(module, original) if is_attribute else import_module(f"{home}.{original}")
        setattr(import_module(package), name, exported)
        return exported

    return find, lambda: sorted(homes)
