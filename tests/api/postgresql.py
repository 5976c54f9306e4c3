"""A PostgreSQL server of our own for the tests, from the distribution's package."""

import os
import pwd
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.api.programs import free_port


def programs() -> Path:
    """Return the folder with the server's programs; the test is skipped where there is none."""
    programs_found = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"))
    if not programs_found:
        pytest.skip("PostgreSQL is not installed (Debian: apt-get install postgresql)")
    return programs_found[-1].parent


class Server:
    """A server that keeps its data in `folder`."""

    def __init__(self, folder: Path) -> None:
        self._binaries = programs()
        # PostgreSQL refuses to run as root; Debian's package brings a user for it.
        self._user = "postgres" if os.geteuid() == 0 else None
        self._folder = folder
        if self._user is not None:
            shutil.chown(folder, self._user, pwd.getpwnam(self._user).pw_gid)
        self._port = free_port()
        self.url = f"postgresql+psycopg://rotorid@127.0.0.1:{self._port}/postgres"
        self._run("initdb", "-U", "rotorid", "-A", "trust", "-E", "UTF8", "--no-sync")

    def start(self) -> None:
        """Start it and wait until it answers."""
        options = f"-c listen_addresses=127.0.0.1 -c port={self._port} -c unix_socket_directories={self._folder}"
        self._run("pg_ctl", "-o", f"{options} -c fsync=off", "-l", str(self._folder / "server.log"), "-w", "start")

    def stop(self) -> None:
        """Stop it at once, as a crash would."""
        self._run("pg_ctl", "-m", "immediate", "-w", "stop")

    def _run(self, program: str, *arguments: str) -> None:
        command = [self._binaries / program, "-D", str(self._folder / "data"), *arguments]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, user=self._user, cwd=self._folder)


@contextmanager
def running() -> Iterator[Server]:
    """Run a server until it is needed no more."""
    # Not in pytest's folder, which other users may not enter.
    with tempfile.TemporaryDirectory(prefix="rotorid-postgresql-") as folder:
        server = Server(Path(folder))
        server.start()
        try:
            yield server
        finally:
            server.stop()
