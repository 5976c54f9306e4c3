"""Which software computes and shows results: equal software promises equal results."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from core.serialization import plain

#: Packages that numbers and plots come from; pages, which `reports` shows, are drawn of what these have written.
_ANALYSIS = ("core", "logparse", "estimation", "sysid", "pipeline", "reports.figures")

#: Libraries that the numbers come from.
_LIBRARIES = ("numpy", "scipy", "numba", "pandas", "pyarrow", "pymap3d", "pygeomag", "pymavlink", "filterpy")


@dataclass(frozen=True, slots=True, kw_only=True)
class Software:
    """What computes; what only shows results has no part in it, see `page_key`."""

    rotorid: str  #: Its version.
    sources: str  #: A fingerprint of them.
    libraries: Mapping[str, str | None]  #: Versions of those beneath it; None for one that is not installed.


@cache
def software() -> Software:
    """Return which software computes."""
    libraries = {name: _version(name) for name in _LIBRARIES}
    return Software(rotorid=version("rotorid"), sources=_fingerprint(_ANALYSIS), libraries=libraries)


@cache
def presentation() -> tuple[str, str | None]:
    """Return which software shows results: a fingerprint of code, templates and style sheets, and Plotly's version."""
    return _fingerprint(("reports",)), _version("plotly")


def installed() -> Mapping[str, Any]:
    """Return all software that has a part in products, in plain types: workers with other software must read it too."""
    return {**plain(software()), "presentation": list(presentation())}


def _fingerprint(packages: Iterable[str]) -> str:
    sources = hashlib.sha256()
    for package in packages:
        # Found and not imported: this must not wait for numerical packages.
        spec = find_spec(package)
        if spec is None or spec.origin is None:
            continue
        folder = Path(spec.origin).parent
        # What was compiled of them comes and goes.
        for file in sorted(path for path in folder.rglob("*") if path.is_file() and "__pycache__" not in path.parts):
            sources.update(f"{package}/{file.relative_to(folder).as_posix()}\0".encode())
            sources.update(file.read_bytes())
    return sources.hexdigest()


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None
