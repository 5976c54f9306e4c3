"""The process of an analysis gives up what only the server needs: its environment, and the files in its keeping.

A log is made by a stranger. Whoever takes a process over through one has that log, its results and the programs of this
computer, but no password of the server and no log of anybody else.
"""

import ctypes
import os
import signal
import struct
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

#: Beginnings of names of environment variables that an analysis may know; all others may hold a secret.
_KNOWN = ("PATH", "HOME", "LANG", "LC_", "TZ", "TMPDIR", "XDG_", "PYTHON", "OPENBLAS_", "OMP_", "MKL_", "NUMBA_", "MPL")

#: Linux's request for a signal at the death of the parent, of prctl(2).
_PR_SET_PDEATHSIG = 1

# System calls and rights of Landlock (linux/landlock.h), the same on all architectures.
_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446
_VERSION, _PATH_BENEATH, _NO_NEW_PRIVILEGES = 1, 1, 38
#: Rights to read files; to execute and write them too; all those on folders, up to renaming from one to another.
_READ, _FILE, _FOLDER = 0b100, 0b111, (1 << 14) - 1
#: The first version that lets files be renamed from one folder to another.
_LEAST = 2


def die_with_parent() -> None:
    """End this process when the one that it was forked from ends, however that one ends."""
    if sys.platform == "linux":
        parent = os.getppid()
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if parent == 1 or os.getppid() != parent:  # it had ended before
            os._exit(1)


def confine(closed: Sequence[Path], own: Path, given: Sequence[Path] = ()) -> bool:
    """Close the environment and some folders to this process and those that it starts, for good.

    It must have one thread. What /proc tells of other processes is closed too.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    _forget(libc)
    if landlock_version() < _LEAST:
        return False
    attributes = struct.pack("=Q", _FOLDER)
    rules = _checked(libc.syscall(_CREATE_RULESET, attributes, ctypes.c_size_t(len(attributes)), 0))
    try:
        kept = os.environ.get("NUMBA_CACHE_DIR")
        # The environment of the server stands in /proc too.
        others = [path for path in Path("/proc").glob("[0-9]*") if path.name != str(os.getpid())]
        shut = [*(path.resolve() for path in closed), *others]
        for path in (own.resolve(), *([Path(kept)] if kept else []), *_beside(Path("/"), shut)):
            _open(libc, rules, path, _FOLDER if path.is_dir() else _FILE)
        for path in given:
            _open(libc, rules, path, _READ)
        _checked(libc.prctl(_NO_NEW_PRIVILEGES, 1, 0, 0, 0))
        _checked(libc.syscall(_RESTRICT_SELF, rules, 0))
    finally:
        os.close(rules)
    return True


def landlock_version() -> int:
    """Return the version of Landlock that the kernel offers; 0 where there is none."""
    try:
        version: int = ctypes.CDLL(None).syscall(_CREATE_RULESET, None, ctypes.c_size_t(0), _VERSION)
    except AttributeError:  # no Linux
        return 0
    return max(version, 0)


def _forget(libc: ctypes.CDLL) -> None:
    """Remove variables from the environment and wipe their text, which /proc would go on to show."""
    libc.getenv.restype = ctypes.c_void_p
    for name in [name for name in os.environ if not name.startswith(_KNOWN)]:
        text = libc.getenv(os.fsencode(name))
        if text:
            ctypes.memset(text, 0, len(ctypes.string_at(text)))
        del os.environ[name]


def _beside(folder: Path, closed: Sequence[Path]) -> Iterator[Path]:
    """Yield the highest files and folders that neither hold nor are what is closed."""
    if folder in closed:
        return
    if not any(path.is_relative_to(folder) for path in closed):
        yield folder
        return
    try:
        children = sorted(folder.iterdir())
    except OSError:
        return
    for child in children:
        if not child.is_symlink():  # what it leads to is judged where it lies
            yield from _beside(child, closed)


def _open(libc: ctypes.CDLL, rules: int, path: Path, rights: int) -> None:
    """Grant rights at a path and beneath it; one that has gone by now is left out."""
    try:
        place = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except OSError:
        return
    try:
        rule = struct.pack("=Qi", rights, place)
        _checked(libc.syscall(_ADD_RULE, rules, _PATH_BENEATH, rule, 0))
    finally:
        os.close(place)


def _checked(result: int) -> int:
    if result < 0:
        code = ctypes.get_errno()
        raise OSError(code, os.strerror(code))
    return result
