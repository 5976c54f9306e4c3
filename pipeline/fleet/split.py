"""Which flights of a craft a model is fitted to, and which judge it: named by the user, or stratified, and stated.

Left to itself the split is deterministic and of this kind:

- Flights whose position is poor or of unknown accuracy, or which move too little or nobody knows how much, are excluded
  from training; they judge.
- Of the others half train. At every place and on every day the two halves differ by one flight at most: flights of the
  same place and day are paired by how much they move, one of each pair trains; those left over are the edges of a
  graph that joins places with days, and train or judge by turns along its trails. Cycles of such a graph are even, so
  that turns work out at every place and day (an equitable colouring of the edges of a bipartite graph: de Werra 1971,
  by trails as Gabow 1976).
- Who of a pair trains is chosen such that both halves are spread alike over the range of excitation (RMS acceleration);
  the flight that moves most trains, because models interpolate better than they extrapolate.
- No more than `MOST_TRAINING` train. Flights differ in wind, air and battery; a mean over k of them leaves the error
  on an unseen flight larger than that of the best model by a factor of sqrt(1 + 1/k), and a joint fit costs k times as
  much: at 20 flights the rest is 2.5 %.
- Of those held out no more than `MOST_JUDGING` judge, chosen in the same way: they tell a mean error to a few percent,
  and their free runs are held in memory and drawn.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from fnmatch import fnmatch
from itertools import accumulate
from typing import TYPE_CHECKING

from pipeline.fleet.homogeneity import unlike_flights
from pipeline.fleet.places import day_of, places_of
from pipeline.flight.training import (
    excitation,
    exclusion_of,
)
from pipeline.results.split import Split, TrainingExclusion

if TYPE_CHECKING:
    from pipeline.config import AnalysisConfig
    from pipeline.results.entry import FlightEntry

#: Most flights that train where the user names none.
MOST_TRAINING = 20

#: Most flights held out that models are judged on where the user names none.
MOST_JUDGING = 100


def choose_split(entries: Sequence[FlightEntry], config: AnalysisConfig) -> Split:
    """Divide the flights of one craft into those to fit and those to judge, and say how it was done."""
    flights = sorted(entries, key=lambda flight: flight.name)
    if config.training or config.validation:
        return _by_user(flights, config)
    never = {flight.name: reason for flight in flights if (reason := exclusion_of(flight))}
    unlike = {name: each.reason for name, each in unlike_flights(flights).items()}
    usable = [flight for flight in flights if flight.name not in never and flight.name not in unlike]
    half = _half(usable)
    chosen = _thinned(half, MOST_TRAINING)
    names = {flight.name for flight in chosen}
    judges = [flight for flight in flights if flight.name not in names and flight.name not in unlike]
    return Split(
        training=tuple(sorted(names)),
        held_out=tuple(flight.name for flight in judges),
        judging=tuple(sorted(flight.name for flight in _thinned(judges, MOST_JUDGING))),
        unused=unlike,
        never_train=never,
        sentence=_sentence(usable, chosen, judges, never, capped=len(chosen) < len(half)),
    )


def named(flight: FlightEntry, patterns: Iterable[str]) -> bool:
    """Return whether one of the user's patterns means a flight, or the log that it is of."""
    names = {flight.name.casefold(), flight.log_name.casefold()}
    return any(fnmatch(name, pattern.casefold()) for pattern in patterns for name in names)


def _by_user(flights: Sequence[FlightEntry], config: AnalysisConfig) -> Split:
    training = [flight.name for flight in flights if named(flight, config.training)]
    judges = [flight.name for flight in flights if named(flight, config.validation)]
    if not config.validation:
        judges = [flight.name for flight in flights if flight.name not in training]
        sentence = "the training flights were named by the user; all others judge"
    elif not config.training:
        training = [flight.name for flight in flights if flight.name not in judges]
        sentence = "the flights that judge were named by the user; all others train"
    else:
        # What both patterns mean trains: it is no longer unseen.
        judges = [name for name in judges if name not in training]
        sentence = "the flights that train and those that judge were named by the user"
    neither = {
        flight.name: "the user named it neither to train nor to judge"
        for flight in flights
        if flight.name not in (*training, *judges)
    }
    poor = {flight.name: reason for flight in flights if flight.name in training and (reason := exclusion_of(flight))}
    if poor:
        sentence += "; of those that train, " + ", ".join(
            f"{name} teaches little ({why.reason})" for name, why in poor.items()
        )
    return Split(
        training=tuple(training), held_out=tuple(judges), judging=tuple(judges), unused=neither, sentence=sentence
    )


def _rank(flight: FlightEntry) -> tuple[float, str]:
    """Sort by excitation, most first; every flight that may train has been measured."""
    return -(excitation(flight) or 0.0), flight.name


def _half(flights: Sequence[FlightEntry]) -> list[FlightEntry]:
    """Choose half of the flights, give or take one; every place and day is divided in the same way."""
    rank = {flight.name: k for k, flight in enumerate(sorted(flights, key=_rank))}
    places = places_of(flights)
    cells: dict[tuple[int, str], list[int]] = defaultdict(list)
    for flight in flights:
        cells[places[flight.name], day_of(flight)].append(rank[flight.name])
    chains: list[list[int]] = []
    rest: dict[tuple[int, str], int] = {}
    for cell, members in sorted(cells.items()):
        members.sort()
        if len(members) % 2:
            # The least excited is left over: the pairs hold those that matter most.
            rest[cell] = members.pop()
        chains += [[members[k], members[k + 1]] for k in range(0, len(members), 2)]
    chains += [[rest[cell] for cell in trail] for trail in _trails(sorted(rest))]
    chosen = _turned(chains, len(flights))
    return [flight for flight in flights if rank[flight.name] in chosen]


