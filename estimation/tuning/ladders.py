"""The climb of one setting along a ladder of values, by the likelihood of the filter."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from hashlib import blake2b

import numpy as np

from estimation.filter import Problem, run
from estimation.states import SensorNoise

#: Gain in log-likelihood that a lag other than the documented one must bring.
DECISIVE = 10.0


@dataclass(frozen=True, slots=True)
class Passes:
    """Likelihoods of the filter, each worked out once: ladders share their rungs."""

    _known: dict[tuple[SensorNoise, bytes], float] = field(default_factory=dict)

    def likelihood(self, problem: Problem) -> float:
        """Return the log-likelihood of a problem of this segment."""
        o, content = problem.observations, blake2b(digest_size=16)
        for part in (problem.t, problem.sub_noise, problem.x, problem.P, problem.white_scale, o.t, o.kind, o.z):
            content.update(part.tobytes())
        key = problem.noise, content.digest()
        if key not in self._known:
            self._known[key] = run(problem, keep=False).log_likelihood
        return self._known[key]


def nearest(ladder: Sequence[float], value: float) -> float:
    """Return the rung nearest to a positive value, by ratio."""
    return min(ladder, key=lambda rung: abs(np.log(rung / value)))


def climb(
    variant: Callable[[float], Problem], ladder: Sequence[float], start: float, passes: Passes
) -> tuple[dict[float, float], Problem]:
    """Go up and down a ladder from `start` as long as it gets likelier; likelihoods by value, and the likeliest."""
    likelihoods: dict[float, float] = {}
    best: Problem | None = None
    for step in (1, -1):
        k = ladder.index(start)
        while 0 <= k < len(ladder):
            value = ladder[k]
            if value not in likelihoods:
                problem = variant(value)
                likelihoods[value] = passes.likelihood(problem)
                if best is None or likelihoods[value] >= max(likelihoods.values()):
                    best = problem
                elif value != start:
                    break
            k += step
    assert best is not None  # start is a rung
    return likelihoods, best
