"""Which flights of a craft a model is fitted to, and which judge it: named by the user, or stratified, and stated.

Left to itself the split is deterministic and of this kind:

- Flights whose position is poor or of unknown accuracy, or which move too little or nobody knows how much, are excluded
  from training; they judge.
- Of the others half train. Flights of the same place and day are paired by how much they move, those left over among
  themselves, and one of each pair trains: in turns the one that moves more and the other, so that both halves are
  spread alike over places, days and excitation. The flight that moves most trains, because models interpolate better
  than they extrapolate.
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
from typing import TYPE_CHECKING

from pipeline.fleet.homogeneity import day_of, places_of, unlike_flights
from pipeline.flight.training import excitation, exclusion_of
from pipeline.results.fleet import Split

if TYPE_CHECKING:
    from pipeline.config import AnalysisConfig
    from pipeline.results.fleet import FlightEntry

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
    unlike = {name: apart.reason for name, apart in unlike_flights(flights).items()}
    usable = [flight for flight in flights if flight.name not in never and flight.name not in unlike]
    half = _half(usable)
    chosen = _thinned(half, MOST_TRAINING)
    names = {flight.name for flight in chosen}
    held_out = [flight for flight in flights if flight.name not in names and flight.name not in unlike]
    return Split(
        training=tuple(sorted(names)),
        held_out=tuple(flight.name for flight in held_out),
        judging=tuple(sorted(flight.name for flight in _thinned(held_out, MOST_JUDGING))),
        unused=unlike,
        never_train=never,
        sentence=_sentence(usable, chosen, held_out, never, capped=len(chosen) < len(half)),
    )


def named(flight: FlightEntry, patterns: Iterable[str]) -> bool:
    """Return whether one of the user's patterns means a flight, or the log that it is of."""
    names = {flight.name.casefold(), flight.log_name.casefold()}
    return any(fnmatch(name, pattern.casefold()) for pattern in patterns for name in names)


def _by_user(flights: Sequence[FlightEntry], config: AnalysisConfig) -> Split:
    training = [flight.name for flight in flights if named(flight, config.training)]
    held_out = [flight.name for flight in flights if named(flight, config.validation)]
    if not config.validation:
        held_out = [flight.name for flight in flights if flight.name not in training]
        sentence = "the training flights were named by the user; all others judge"
    elif not config.training:
        training = [flight.name for flight in flights if flight.name not in held_out]
        sentence = "the flights that judge were named by the user; all others train"
    else:
        # What both patterns mean trains: it is no longer unseen.
        held_out = [name for name in held_out if name not in training]
        sentence = "the flights that train and those that judge were named by the user"
    neither = {
        flight.name: "the user named it neither to train nor to judge"
        for flight in flights
        if flight.name not in (*training, *held_out)
    }
    poor = {flight.name: reason for flight in flights if flight.name in training and (reason := exclusion_of(flight))}
    if poor:
        sentence += "; of those that train, " + ", ".join(
            f"{name} teaches little ({why})" for name, why in poor.items()
        )
    return Split(
        training=tuple(training), held_out=tuple(held_out), judging=tuple(held_out), unused=neither, sentence=sentence
    )


def _rank(flight: FlightEntry) -> tuple[float, str]:
    """Sort by excitation, most first; every flight that may train has been measured."""
    return -(excitation(flight) or 0.0), flight.name


def _half(flights: Sequence[FlightEntry]) -> list[FlightEntry]:
    """Choose half of the flights, give or take one, one of each pair of flights that are alike."""
    places = places_of(flights)
    cells: dict[tuple[int, str], list[FlightEntry]] = defaultdict(list)
    for flight in sorted(flights, key=_rank):
        cells[places[flight.name], day_of(flight)].append(flight)
    # The least excited is left over: the pairs hold those that matter most.
    rest = sorted((members.pop() for members in cells.values() if len(members) % 2), key=_rank)
    pairs = [members[k : k + 2] for members in (*cells.values(), rest) for k in range(0, len(members), 2)]
    pairs.sort(key=lambda pair: _rank(pair[0]))
    chosen = {pair[k % 2].name for k, pair in enumerate(pairs) if k % 2 < len(pair)}
    return [flight for flight in flights if flight.name in chosen]


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
    held_out: Sequence[FlightEntry],
    unable: Mapping[str, str],
    *,
    capped: bool,
) -> str:
    """Report how the flights were divided, with the numbers."""
    never = "; ".join(f"{name} never trains: {unable[name]}" for name in sorted(unable)[:5])
    if len(unable) > 5:
        never += f"; {len(unable) - 5} more never train"
    if not chosen:
        return f"no flight can train: {never}" if never else "there is no flight"
    if len(usable) == 1 and not held_out:
        return "the only flight of the craft trains, and no other is there to judge"
    if len(usable) == 1:
        return f"{chosen[0].name} is the only flight that can train, the others judge; {never}"
    total = len(chosen) + len(held_out)
    places = len(set(places_of(usable).values()))
    days = len({day_of(flight) for flight in usable})
    text = (
        f"{len(chosen)} of {total} flights train and {len(held_out)} judge, stratified by place ({places}), "
        f"day ({days}) and excitation: RMS acceleration {_range(chosen)} in training, "
        f"{_range([flight for flight in held_out if flight.name not in unable])} in judging"
    )
    if capped:
        gain = 100.0 * (math.sqrt(1.0 + 1.0 / len(chosen)) - 1.0)
        text += (
            f"; of the half that could train {len(chosen)} do, spread over places, days and excitation, because more "
            f"would lower the error on unseen flights by less than {gain:.1f} %"
        )
    if len(held_out) > MOST_JUDGING:
        text += f"; models are judged on {MOST_JUDGING} of those held out, spread alike"
    return f"{text}; {never}" if never else text


def _range(flights: Sequence[FlightEntry]) -> str:
    values = [value for flight in flights if (value := excitation(flight)) is not None]
    if not values:
        return "not determined"
    low, high = f"{min(values):.2g}", f"{max(values):.2g}"
    return f"{low} m/s²" if low == high else f"{low}–{high} m/s²"
