"""One log from the command to the page: what is imported and compiled, what is printed and left."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.paths import SAMPLES
from tests.reports.builders import validator_of

SAMPLE = SAMPLES / "octa01_zurich_calm.bin"

#: Slow to import, and not needed to read a log and fit models to it before one of them is asked for.
LATE = (
    "jinja2",
    "plotly",
    "pyarrow.parquet",
    "pydantic",
    "rich",
    "scipy.fft",
    "scipy.integrate",
    "scipy.interpolate",
    "scipy.io",
    "scipy.optimize",
    "scipy.signal",
    "scipy.sparse",
    "scipy.spatial",
    "scipy.stats",
    "sqlalchemy",
    "sysid.rigid_body.six_dof",
    "logparse.foreign.motion",
)


#: Runs a command and writes down what was imported, how many kernels were called with arguments that `KERNELS` or
#: annotations foresee, and which with others.
TRACED = """
import json, os, sys

# On one processor no copy of the process calls what is not seen here.
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
written = sys.argv.pop(1)
from rotorid.cli.main import main
try:
    main()
finally:
    modules = list(sys.modules)
    from core.compiled import argument_types
    from pipeline.execution.compiling import KERNELS

    foreseen = {(kernel.py_func, argument_types(kernel)) for kernel in KERNELS}
    kernels = [
        value
        for name, module in list(sys.modules.items())
        if name.split(".")[0] in ("core", "logparse", "estimation", "sysid", "pipeline", "simulation")
        for value in vars(module).values()
        if type(value).__name__ == "CPUDispatcher"
    ]
    used = {(kernel.py_func, types) for kernel in kernels for types in kernel.signatures}
    unforeseen = sorted(function.__qualname__ for function, _ in used - foreseen)
    with open(written, "w") as file:
        json.dump([modules, len(used & foreseen), unforeseen], file)
"""


class Analysed(NamedTuple):
    """What an analysis by the command line printed, left behind, imported and compiled."""

    run: subprocess.CompletedProcess
    out: Path
    modules: set[str]
    foreseen: int
    unforeseen: set[str]


@pytest.fixture(scope="module")
def analysed(tmp_path_factory):
    """Analyse the smallest sample in a process of its own, as the README shows it."""
    folder = tmp_path_factory.mktemp("analysed")
    out, trace = folder / "out", folder / "trace.json"
    words = [trace, "analyze", SAMPLE, "--out", out, "--mass", "4.3", "--time-limit", "3000", "--json"]
    command = [sys.executable, "-c", TRACED, *map(str, words)]
    environment = os.environ | {"COLUMNS": "100", "NO_COLOR": "1"}
    run = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert run.returncode == 0, run.stderr
    modules, foreseen, unforeseen = json.loads(trace.read_text())
    return Analysed(run, out, set(modules), foreseen, set(unforeseen))


def test_one_log_from_file_to_report(analysed):
    """Stdout holds JSON and nothing else."""
    numbers = json.loads(analysed.run.stdout)
    assert numbers == json.loads((analysed.out / "report.json").read_text("utf-8"))
    for stage in ("reading", "trajectory", "transfer functions", "report"):
        assert stage in analysed.run.stderr
    assert numbers["missing"] == {}
    keys = [model["key"] for model in numbers["models"]]
    assert keys == ["motors", "mixer", "reference", "rigid_body"]
    judged = [model for model in numbers["models"] if model["model"] is not None]
    assert len(judged) > 1
    assert [row["part"] for row in numbers["rmse"]] == ["held-out", "training"] * len(judged)
    truth = json.loads((SAMPLES / "octa01_zurich_calm.json").read_text("utf-8"))
    airborne = truth["time_s"]["airborne"]
    assert numbers["flight"]["start_s"] == pytest.approx(airborne[0], abs=2.0)
    assert numbers["flight"]["stop_s"] == pytest.approx(airborne[1], abs=2.0)
    motors = judged[0]["model"]
    assert len(motors["transfer_functions"]) == 3
    assert all(len(row) == 8 for row in motors["transfer_functions"].values())
    assert numbers["thrust"]["common"]["newton"] > 0.0
    files = {"report.html", "models.html", "report.json", "models.json", "models.mat", "coefficients.csv", "rmse.csv"}
    files |= {"parameters.csv", "track.geojson", "track.kml", "track.gpx", "entry.json"}
    assert {path.name for path in analysed.out.iterdir()} == files
    validator_of("flight").validate(numbers)
    validator_of("models").validate(json.loads((analysed.out / "models.json").read_text("utf-8")))


def imported(script: str) -> set[str]:
    """Return the modules that a script has imported in a process of its own when it ends."""
    ending = "\nimport sys; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", script + ending], capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines()[-1].split())


def test_an_analysis_begins_without_what_later_stages_need() -> None:
    modules = imported("import pipeline.flight.analysis, pipeline.fleet.analysis")
    assert not modules & set(LATE)
    assert len(modules) < 1600


def test_an_ordinary_analysis_never_needs_all_of_scipy(analysed):
    """Signal, statistics and splines together take longer to import than a flight's models to fit."""
    assert "scipy.optimize" in analysed.modules
    unwanted = {"scipy.signal", "scipy.stats", "scipy.integrate", "scipy.interpolate", "scipy.ndimage"}
    assert not analysed.modules & unwanted


def test_an_analysis_calls_no_loop_that_is_not_foreseen(analysed):
    """Each would be compiled at its first call, after all the others, on a machine that has none yet."""
    assert analysed.foreseen > 15  # that they are seen at all: how many there are, others decide
    # What only other loops call is compiled with them.
    assert analysed.unforeseen <= {"find_chained"}


def test_a_log_is_looked_at_without_scipy_and_the_results_of_an_analysis() -> None:
    """Half of what `rotorid inspect` took was importing scipy for one constant."""
    shown = "from logparse import inspection, read_log\nfrom reports.terminal import inspection"
    modules = imported(f"{shown}\nread_log({str(SAMPLE)!r}).messages['ATT']")
    # The account of a flight is on show; what an analysis finds is not.
    others = ("pipeline.fleet", "pipeline.flight.analysis", "pipeline.results.flight", "sysid", "estimation")
    assert not [name for name in modules if name.startswith(others)]
    # Scipy itself is a list of its packages.
    assert {name for name in modules if name.startswith("scipy.") and not name.startswith("scipy._")} <= {
        "scipy.version"
    }


def test_the_first_line_of_progress_waits_for_no_numerical_package(tmp_path: Path) -> None:
    script = f"""
import sys
from pipeline.execution import progress
def first(self, stage, fraction):
    print(*sys.modules)
    raise SystemExit
progress._Lines.__call__ = first
sys.argv = ["rotorid", "analyze", {str(SAMPLE)!r}, "--out", {str(tmp_path)!r}, "--mass", "1.6"]
from rotorid.cli.main import main
main()
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    modules = set(done.stdout.splitlines()[0].split())
    assert "pipeline.config" in modules
    late = ("numpy", "pandas", "scipy", "numba", "pyarrow", "psutil", "multiprocessing", "fsspec", "pydantic")
    assert not modules & set(late)
    assert len(modules) < 600
