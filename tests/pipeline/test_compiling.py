"""The compiled loops that an analysis needs are known beforehand, and compiled side by side."""

import os
import subprocess
import sys
from pathlib import Path

SAMPLE = Path(__file__).parents[2] / "sample_logs" / "octa01_zurich_calm.bin"

#: Prints what was called of kernels, and with which arguments, that `KERNELS` and annotations do not foresee.
CALLED = f"""
import sys
import pipeline
from logparse.numerics.compiled import argument_types
from pipeline.execution.compiling import KERNELS

pipeline.analyze({str(SAMPLE)!r})
foreseen = {{(kernel.py_func, argument_types(kernel)) for kernel in KERNELS}}
kernels = [
    value
    for name, module in list(sys.modules.items())
    if name.split(".")[0] in ("logparse", "estimation", "sysid", "pipeline", "simulation")
    for value in vars(module).values()
    if type(value).__name__ == "CPUDispatcher"
]
called = {{(kernel.py_func, types) for kernel in kernels for types in kernel.signatures}}
print(len(called & foreseen), *sorted(function.__qualname__ for function, _ in called - foreseen))
"""

MODULE = """
from logparse.numerics.compiled import njit
from logparse.numerics.kernel_types import Vector

@njit(cache=True)
def total(values: Vector, start: float) -> float:
    for value in values:
        start += value
    return start

@njit(cache=True)
def most(values: Vector) -> float:
    return max(values)

@njit(cache=True)
def broken(values: Vector) -> float:
    return values.no_such_thing
"""

COMPILE = """
import resource, sys
import numpy as np
from loops import broken, most, total
from logparse.numerics.compiled import is_kept
from pipeline.execution.compiling import compile_missing

heard = []
compile_missing(lambda stage, fraction: heard.append(stage), (total, broken, most))
print(len(heard), is_kept(total), is_kept(most), total(np.ones(3), 1.0), most(np.ones(3)))
"""


def _run(script: str, **environment: str) -> list[str]:
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env={**os.environ, **environment})
    return done.stdout.split()


def test_an_analysis_calls_no_loop_that_is_not_foreseen() -> None:
    """Each would be compiled at its first call, after all the others, on a machine that has none yet."""
    count, *unforeseen = _run(CALLED)
    assert int(count) >= 20
    # What only other loops call is compiled with them.
    assert set(unforeseen) <= {"find_chained"}


def test_loops_that_a_machine_has_not_compiled_are_compiled_once(tmp_path: Path) -> None:
    """What cannot be compiled is passed over: its call will say why."""
    (tmp_path / "loops.py").write_text(MODULE)
    place = {"PYTHONPATH": f"{tmp_path}:{Path(__file__).parents[2]}", "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    assert _run(COMPILE, **place) == ["1", "True", "True", "4.0", "1.0"]
    files = sorted(tmp_path.rglob("*.nbc"))
    assert len(files) == 2
    assert _run(COMPILE.replace("broken, most)", "most)"), **place) == ["0", "True", "True", "4.0", "1.0"]
    assert sorted(tmp_path.rglob("*.nbc")) == files