def _trails(cells: Sequence[tuple[int, str]]) -> list[list[tuple[int, str]]]:
    """Divide the edges between places and days into trails, open ones first: as few as there are odd nodes, halved."""
    # Edges by node: places and days are told apart by their side.
    touching: dict[tuple[int, int | str], set[tuple[int, str]]] = defaultdict(set)
    for cell in cells:
        touching[0, cell[0]].add(cell)
        touching[1, cell[1]].add(cell)
    trails = []
    # From odd nodes first, so that what is left has even nodes only and closes upon itself.
    for odd in (True, False):
        for node in sorted(touching, key=str):
            while touching[node] and (len(touching[node]) % 2 == 1 or not odd):
                trail, at = [], node
                while touching[at]:
                    edge = min(touching[at])
                    trail.append(edge)
                    for side in (0, 1):
                        touching[side, edge[side]].discard(edge)
                    at = (1, edge[1]) if at[0] == 0 else (0, edge[0])
                trails.append(trail)
    return trails


def _turned(chains: Sequence[Sequence[int]], count: int) -> set[int]:
    """Choose every other member of each chain, so that takers and others are spread alike over the ranks.

    Returns
    -------
    set of int
        Ranks taken: half of all, give or take one; 0 is among them.
    """
    chosen: set[int] = set()
    signs = [0] * count
    balance = 0
    for chain in sorted(chains, key=min):
        ways = []
        for first in (1, -1):
            turn = {member: first * (-1) ** k for k, member in enumerate(chain)}
            total = balance + sum(turn.values())
            # Best are halves alike or one more that train; one fewer only for the sake of the flight that moves most.
            size = (0, 1, -1).index(total) if abs(total) <= 1 else 3
            ways.append((turn.get(0, 1) < 0, max(size - 1, 0), _uneven(signs, turn), -turn[min(chain)], first, turn))
        *_, turn = min(ways, key=lambda way: way[:5])
        for member, sign in turn.items():
            signs[member] = sign
        balance += sum(turn.values())
        chosen |= {member for member, sign in turn.items() if sign > 0}
    return chosen


def _uneven(signs: Sequence[int], turn: Mapping[int, int]) -> int:
    """Sum of squares of how far takers are ahead, counted down the ranks (as in Cramér and von Mises' criterion)."""
    return sum(ahead**2 for ahead in accumulate(turn.get(rank, sign) for rank, sign in enumerate(signs)))


def _thinned(flights: Sequence[FlightEntry], most: int) -> list[FlightEntry]:
    """Keep at most so many: every so many-th by place, day and excitation, and the one that moves most."""
    if len(flights) <= most:
        return list(flights)
    places = places_of(flights)
    ordered = sorted(flights, key=lambda f: (places[f.name], day_of(f), *_rank(f)))
    at = [int((k + 0.5) * len(ordered) / most) for k in range(most)]
    best = min(range(len(ordered)), key=lambda k: _rank(ordered[k]))
    nearest = min(range(len(at)), key=lambda k: abs(at[k] - best))
    at[nearest] = best
    return [ordered[k] for k in sorted(set(at))]


def _sentence(
    usable: Sequence[FlightEntry],
    chosen: Sequence[FlightEntry],
    judges: Sequence[FlightEntry],
    unable: Mapping[str, TrainingExclusion],
    *,
    capped: bool,
) -> str:
    """Report how the flights were divided, with the numbers."""
    never = "; ".join(f"{name} never trains: {unable[name].reason}" for name in sorted(unable)[:5])
    if len(unable) > 5:
        never += f"; {len(unable) - 5} more never train"
    if not chosen:
        return f"no flight can train: {never}" if never else "there is no flight"
    if len(usable) == 1 and not judges:
        return "the only flight of the craft trains, and no other is there to judge"
    if len(usable) == 1:
        return f"{chosen[0].name} is the only flight that can train, the others judge; {never}"
    total = len(chosen) + len(judges)
    places = len(set(places_of(usable).values()))
    days = len({day_of(flight) for flight in usable})
    text = (
        f"{len(chosen)} of {total} flights train and {len(judges)} judge, stratified by place ({places}), day ({days}) "
        f"and excitation: RMS acceleration {_range(chosen)} in training, "
        f"{_range([flight for flight in judges if flight.name not in unable])} in judging"
    )
    if capped:
        gain = 100.0 * (math.sqrt(1.0 + 1.0 / len(chosen)) - 1.0)
        text += (
            f"; of the half that could train {len(chosen)} do, spread over places, days and excitation, because more "
            f"would lower the error on unseen flights by less than {gain:.1f} %"
        )
    if len(judges) > MOST_JUDGING:
        text += f"; models are judged on {MOST_JUDGING} of those held out, spread alike"
    return f"{text}; {never}" if never else text


def _range(flights: Sequence[FlightEntry]) -> str:
    values = [value for flight in flights if (value := excitation(flight)) is not None]
    if not values:
        return "not determined"
    low, high = f"{min(values):.2g}", f"{max(values):.2g}"
    return f"{low} m/s²" if low == high else f"{low}–{high} m/s²"
