"""Run the benchmarks of this folder, or those named, each in a process of its own, and print one table.

`python -m benchmarks [NAME ...] [--minutes M] [--write] [--check] [--data DIR] [--halves DIR]`

Without a name it runs `WHOLE`: speed and accuracy against peers and goals. ``--minutes`` bounds all together; what
does not end by then is named as not run. ``--write`` puts the table into docs/benchmarks.md, ``--check`` fails where a
ratio of `short` is less than half of the stored one (benchmarks/stored.json), ``--store`` stores those measured now.
Peers that are not installed are named as such; `make bench` installs them.
"""

import argparse
import importlib
import json
import pkgutil
import platform
import re
import subprocess
import sys
import time
from collections.abc import Iterable, Sequence
from importlib.metadata import PackageNotFoundError, version

from rich.console import Console
from rich.table import Table

import benchmarks
from benchmarks import real_logs
from benchmarks._measure import ROOT, Row, text

PEERS = ("pymavlink", "signalviewer-lite", "filterpy")

#: What `make bench` runs. The others judge accuracy on many flights, or the service, and take from minutes to an hour.
WHOLE = (
    "short",
    "logparse",
    "estimation",
    "sysid",
    "sysid_table_a1",
    "rigid_body",
    "flight",
)

PAGE, STORED = ROOT / "docs" / "benchmarks.md", ROOT / "benchmarks" / "stored.json"
BEGIN, END = "<!-- made by make bench -->\n", "<!-- end of what make bench made -->\n"
COLUMNS = ("benchmark", "what", "ours", "peer", "ratio", "goal", "met")

#: A ratio may fall to this part of the stored one: less is a fault, and not the load of the machine.
WORST = 0.5


def names() -> list[str]:
    """List the benchmark modules: every module of this package but this one."""
    return sorted(info.name for info in pkgutil.iter_modules(benchmarks.__path__) if not info.name.startswith("_"))


def versions(packages: Iterable[str]) -> str:
    """Report which version of each peer stands in this environment."""
    installed = []
    for package in packages:
        try:
            installed.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            installed.append(f"{package} not installed")
    return ", ".join(installed)


def measure(name: str, more: Sequence[str], seconds: float) -> list[Row]:
    """Run a benchmark in a process of its own; one row that says why where it does not end well in time."""
    command = [sys.executable, "-m", "benchmarks", name, "--rows", *more]
    try:
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=seconds)
    except subprocess.TimeoutExpired:
        return [("not run: out of time", "", "", "", "")]
    if done.returncode:
        reason = (done.stderr.strip() or "no word").splitlines()[-1]
        return [(f"failed: {reason}", "", "", "", "")]
    return [tuple(row) for row in json.loads(done.stdout.splitlines()[-1])]


def met(row: Row) -> str:
    """Return whether a goal is met: of the ratio where there is one and the goal is a least one, else of ours."""
    _, ours, peer, ratio, goal = row
    if "not installed" in peer:
        return ""  # what was not compared is neither met nor missed
    asked = re.fullmatch(r"(<|>)=? ?([\d.]+)(.*)", goal)
    number = re.match(
        r"[\d.]+(?:e[-+]?\d+)?", (ratio if asked and asked[1] == ">" and ratio not in ("", "-") else ours)
    )
    if asked is None or number is None:
        return ""
    reached = float(number[0]) <= float(asked[2]) if asked[1] == "<" else float(number[0]) >= float(asked[2])
    return "yes" if reached else "MISSED"


def page(rows: list[tuple[str, ...]], about: str) -> str:
    """Return the table as Markdown, with what was missed at its end."""
    lines = ["| " + " | ".join(cell.replace("|", "/") for cell in row) + " |" for row in (COLUMNS, *rows)]
    lines.insert(1, "|" + "---|" * len(COLUMNS))
    missed = sum(row[-1] == "MISSED" for row in rows)
    judged = missed + sum(row[-1] == "yes" for row in rows)
    head = (
        "# Benchmarks\n\nWhat rotorid's speed and accuracy are, beside peers and goals, written by `make bench`. "
        "Times are CPU times; peers do the same work in the same run.\n"
    )
    return "\n".join([head, f"{about}. Of {judged} goals {missed} are missed.", "", *lines, ""])


def write(table: str) -> None:
    """Put the table into the page, in the place of the one before."""
    there = PAGE.read_text() if PAGE.exists() else ""
    rest = there.partition(END)[2] if BEGIN in there else there
    PAGE.write_text(BEGIN + table + "\n" + END + rest)


def fallen(rows: Iterable[Row], stored: dict[str, float]) -> list[str]:
    """Return which ratios are less than `WORST` of the stored ones, or missing."""
    now = {row[0]: float(row[3]) for row in rows if row[3] not in ("", "-")}
    return [
        f"{what}: {now[what]:.2f}, stored {before:.2f}" if what in now else f"{what}: not measured, stored {before:.2f}"
        for what, before in stored.items()
        if now.get(what, 0.0) < WORST * before
    ]


def main(given: list[str]) -> int:
    """Run what the command line names; 1 where a ratio has fallen, 2 where there is no such benchmark."""
    if given[:1] == ["real_logs"]:  # against readings of other people's logs: no peer, no goal, a table of its own
        return real_logs.main(given[1:])
    parser = argparse.ArgumentParser(prog="python -m benchmarks")
    parser.add_argument("names", nargs="*")
    parser.add_argument("--minutes", type=float, default=1e4)
    parser.add_argument("--data")  # for real_flights, which reads the folder itself
    parser.add_argument("--halves")  # for honesty, likewise
    for flag in ("--write", "--check", "--store", "--rows"):
        parser.add_argument(flag, action="store_true")
    options = parser.parse_args(given)
    if options.rows:
        rows = importlib.import_module(f"benchmarks.{options.names[0]}").run()
        print(json.dumps([[text(cell) for cell in row] for row in rows]))
        return 0
    # A log file has no edge to wrap at: rows of a word a line are nobody's table.
    console = Console(width=None if sys.stdout.isatty() else 160)
    unknown = [name for name in options.names if name not in names()]
    if unknown:
        console.print(f"no such benchmark: {', '.join(unknown)}; there are {', '.join(names())}")
        return 2
    deadline = time.monotonic() + 60.0 * options.minutes
    folders = {"--data": options.data, "--halves": options.halves}
    more = [word for flag, folder in folders.items() if folder for word in (flag, folder)]
    table, every, begun = Table(*COLUMNS), [], time.monotonic()
    short: list[Row] = []
    for name in options.names or WHOLE:
        console.print(f"{time.monotonic() - begun:5.0f} s  {name}")
        measured = measure(name, more, max(deadline - time.monotonic(), 0.01))
        short += measured if name == "short" else []
        every += [(name, *row, met(row)) for row in measured]
    for row in every:
        table.add_row(*row)
    about = f"Python {platform.python_version()}, {platform.machine()}; {versions(PEERS)}"
    console.print(table)
    console.print(about)
    if options.write:
        write(page(every, about))
    if options.store:
        STORED.write_text(json.dumps({row[0]: float(row[3]) for row in short}, indent=1) + "\n")
    complaints = fallen(short, json.loads(STORED.read_text())) if options.check else []
    for complaint in complaints:
        console.print(f"slower than it was: {complaint}")
    return 1 if complaints else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
