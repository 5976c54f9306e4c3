"""Flights to crafts: grouped, divided into those to fit and those to judge, identified jointly where that is new."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatch

from pipeline.config import AnalysisConfig
from pipeline.execution.stages import Progress, overall
from pipeline.fleet import joint
from pipeline.fleet.homogeneity import alike_flights, day_of, places_of, unlike_findings, unlike_flights
from pipeline.fleet.result import ANOTHER_RECORDING, Crafts, Run
from pipeline.flight.craft import by_craft, changes, kept_apart
from pipeline.flight.training import (
    excitation,
    exclusion_of,
)
from pipeline.results.entry import FlightEntry, GroupEntry
from pipeline.results.fleet import GroupResult, LogFailure, Split, TrainingExclusion
from pipeline.storage.manifest import CRAFTS, craft_key, drawn_anew, is_current, write_entry


def identify_crafts(flights: Sequence[FlightEntry], run: Run, progress: Progress) -> Crafts:
    """Identify every craft that has several flights from some of them, and judge its models on the others."""
    config, store = run.config, run.store
    crafts = by_craft(flights)
    apart = kept_apart(crafts)
    used = {flight.name for craft in crafts for flight in craft}
    left_out = [
        (flight.source, ANOTHER_RECORDING)
        for flight in flights
        if flight.experiments and flight.position_known and flight.name not in used
    ]
    builds = sorted(_builds(crafts, config), key=lambda build: (-len(build[1]), build[1][0].craft, build[0]))
    pooled = {flight.name for build, craft in builds if build > 1 for flight in craft}
    entries, failures, unstored = [], [], []
    fitted: dict[str, GroupResult] = {}
    for number, (build, craft) in enumerate(builds):
        first = craft[0]
        split = choose_split(craft, config)
        unused = {name: reason for name, reason in split.unused.items() if name not in pooled}
        left_out += [(each.source, unused[each.name]) for each in craft if each.name in unused]
        findings = (*changes(craft), *apart.get(first.craft, ()), *unlike_findings(craft))
        entry = GroupEntry(
            name=first.craft_name if build == 1 else f"{first.craft_name}, build {build}",
            folder=first.vehicle if build == 1 else f"{first.vehicle}-build-{build}",
            key=craft_key(craft, split, findings, config),
            craft=first.craft,
            vehicle=first.vehicle,
            training=split.training,
            held_out=split.held_out,
            split=split.sentence,
            pages=run.pages,
        )
        if not run.redo and _is_there(entry, run):
            entries.append(entry)
            continue

        what = f"{entry.name}, {len(craft)} flights jointly"

        def report(stage: str, fraction: float, number: int = number, what: str = what) -> None:
            progress(f"{what}: {stage}", (number + fraction) / len(builds))

        progressing = overall(report)
        result = joint.identify_craft(entry.name, craft, split, store.url, config, progressing, run.executor, findings)
        try:
            with store.scratch() as scratch:
                product = scratch / "product"
                product.mkdir()
                if run.publish is not None:
                    run.publish(result, product)
                write_entry(entry, product)
                store.commit(product, f"{CRAFTS}/{entry.folder}")
        except OSError as error:
            reason = f"its joint models could not be stored: {error.strerror or error}"
            failures.append(LogFailure(entry.name, reason))
            unstored.append(entry)
        else:
            entries.append(entry)
            fitted[entry.folder] = result if run.publish is None else _light(result)
    return Crafts(
        entries=tuple(entries),
        left_out=tuple(left_out),
        failures=tuple(failures),
        unstored=tuple(unstored),
        fitted=fitted,
    )


def _builds(
    crafts: Sequence[tuple[FlightEntry, ...]], config: AnalysisConfig
) -> Iterator[tuple[int, tuple[FlightEntry, ...]]]:
    """Yield what is fitted jointly: each craft, which leaves out flights unlike the rest, and these among themselves.

    Flights that the user names are fitted as asked.
    """
    for craft in crafts:
        if len(craft) > 1:
            yield 1, craft
        if not (config.training or config.validation):
            further = (alike for alike in alike_flights(craft)[1:] if len(alike) > 1)
            yield from enumerate(further, start=2)


def _light(result: GroupResult) -> GroupResult:
    """Leave out the free runs, which have been published: those of many crafts would not fit into memory."""
    return replace(result, models=tuple(replace(model, predictions=()) for model in result.models))


def _is_there(entry: GroupEntry, run: Run) -> bool:
    """Return whether the store has the products of a craft, with its pages drawn anew where others are wanted."""
    if is_current(run.store, entry):
        return True
    same, publish = is_current(run.store, replace(entry, pages="")), run.publish
    return same and publish is not None and drawn_anew(run.store, f"{CRAFTS}/{entry.folder}", entry, publish)


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
