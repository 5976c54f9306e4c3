"""What this computer gives to analyses: processors and memory, also inside a container or a batch job that has less."""

import ctypes
import gc
import os
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from core.lazy import lazy

if TYPE_CHECKING:
    import psutil
else:
    psutil = lazy("psutil")

#: Where Linux tells of control groups, which containers and batch systems limit their processes by.
_ROOT = Path("/")


def pin_threads() -> None:
    """Limit processes that start from now on to one thread each, unless the user has said otherwise.

    Our matrices are small: threads of BLAS only hurt them, and each other where logs are analysed side by side.
    """
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ.setdefault(name, "1")


def processors(root: Path = _ROOT) -> int:
    """Count the processors that this process may use, rounded down where a control group gives parts of one."""
    try:
        count = len(os.sched_getaffinity(0))
    except AttributeError:  # only Linux tells
        count = os.cpu_count() or 1
    for folder in _control_groups("cpu", root):
        quota = _numbers(folder / "cpu.max") or _numbers(folder / "cpu.cfs_quota_us")
        period = quota[1:] or _numbers(folder / "cpu.cfs_period_us")
        if quota and period and quota[0] > 0:  # without a limit the older groups have -1
            count = min(count, quota[0] // period[0])
    return max(1, count)


def available_memory(root: Path = _ROOT) -> int:
    """Return the memory that processes may still take before the system ends one of them, bytes."""
    available = psutil.virtual_memory().available
    for folder in _control_groups("memory", root):
        for limit, usage, cached in (
            ("memory.max", "memory.current", "inactive_file"),
            ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
        ):
            allowed, used = _numbers(folder / limit), _numbers(folder / usage)
            if allowed and used:
                # Files read once are counted as used, but go as soon as somebody needs the memory.
                available = min(available, allowed[0] - used[0] + _of(folder / "memory.stat", cached))
    return max(0, available)


def _control_groups(controller: str, root: Path) -> Iterator[Path]:
    """List the folders of the control groups that this process is in, of both versions, each with all above it."""
    try:
        memberships = (root / "proc/self/cgroup").read_text().splitlines()
    except OSError:
        return
    mounts = root / "sys/fs/cgroup"
    for membership in memberships:
        _, controllers, path = membership.split(":", 2)
        if controllers and controller not in controllers.split(","):
            continue
        mount = mounts / controller if controllers else mounts
        # Inside a container the path is the host's: what does not exist here is passed over on the way to the root.
        group = mount / path.strip("/")
        for folder in (group, *group.parents):
            if folder.is_dir():
                yield folder
            if folder == mount:
                break


def _numbers(file: Path) -> tuple[int, ...]:
    """Read whole numbers; none where there is no such file or no limit, which is spelled ``max``."""
    try:
        return tuple(int(word) for word in file.read_text().split())
    except (OSError, ValueError):
        return ()


def _of(file: Path, name: str) -> int:
    """Read one number of a table of names and numbers; 0 where there is none."""
    try:
        table = dict(line.split(maxsplit=1) for line in file.read_text().splitlines())
    except (OSError, ValueError):
        return 0
    return int(table.get(name, 0))


def collect_seldom() -> None:
    """Search for unused cycles of objects in a hundredth of the usual number of times.

    Modules and results are millions of objects that stay and few cycles: searching took a twelfth of an analysis.
    """
    gc.set_threshold(100_000, 20, 20)


def trim_heap() -> None:
    """Return memory that was freed back to the system.

    The C library keeps what large arrays have left, in pieces between what lives on: after the trajectory of a long
    log, twice of what is in use. Where it cannot be told to give that back, nothing is done.
    """
    _trim()(0)


@cache
def _trim() -> Callable[[int], object]:
    try:
        trim: Callable[[int], object] = ctypes.CDLL(None).malloc_trim
    except (OSError, AttributeError, TypeError):  # only the GNU C library has it
        return lambda _: None
    return trim
