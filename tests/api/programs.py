"""The service as a program of its own, which can be killed, and the processes that it starts."""

import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

import httpx

from tests.paths import ROOT

Answer = TypeVar("Answer")

#: Seconds after which something that should come to hold is taken not to: no test ends by it unless it fails.
PATIENCE = 300.0


def free_port() -> int:
    """Find a port for a program of its own, outside the range from which the kernel gives ports to clients.

    From there another test's connection could take it before the program does, or while the program is restarted.
    """
    first = 10_000 + os.getpid() * 199 % 20_000
    for port in range(first, first + 1000):
        if port not in _given:
            with suppress(OSError), socket.create_server(("127.0.0.1", port)):
                _given.add(port)
                return port
    raise OSError("no port is free")


_given: set[int] = set()


#: Words after `python`, to be followed by a port: the service with analyses of milliseconds, and as users have it.
STAND_IN = ("-m", "tests.api.serving")
SERVE = ("-c", "from rotorid.cli.main import main; main()", "serve", "--port")


class Service:
    """A service in a process of its own."""

    def __init__(self, data: Path, program: tuple[str, ...] = STAND_IN, **settings: str) -> None:
        self.data, self._program = data, program
        self.port = free_port()
        self._settings = {"ROTORID_DATA": str(data), "ROTORID_WORKERS": "2", "ROTORID_LEASE": "3", **settings}
        self.client = httpx.Client(base_url=f"http://127.0.0.1:{self.port}", timeout=PATIENCE)
        self.start()

    def start(self) -> None:
        """Start it and wait until it answers."""
        command = [sys.executable, *self._program, str(self.port)]
        self.process = subprocess.Popen(command, cwd=ROOT, env=os.environ | self._settings)
        wait_until(self.answers)

    def answers(self) -> bool:
        """Return whether it is up."""
        try:
            return self.client.get("/healthz").status_code == 200
        except httpx.TransportError:
            return False

    def kill(self) -> None:
        """Kill the server, as a power cut would."""
        self.process.kill()
        self.process.wait()

    def workers(self) -> list[int]:
        """List the processes of analyses: the children of the process that they are forked from."""
        return [pid for child in children(self.process.pid) for pid in children(child) if is_analysis(pid)]

    def close(self) -> None:
        """End it."""
        self.process.terminate()
        self.process.wait()
        self.client.close()


def children(pid: int) -> list[int]:
    """List the children of a process."""
    try:
        threads = list(Path(f"/proc/{pid}/task").iterdir())
        return [int(child) for thread in threads for child in (thread / "children").read_text().split()]
    except OSError:
        return []


def descendants(pid: int) -> list[int]:
    """List what a process started, and what that started."""
    return [descendant for child in children(pid) for descendant in (child, *descendants(child))]


def is_analysis(pid: int) -> bool:
    """Report a process that analyses, which is nice, from those that serve `multiprocessing`."""
    try:
        return os.getpriority(os.PRIO_PROCESS, pid) > os.getpriority(os.PRIO_PROCESS, 0)
    except ProcessLookupError:
        return False


def wait_until(question: Callable[[], Answer], pause: float = 0.05) -> Answer:
    """Ask until the answer is true, and return it; fail when it never is."""
    deadline = time.monotonic() + PATIENCE
    while not (answer := question()):
        assert time.monotonic() < deadline, "waited too long"
        time.sleep(pause)
    return answer
