"""``python -m tests.fuzz [COUNT] [FIRST]``: many mutations, the places of exceptions that are no LogError counted."""

import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from pathlib import Path

import numpy as np

from tests.fuzz.mutations import mutate
from tests.fuzz.reading import read_whole
from tests.fuzz.seeds import ROOT, seeds


def main(count: int, first: int) -> int:
    """Read `count` mutations beginning with seed `first`; print what broke and return how many did."""
    places: Counter[str] = Counter()
    examples: dict[str, int] = {}
    slowest = (0.0, 0)
    warnings.simplefilter("error")
    started = seeds()
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(first, first + count):
            rng = np.random.default_rng(seed)
            ending = sorted(started)[seed % len(started)]
            path = Path(folder) / f"mutated.{ending}"
            path.write_bytes(mutate(started[ending], rng, text=ending == "log"))
            began = time.perf_counter()
            try:
                read_whole(path)
            except Exception as error:
                frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename.startswith(str(ROOT))]
                place = (
                    f"{Path(frames[-1].filename).relative_to(ROOT)}:{frames[-1].lineno} {type(error).__name__}: {error}"
                )
                places[place[:150]] += 1
                examples.setdefault(place[:150], seed)
            slowest = max(slowest, (time.perf_counter() - began, seed))
    for place, times in places.most_common():
        print(f"{times:6} (seed {examples[place]}) {place}")
    print(f"{sum(places.values())} of {count} mutations broke; slowest {slowest[0]:.2f} s (seed {slowest[1]})")
    return sum(places.values())


if __name__ == "__main__":
    numbers = [int(word) for word in sys.argv[1:3]]
    sys.exit(min(1, main(*(numbers + [1000, 0][len(numbers) :]))))
