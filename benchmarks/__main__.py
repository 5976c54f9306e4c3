"""Run every benchmark module of this folder, or those named, and print one table.

`python -m benchmarks [NAME ...] [--data DIR]`.
Peers that are not installed are named as such; `make bench` installs them.
"""

import importlib
import pkgutil
import platform
import sys
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, version

from rich.console import Console
from rich.table import Table

import benchmarks

PEERS = ("pymavlink", "signalviewer-lite", "filterpy", "gtsam", "smsfusion", "pysib", "aeroid")


def names() -> list[str]:
    """List the benchmark modules: every module of this package but this one."""
    return sorted(info.name for info in pkgutil.iter_modules(benchmarks.__path__) if not info.name.startswith("_"))


def versions(packages: Iterable[str]) -> str:
    """Report which version of each peer stands in this environment."""
    found = []
    for package in packages:
        try:
            found.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            found.append(f"{package} not installed")
    return ", ".join(found)


def main(chosen: list[str]) -> int:
    console = Console()
    if "--data" in chosen:  # for real_flights, which reads the folder itself
        at = chosen.index("--data")
        chosen = chosen[:at] + chosen[at + 2 :]
    known = names()
    unknown = [name for name in chosen if name not in known]
    if unknown:
        console.print(f"no such benchmark: {', '.join(unknown)}; there are {', '.join(known)}")
        return 2
    table = Table("benchmark", "what", "ours", "peer", "ratio", "target")
    for name in chosen or known:
        console.print(f"running {name} ...")
        for row in importlib.import_module(f"benchmarks.{name}").run():
            table.add_row(name, *(f"{cell:.3g}" if isinstance(cell, float) else str(cell) for cell in row))
    console.print(table)
    console.print(f"Python {platform.python_version()}, {platform.machine()}; {versions(PEERS)}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
