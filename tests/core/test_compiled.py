"""Machine code on the disk: used at once, and never that of another version."""

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from subprocess import PIPE

import pytest

from tests.paths import ROOT

SOURCE = """
import sys
import numpy as np
from core.compiled import inner, njit

@inner()
def _twice(x):
    return {factor} * x

@njit(cache=True)
def total(values):
    # An array, so that numba's own code for it is kept along with this.
    result = np.zeros(1, values.dtype)
    for k in range(len(values)):
        result[0] += _twice(values[k])
    return result[0]

print(total(np.ones(3, dtype=sys.argv[1])), "numba.np.arrayobj" in sys.modules)
"""


#: Runs scripts, each in a copy of itself that has loaded numba and called nothing: a start takes half a second.
STARTER = """
import json, os, runpy, sys, traceback
import numpy
import core.compiled
from numba.core import config

for line in sys.stdin:
    script, dtype, environment = json.loads(line)
    if not os.fork():
        try:
            os.environ.update(environment)
            config.reload_config()
            sys.argv = [script, dtype]
            runpy.run_path(script, run_name="__main__")
            sys.stdout.flush()
            os._exit(0)
        except BaseException:
            traceback.print_exc()
        os._exit(1)
    if os.wait()[1]:
        print("failed", False, flush=True)
"""

Run = Callable[..., tuple[str, bool]]


@pytest.fixture(scope="module")
def run() -> Iterator[Run]:
    """Return a function that calls the kernel in a new process: its result, and whether numba got ready to compile."""
    environment = {key: value for key, value in os.environ.items() if key != "NUMBA_CACHE_DIR"}
    environment["PYTHONPATH"] = str(ROOT)
    command = [sys.executable, "-c", STARTER]
    with subprocess.Popen(command, stdin=PIPE, stdout=PIPE, text=True, bufsize=1, env=environment) as starter:
        assert starter.stdin
        assert starter.stdout
        asked, answers = starter.stdin, starter.stdout

        def ran(folder: Path, dtype: str, factor: int = 2, *, keep: bool = True) -> tuple[str, bool]:
            script = folder / "kernel.py"
            source = SOURCE.format(factor=factor)
            if not script.exists() or script.read_text() != source:
                script.write_text(source)
            # A home that is no folder: the last place that numba would keep code in.
            place = {"HOME": os.devnull}
            if keep:
                place["NUMBA_CACHE_DIR"] = str(folder / "cache")
            else:
                (folder / "__pycache__").write_text("no folder")
            print(json.dumps([str(script), dtype, place]), file=asked)
            result, ready = answers.readline().split()
            return result, ready == "True"

        yield ran
        asked.close()


def test_code_on_the_disk_is_used_as_long_as_it_is_whole_and_its_source_what_it_was(tmp_path: Path, run: Run) -> None:
    """Getting ready to compile takes as long as the rest of a start; a version that is not kept is compiled.

    Two processes may compile what neither found: whichever writes the index last, each name leads to its own code.
    Files of an older source go: under numbered names an index that was renewed before them would find them again.
    """
    assert run(tmp_path, "float64") == ("6.0", True)
    assert run(tmp_path, "float64") == ("6.0", False)
    (index,) = tmp_path.rglob("*.nbi")
    first = index.read_bytes()
    index.unlink()
    assert run(tmp_path, "int64") == ("6", True)
    assert len(list(tmp_path.rglob("*.nbc"))) == 2
    index.write_bytes(first)  # the slower process ends last, and knows its own version only
    assert run(tmp_path, "float64") == ("6.0", False)
    assert run(tmp_path, "int64") == ("6", True)
    assert run(tmp_path, "float64") == ("6.0", False)
    assert run(tmp_path, "int64") == ("6", False)
    older = {path.name for path in tmp_path.rglob("*.nbc")}
    assert run(tmp_path, "float64", factor=3) == ("9.0", True)
    (newer,) = tmp_path.rglob("*.nbc")
    assert newer.name not in older
    # A disk that was full, or a machine that was switched off, leaves such files.
    for damage in (b"", b"\x80\x05garbage"):
        newer.write_bytes(damage)
        assert run(tmp_path, "float64", factor=3) == ("9.0", True)
    assert run(tmp_path, "float64", factor=3) == ("9.0", False)


def test_code_is_compiled_where_no_folder_can_be_written(tmp_path: Path, run: Run) -> None:
    """As in a container that may only read: every command ended in "a bug in rotorid"."""
    assert run(tmp_path, "float64", keep=False) == ("6.0", True)
