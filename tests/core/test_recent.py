"""Results that are kept for the very same objects."""

import numpy as np

from core.recent import Recent


def test_results_are_of_the_very_objects_they_were_made_of() -> None:
    recent: Recent[int] = Recent(2)
    made: list[int] = []

    def make() -> int:
        made.append(len(made))
        return made[-1]

    first, equal = np.zeros(3), np.zeros(3)
    assert recent.of(first, 1.5, make=make) == 0
    assert recent.of(first, 1.5, make=make) == 0
    assert recent.of(equal, 1.5, make=make) == 1
    assert recent.of(first, make=make) == 2  # the oldest is gone
    assert recent.of(first, 1.5, make=make) == 3
