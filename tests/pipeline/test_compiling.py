"""Compiled loops that a machine lacks are compiled once, side by side; which those are: tests/rotorid/test_start."""

import os
import subprocess
import sys
from pathlib import Path

MODULE = """
from core.compiled import njit
from core.kernel_types import Vector

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
from core.compiled import is_kept
from pipeline.execution.compiling import compile_missing

heard = []
compile_missing(lambda stage, fraction: heard.append(stage), (total, broken, most))
print(len(heard), is_kept(total), is_kept(most), total(np.ones(3), 1.0), most(np.ones(3)))
"""


def _run(script: str, **environment: str) -> list[str]:
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env={**os.environ, **environment})
    return done.stdout.split()


def test_loops_that_a_machine_has_not_compiled_are_compiled_once(tmp_path: Path) -> None:
    """What cannot be compiled is passed over: its call will say why."""
    (tmp_path / "loops.py").write_text(MODULE)
    place = {"PYTHONPATH": f"{tmp_path}:{Path(__file__).parents[2]}", "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    assert _run(COMPILE, **place) == ["1", "True", "True", "4.0", "1.0"]
    files = sorted(tmp_path.rglob("*.nbc"))
    assert len(files) == 2
    assert _run(COMPILE.replace("broken, most)", "most)"), **place) == ["0", "True", "True", "4.0", "1.0"]
    assert sorted(tmp_path.rglob("*.nbc")) == files
