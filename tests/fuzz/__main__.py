"""``python -m tests.fuzz [COUNT] [FIRST] [KIND ...]``: many mutations, and where they break the readers' promise.

Logs are damaged anywhere (bin, log, tlog, ulg), and files in what their counts and lengths say (`structures.KINDS`).
They must end in an error for people or be read, with all that lies outside a wound; each in a process of its own, in
10 s of CPU and in memory of 20 times the file and 200 MB. A third of the logs is read with bounds checks on, by a
second program: compiled code is made anew for them.
"""

import os
import resource
import subprocess
import sys
import tempfile
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from logparse import RotoridError, read_log
from tests.fuzz import structures
from tests.fuzz.mutations import mutate
from tests.fuzz.reading import read_whole
from tests.fuzz.seeds import ROOT, draw, seeds
from tests.fuzz.spans import count, wound

#: Processor seconds and bytes of memory that a reading may take; the latter beside 20 times the file.
MOST_SECONDS, MOST_BYTES = 10, 200_000_000

#: One in so many damaged logs has a single wound, and what lies outside of it is counted.
_WOUNDED = 5


def main(first: int, number: int, kinds: Sequence[str]) -> int:
    """Read `number` mutations beginning with seed `first`; print what broke and return how many did."""
    broken: Counter[str] = Counter()
    examples: dict[str, int] = {}
    times = np.zeros(number)
    warnings.simplefilter("error")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for kind in kinds:  # what is imported and compiled at a first use is not the cost of a mutation
            if kind in seeds():
                _read(folder / f"whole.{kind}", seeds()[kind])
            else:
                structures.read(kind, structures.seed(kind), folder)
        for k, seed in enumerate(range(first, first + number)):
            kind, wounded = kinds[seed % len(kinds)], seed // len(kinds) % _WOUNDED == 0
            size, reading = _mutation(kind, np.random.default_rng(seed), wounded, folder)
            why, times[k] = _judged(reading, size)
            if why:
                broken[f"{kind}: {why}"] += 1
                if examples.setdefault(f"{kind}: {why}", seed) == seed:
                    print(f"seed {seed}: {kind}: {why}", flush=True)
            if k % 1000 == 999:
                so_far = f"{times[: k + 1].mean():.3f} s each, {times.max():.2f} s at most"
                print(f"{k + 1} read, {broken.total()} broke, {so_far}", flush=True)
    for why, often in broken.most_common():
        print(f"{often:6} (seed {examples[why]}) {why}")
    print(
        f"{broken.total()} of {number} mutations broke; CPU time {times.mean():.3f} s each, "
        f"99.9 % below {np.quantile(times, 0.999):.2f} s, slowest {times.max():.2f} s (seed {first + times.argmax()})"
    )
    return broken.total()


def _mutation(kind: str, rng: np.random.Generator, wounded: bool, folder: Path) -> tuple[int, Callable[[], object]]:
    """Make a mutation; return its size, and what reads it."""
    if kind not in seeds():
        data = structures.mutate(kind, rng)
        return len(data), lambda: structures.read(kind, data, folder)
    path, whole = folder / f"mutated.{kind}", draw(kind, rng)
    if wounded:
        return len(whole), lambda: _read_wounded(path, whole, rng)
    damaged = mutate(whole, rng, text=kind == "log")
    return len(damaged), lambda: _read(path, damaged)


def _read(path: Path, data: bytes) -> None:
    """Read a log as a whole."""
    path.write_bytes(data)
    read_whole(path)


def _read_wounded(path: Path, data: bytes, rng: np.random.Generator) -> None:
    """Damage a log in one place and hold what is read against what lay beside it."""
    path.write_bytes(data)
    try:
        whole = count(read_log(path))
    except RotoridError:
        return  # a window without data
    damaged, hit = wound(data, path.suffix[1:], rng)
    _read(path, damaged)
    lost = whole - count(read_log(path))
    if not 0 <= lost <= hit:
        raise AssertionError(f"of {path.suffix[1:]} more messages are lost than were hit")


def _judged(reading: Callable[[], object], size: int) -> tuple[str, float]:
    """Read in a process of its own; return what is wrong with how it ended, or nothing, and the CPU time it took."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    receiver, sender = os.pipe()
    child = os.fork()
    if child == 0:
        resource.setrlimit(resource.RLIMIT_CPU, (2 * MOST_SECONDS, 3 * MOST_SECONDS))
        try:
            reading()
        except BaseException as error:  # what is not for people
            frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename.startswith(str(ROOT))]
            where = f"{Path(frames[-1].filename).relative_to(ROOT)}:{frames[-1].lineno}"
            os.write(sender, f"{where} {type(error).__name__}: {error}"[:150].encode(errors="replace"))
        finally:
            os._exit(0)
    os.close(sender)
    with os.fdopen(receiver, "rb") as said:
        why = said.read().decode(errors="replace")
    _, status, used = os.wait4(child, 0)
    seconds, grown = used.ru_utime + used.ru_stime, 1024 * (used.ru_maxrss - before)
    if status:
        why = f"ended by {status}"
    elif seconds > MOST_SECONDS:
        why = "too slow"
    return why or ("too much memory" if grown > 20 * size + MOST_BYTES else ""), seconds


if __name__ == "__main__":
    numbers = [int(word) for word in sys.argv[1:] if word.isdigit()]
    asked = [word for word in sys.argv[1:] if not word.isdigit()] or [*sorted(seeds()), *structures.KINDS]
    number, first = numbers + [1000, 0][len(numbers) :]
    if os.environ.get("NUMBA_BOUNDSCHECK"):
        sys.exit(min(1, main(first, number, asked)))
    logs = [kind for kind in asked if kind in seeds()]
    checked = number * len(logs) // len(asked) // 3
    broken = main(first, number - checked, asked)
    with tempfile.TemporaryDirectory() as cache:
        words = [str(checked), str(first + number - checked), *logs]
        environment = os.environ | {"NUMBA_BOUNDSCHECK": "1", "NUMBA_CACHE_DIR": cache}
        broken += subprocess.run([sys.executable, "-m", "tests.fuzz", *words], env=environment, check=False).returncode
    sys.exit(min(1, broken))
