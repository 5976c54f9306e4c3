"""What is imported and compiled when: a command's first second is imports, and every package has its moment."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.paths import SAMPLES

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


#: Analyses a log; prints what was imported, then the kernels that were called with arguments that neither `KERNELS` nor
#: annotations foresee, behind the number of the others.
ANALYSIS = f"""
import sys
import pipeline

pipeline.analyze({str(SAMPLE)!r})
print(*sys.modules)
from core.compiled import argument_types
from pipeline.execution.compiling import KERNELS

foreseen = {{(kernel.py_func, argument_types(kernel)) for kernel in KERNELS}}
kernels = [
    value
    for name, module in list(sys.modules.items())
    if name.split(".")[0] in ("core", "logparse", "estimation", "sysid", "pipeline", "simulation")
    for value in vars(module).values()
    if type(value).__name__ == "CPUDispatcher"
]
called = {{(kernel.py_func, types) for kernel in kernels for types in kernel.signatures}}
print(len(called & foreseen), *sorted(function.__qualname__ for function, _ in called - foreseen))
"""


@pytest.fixture(scope="module")
def analysed() -> list[list[str]]:
    """Return the words of both lines that `ANALYSIS` prints last, in a process of its own."""
    done = subprocess.run([sys.executable, "-c", ANALYSIS], capture_output=True, text=True, check=True)
    return [line.split() for line in done.stdout.splitlines()[-2:]]


def imported(script: str) -> set[str]:
    """Return the modules that a script has imported in a process of its own when it ends."""
    ending = "\nimport sys; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", script + ending], capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines()[-1].split())


def test_an_analysis_begins_without_what_later_stages_need() -> None:
    modules = imported("import pipeline.flight.analysis, pipeline.fleet.analysis")
    assert not modules & set(LATE)
    assert len(modules) < 1600


def test_an_ordinary_analysis_never_needs_all_of_scipy(analysed: list[list[str]]) -> None:
    """Signal, statistics and splines together take longer to import than a flight's models to fit."""
    modules = set(analysed[0])
    assert "scipy.optimize" in modules
    assert not modules & {"scipy.signal", "scipy.stats", "scipy.integrate", "scipy.interpolate", "scipy.ndimage"}


def test_an_analysis_calls_no_loop_that_is_not_foreseen(analysed: list[list[str]]) -> None:
    """Each would be compiled at its first call, after all the others, on a machine that has none yet."""
    count, *unforeseen = analysed[1]
    assert int(count) >= 20
    # What only other loops call is compiled with them.
    assert set(unforeseen) <= {"find_chained"}


def test_a_log_is_looked_at_without_scipy() -> None:
    """Half of what `rotorid inspect` took was importing scipy for one constant."""
    modules = imported(f"from logparse import inspection, read_log\nread_log({str(SAMPLE)!r}).messages['ATT']")
    assert "logparse.inspection" in modules
    # Scipy itself is a list of its packages.
    assert {name for name in modules if name.startswith("scipy.") and not name.startswith("scipy._")} <= {
        "scipy.version"
    }


def test_a_log_is_shown_without_the_results_of_an_analysis() -> None:
    modules = imported("from reports.terminal import inspection")
    # The account of a flight is on show; what an analysis finds is not.
    others = ("pipeline.fleet", "pipeline.flight.analysis", "pipeline.results.flight", "sysid", "estimation")
    assert not [name for name in modules if name.startswith(others)]


@pytest.mark.parametrize("options", [[], ["--mass", "1.6"]])
def test_the_first_line_of_progress_waits_for_no_numerical_package(options: list[str], tmp_path: Path) -> None:
    script = f"""
import sys
from pipeline.execution import progress
def first(self, stage, fraction):
    print(*sys.modules)
    raise SystemExit
progress._Lines.__call__ = first
sys.argv = ["rotorid", "analyze", {str(SAMPLE)!r}, "--out", {str(tmp_path)!r}, *{options!r}]
from rotorid.cli.main import main
main()
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    modules = set(done.stdout.splitlines()[0].split())
    assert "pipeline.config" in modules
    assert not modules & {
        "numpy",
        "pandas",
        "scipy",
        "numba",
        "pyarrow",
        "psutil",
        "multiprocessing",
        "fsspec",
        "pydantic",
    }
    assert len(modules) < 600
