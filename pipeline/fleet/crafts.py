"""Flights to crafts: grouped, divided into those to fit and those to judge, identified jointly where that is new."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from pipeline.config import AnalysisConfig
from pipeline.execution.stages import Overall, Progress
from pipeline.fleet import joint
from pipeline.fleet.homogeneity import alike_flights, unlike_findings
from pipeline.fleet.result import ANOTHER_RECORDING, IdentifiedCrafts, Run
from pipeline.fleet.split import choose_split
from pipeline.flight.craft import by_craft, changes, kept_apart
from pipeline.results.entry import FlightEntry, GroupEntry
from pipeline.results.fleet import GroupResult, LogFailure
from pipeline.storage.manifest import CRAFTS, craft_key, drawn_anew, is_current, write_entry


def identify_crafts(flights: Sequence[FlightEntry], run: Run, progress: Progress) -> IdentifiedCrafts:
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

        progressing = Overall(report)
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
    return IdentifiedCrafts(
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
