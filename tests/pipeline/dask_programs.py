"""A Dask scheduler and its workers as programs of their own."""

import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import pytest

from tests.api.programs import free_port
from tests.paths import ROOT


class Programs:
    """A scheduler and its workers.

    Parameters
    ----------
    folder : Path
        For their temporary files and what they print.
    """

    def __init__(self, folder: Path) -> None:
        pytest.importorskip("distributed")
        self._port = free_port()
        self.address = f"tcp://127.0.0.1:{self._port}"
        self._folder = folder
        folder.mkdir()
        # Calls may start processes of their own, which a daemon may not.
        self._environment = os.environ | {"DASK_DISTRIBUTED__WORKER__DAEMON": "False"}
        self.programs: list[subprocess.Popen[bytes]] = []

    def start_scheduler(self) -> subprocess.Popen[bytes]:
        return self._start("scheduler", "--host", "127.0.0.1", "--port", str(self._port), "--no-dashboard")

    def start_worker(self, *options: str, path: Sequence[Path] = ()) -> subprocess.Popen[bytes]:
        """Start a worker, with folders of modules to be found before the project."""
        place = ("--nthreads", "1", "--no-dashboard", "--local-directory", str(self._folder))
        return self._start("worker", self.address, *place, *options, path=path)

    def _start(self, *command: str, path: Sequence[Path] = ()) -> subprocess.Popen[bytes]:
        modules = {"PYTHONPATH": os.pathsep.join(map(str, (*path, ROOT)))}
        with (self._folder / "output.txt").open("ab") as output:
            program = subprocess.Popen(
                [sys.executable, "-m", "dask", *command],
                env=self._environment | modules,
                cwd=self._folder,
                stdout=output,
                stderr=output,
                start_new_session=True,
            )
        self.programs.append(program)
        return program

    def close(self) -> None:
        """End them at once, with the processes that they started."""
        for program in self.programs:
            with suppress(ProcessLookupError):
                os.killpg(program.pid, signal.SIGKILL)
            program.wait()
