"""``python -m tests.fuzz [COUNT] [FIRST] [ENDING ...]``: many mutations, and where they break the readers' promise.

They must end in a LogError or be read, with all that lies outside a wound. A third of them is read with bounds checks
on, by a second process: compiled code is made anew for them.
"""

import os
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from logparse import RotoridError, read_log
from tests.fuzz.mutations import mutate
from tests.fuzz.reading import read_whole
from tests.fuzz.seeds import ROOT, draw, seeds
from tests.fuzz.spans import count, wound

#: One in so many cases has a single wound, and what lies outside of it is counted.
_WOUNDED = 5


def main(first: int, number: int, endings: Sequence[str]) -> int:
    """Read `number` mutations beginning with seed `first`; print what broke and return how many did."""
    places: Counter[str] = Counter()
    examples: dict[str, int] = {}
    times = np.zeros(number)
    warnings.simplefilter("error")
    with tempfile.TemporaryDirectory() as folder:
        for ending in endings:  # what is compiled at a first use is not the time of a mutation
            _read(Path(folder) / f"whole.{ending}", seeds()[ending])
        for k, seed in enumerate(range(first, first + number)):
            rng = np.random.default_rng(seed)
            ending = endings[seed % len(endings)]
            path = Path(folder) / f"mutated.{ending}"
            data = draw(ending, rng)
            began = time.process_time()
            try:
                if seed // len(endings) % _WOUNDED:
                    began = _read(path, mutate(data, rng, text=ending == "log"))
                else:
                    began = _read_wounded(path, data, rng)
            except Exception as error:
                frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename.startswith(str(ROOT))]
                where = f"{Path(frames[-1].filename).relative_to(ROOT)}:{frames[-1].lineno}"
                place = f"{where} {type(error).__name__}: {error}"[:150]
                if not places[place]:
                    print(f"seed {seed}: {place}", flush=True)
                places[place] += 1
                examples.setdefault(place, seed)
            times[k] = time.process_time() - began
            if k % 1000 == 999:
                so_far = f"{times[: k + 1].mean():.3f} s each, {times.max():.2f} s at most"
                print(f"{k + 1} read, {sum(places.values())} broke, {so_far}", flush=True)
    for place, often in places.most_common():
        print(f"{often:6} (seed {examples[place]}) {place}")
    print(
        f"{sum(places.values())} of {number} mutations broke; CPU time {times.mean():.3f} s each, "
        f"99.9 % below {np.quantile(times, 0.999):.2f} s, slowest {times.max():.2f} s (seed {first + times.argmax()})"
    )
    return sum(places.values())


def _read(path: Path, data: bytes) -> float:
    """Read a log as a whole; return when that began, in CPU time."""
    path.write_bytes(data)
    began = time.process_time()
    read_whole(path)
    return began


def _read_wounded(path: Path, data: bytes, rng: np.random.Generator) -> float:
    """Damage a log in one place and hold what is read against what lay beside it."""
    path.write_bytes(data)
    try:
        whole = count(read_log(path))
    except RotoridError:
        return time.process_time()  # a window without data
    damaged, hit = wound(data, path.suffix[1:], rng)
    began = _read(path, damaged)
    lost = whole - count(read_log(path))
    if not 0 <= lost <= hit:
        raise AssertionError(f"of {path.suffix[1:]} more messages are lost than were hit")
    return began


if __name__ == "__main__":
    numbers = [int(word) for word in sys.argv[1:] if word.isdigit()]
    asked = [word for word in sys.argv[1:] if not word.isdigit()] or sorted(seeds())
    number, first = numbers + [1000, 0][len(numbers) :]
    if os.environ.get("NUMBA_BOUNDSCHECK"):
        sys.exit(min(1, main(first, number, asked)))
    checked = number // 3
    broken = main(first, number - checked, asked)
    with tempfile.TemporaryDirectory() as cache:
        words = [str(checked), str(first + number - checked), *asked]
        environment = os.environ | {"NUMBA_BOUNDSCHECK": "1", "NUMBA_CACHE_DIR": cache}
        broken += subprocess.run([sys.executable, "-m", "tests.fuzz", *words], env=environment, check=False).returncode
    sys.exit(min(1, broken))
