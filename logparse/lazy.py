"""Imports that wait until they are used: the one way in which packages here start quickly.

A module that is slow to load and that few paths need stands at the top of its importer all the same, as itself for type
checkers and as a stand-in when it runs::

    if TYPE_CHECKING:
        import fsspec
    else:
        fsspec = lazy("fsspec")

A package names what it exports, and where that is (`exports`). Commands of `rotorid.cli` import in their functions.
"""

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


class _Module:
    """Stands for a module, which is imported when something of it is asked for."""

    __slots__ = ("_name",)

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, attribute: str) -> Any:
        return getattr(import_module(self._name), attribute)


def lazy(name: str) -> Any:
    """Return a stand-in for the module of this name; one that is not installed is an ImportError at its first use."""
    return _Module(name)


def exports(package: str, homes: Mapping[str, str]) -> tuple[Callable[[str], object], Callable[[], list[str]]]:
    """Return a package's ``__getattr__`` and ``__dir__``, for names that are imported when they are first used.

    Parameters
    ----------
    package : str
        Its ``__name__``.
    homes : mapping of str to str
        The module of each name; a module that is exported as a whole is its own home (``"rotorid.fit"`` for ``fit``).
    """

    def find(name: str) -> object:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module = import_module(homes[name])
        found = module if homes[name].endswith(f".{name}") and not hasattr(module, name) else getattr(module, name)
        setattr(import_module(package), name, found)
        return found

    return find, lambda: sorted(homes)
