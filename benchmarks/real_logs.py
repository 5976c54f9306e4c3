"""The account of real flights against careful readings of the same logs, made by hand without rotorid.

`python -m benchmarks real_logs --readings FILE --logs DIR` prints how many rows agree, by quantity, and below them
every disagreement in a line. FILE is a table like ../shared/logs/real/readings.tsv (READINGS.md beside it explains the
columns), DIR the folder of its logs. Rows count whose reader was sure (high or medium).
"""

import argparse
import csv
import itertools
import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import logparse
from logparse.canonical.events import COPTER_SUBSYSTEMS
from pipeline.flight.account import account_of_flight
from pipeline.results.account import Account
from pipeline.results.span import Span

NAMES = ("flights", "height", "speed", "crash", "motor", "gravest", "failsafes", "battery", "vibration")

#: Happenings that the words of a sentence name. Where the sentence says that nothing broke there may be none.
WORDS: Mapping[str, tuple[str, ...]] = {
    r"hard landing|hard touch|landed hard|bounc|bump|firm landing|touch-?down \S+ s \(\d+|landing \S+ s \(\d+": (
        "hard-landing",
    ),
    r"full by itself|gave full throttle": ("throttle-runaway",),
    r"swung|swings|against the request|pitched to": ("control-lost",),
    r"failsafe|low battery": ("failsafe",),
    r"GPS lost|lost its fix": ("gps-lost",),
    r"accelerometer noise|vibration": ("vibration",),
    r"no lift|sank": ("lift-lost",),
    r"yaw authority": ("yaw-lost",),
}
NOTHING = re.compile(r"healthy|nothing happened", re.IGNORECASE)
#: What the account must tell where a sentence names it; the others may have come to nothing.
CAUSES = frozenset(
    ("motor-fault", "control-lost", "yaw-lost", "lift-lost", "throttle-runaway", "failsafe", "hard-landing")
)
#: How far [s] the first of the account's story may be from a time that the sentence names, and words of its first time.
WHEN, TIME = 5.0, re.compile(r"\b(?:at|from|from about) (\d+(?:\.\d+)?)")
#: Craft whose flights are not those of a multirotor.
PLANE = re.compile(r"\bplane: not a multirotor|rover|boat", re.IGNORECASE)
#: Texts of the readings for what a log says in words, by subsystem.
TEXTS = {"Low Battery": 6, "EKF variance": 16}


@dataclass(frozen=True)
class Found:
    """A flight as the account has it."""

    name: str
    account: Account

    @property
    def flight(self) -> Span:
        assert self.account.flight is not None
        return self.account.flight


def number(row: Mapping[str, str], name: str) -> float | None:
    """Return a number of the readings; None where it is blank."""
    try:
        return float(row.get(name) or "")
    except ValueError:
        return None


def found_flights(path: Path) -> list[Found]:
    """Return the account of every flight of a log."""
    accounts: list[Found] = []
    for log in logparse.read_flights(path):
        if log.flight is not None:
            accounts.append(Found(path.name, account_of_flight(log, Span(log.flight.start, log.flight.stop))))
    return accounts


def paired(rows: list[dict[str, str]], candidates: list[Found]) -> Iterator[tuple[dict[str, str], Found | None]]:
    """Pair each reading of a flight with the nearest account, and none twice; flights share power-ups' clocks."""
    left = list(candidates)
    for row in rows:
        start, stop = number(row, "takeoff_s"), number(row, "landing_s")

        def off(candidate: Found, start: float | None = start, stop: float | None = stop) -> float:
            ends = [
                abs(a - b) for a, b in ((start, candidate.flight.start), (stop, candidate.flight.stop)) if a is not None
            ]
            return max(ends) if ends else math.inf

        def overlaps(candidate: Found, start: float | None = start, stop: float | None = stop) -> bool:
            first, last = start if start is not None else -math.inf, stop if stop is not None else math.inf
            return candidate.flight.start < last and candidate.flight.stop > first

        near = min(filter(overlaps, left), key=off, default=None)
        if near is not None:
            left.remove(near)
        yield row, near


def compare(row: Mapping[str, str], candidate: Found) -> Iterator[tuple[str, bool, str]]:
    """Yield each quantity of a reading, whether the account agrees, and both in words."""
    account, flight = candidate.account, candidate.flight
    start, stop = number(row, "takeoff_s"), number(row, "landing_s")
    ends = [(start, flight.start), (stop, flight.stop)]
    off = [abs(read - ours) for read, ours in ends if read is not None]
    yield "flights", max(off, default=0.0) <= 2.0, f"{start}-{stop} s read, {flight.start:.1f}-{flight.stop:.1f} s here"
    credible = number(row, "height_baro_m") or number(row, "height_gps_m")
    if (named := re.search(r"(GPS|estimator|autopilot)[^;:]* credible", row["note"])) and "not credible" not in named[
        0
    ]:
        credible = number(row, "height_gps_m" if named[1] == "GPS" else "height_autopilot_m") or credible
    if credible is not None:
        ours = math.nan if account.height is None else account.height.value
        yield "height", abs(ours - credible) <= max(1.0, 0.1 * credible), f"{credible} m read, {ours:.1f} m here"
    if (speed := number(row, "ground_speed_gps_ms")) is not None:
        ours = math.nan if account.ground_speed is None else account.ground_speed.value
        yield "speed", abs(ours - speed) <= max(0.5, 0.1 * speed), f"{speed} m/s read, {ours:.1f} m/s here"
    crash = next((happening for happening in account.happenings if happening.id == "crash"), None)
    if row["crash"] in ("yes", "no"):
        agrees = (crash is not None) == (row["crash"] == "yes")
        impact = number(row, "impact_s")
        if crash is not None and agrees and impact is not None:
            agrees = abs((crash.t or 0.0) - impact) <= 0.5
        here = "none" if crash is None else f"at {crash.t:.1f} s"
        yield "crash", agrees, f"{row['crash']} {impact or ''} read, {here} here"
    faults = {str(happening.evidence.get("motor")) for happening in account.notable if happening.id == "motor-fault"}
    read = {row["motor_at_fault"]} - {""}
    yield "motor", faults == read, f"{read or 'none'} read, {faults or 'none'} here"
    yield "gravest", *gravest(row, account)
    yield "failsafes", *failsafes(row, account, flight)
    yield "battery", *battery(row, account)
    if row["vibration_max"]:
        worst = re.match(r"([\d.]+)", row["vibration_max"])
        ours = math.nan if account.vibration is None else account.vibration.worst
        value = float(worst[1]) if worst else math.nan
        yield "vibration", abs(ours - value) <= max(0.05 * value, 0.2), f"{row['vibration_max']} read, {ours:.1f} here"


def gravest(row: Mapping[str, str], account: Account) -> tuple[bool, str]:
    """Return whether all of the story is what the reader tells, from when he tells it, or nothing where he does."""
    sentence, story = row["first_event"], account.story
    named = {
        finding_id for words, ids in WORDS.items() if re.search(words, sentence, re.IGNORECASE) for finding_id in ids
    }
    named |= {"crash"} if row["crash"] == "yes" else set()
    named |= {"motor-fault"} if row["motor_at_fault"] else set()
    words = f"read: {sentence[:90]} | here: {account.headline}"
    story_ids = {happening.id for happening in story}
    causes = named & CAUSES
    if not NOTHING.search(sentence) and causes and not causes & story_ids:
        return False, words
    if not story:
        return row["crash"] != "yes", words
    times = [float(time) for time in TIME.findall(sentence)]
    in_time = not times or min(abs((story[0].t or 0.0) - t) for t in times) <= WHEN
    agrees = named >= story_ids and (row["crash"] != "yes" or story[-1].id == "crash")
    return agrees and in_time, words


def failsafes(row: Mapping[str, str], account: Account, flight: Span) -> tuple[bool, str]:
    """Return whether the account has the errors and failsafes that the reader decoded in the flight."""
    read = set()
    for t, subsystem, code in re.findall(r"(\d+\.\d) ERR (\d+)/(\d+)", row["other_events"]):
        if code != "0" and flight.start - 0.5 <= float(t) <= flight.stop + 0.5:
            read.add(COPTER_SUBSYSTEMS.get(int(subsystem), subsystem))
    for text, subsystem in TEXTS.items():
        for t in re.findall(rf"(\d+\.\d) {text}", row["other_events"]):
            if flight.start - 0.5 <= float(t) <= flight.stop + 0.5:
                read.add(COPTER_SUBSYSTEMS[subsystem])
    ours = {
        str(happening.evidence["subsystem"])
        for happening in account.notable
        if happening.id in ("failsafe", "autopilot-error")
        and happening.evidence["subsystem"] in COPTER_SUBSYSTEMS.values()
    }
    return ours == read, f"{sorted(read) or 'none'} read, {sorted(ours) or 'none'} here"


def battery(row: Mapping[str, str], account: Account) -> tuple[bool, str]:
    """Return whether the voltages agree to 0.15 V or 1.5 %, or both say that none was measured."""
    read = [number(row, f"battery_{name}_V") for name in ("start", "end", "min")]
    if all(voltage is None for voltage in read):
        return account.battery is None, f"none read, {account.battery} here"
    if account.battery is None:
        return False, f"{read} read, none here"
    ours = [account.battery.start, account.battery.end, account.battery.lowest]
    agrees = all(a is None or abs(a - b) <= max(0.15, 0.015 * a) for a, b in zip(read, ours, strict=True))
    return agrees, f"{read} V read, {[round(voltage, 2) for voltage in ours]} V here"


def compare_all(readings: Path, folder: Path) -> tuple[Counter[str], Counter[str], list[str]]:
    """Return by quantity how many readings agree, how many there are, and every disagreement in a line."""
    with readings.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file, delimiter="\t"))
    agree, total, lines = Counter[str](), Counter[str](), []

    def count(name: str, flight: str, agrees: bool, words: str) -> None:
        total[name] += 1
        agree[name] += agrees
        if not agrees:
            lines.append(f"{name}: {flight}: {words}")

    for file_name, here in itertools.groupby(rows, key=lambda row: row["file"]):
        of_file = list(here)
        flown = [row for row in of_file if row["flight"] != "0"]
        try:
            candidates = found_flights(folder / file_name)
        except (OSError, logparse.RotoridError) as error:
            lines.append(f"unread: {file_name}: {error}")
            continue
        pairs = list(paired(flown, candidates))
        for row, pair in pairs:
            flight = f"{file_name} flight {row['flight']}"
            if row["sure"] not in ("high", "medium"):
                continue
            if pair is None and PLANE.search(row["note"]):
                lines.append(f"left out: {flight}: {row['note'][:60]}")
            elif pair is None:
                count("flights", flight, False, f"{row['takeoff_s']}-{row['landing_s']} s read, not found")
            else:
                for name, agrees, words in compare(row, pair):
                    count(name, flight, agrees, words)
        # Of a log whose reader was not sure where it flew nothing is invented.
        if not any(row["sure"] == "low" for row in of_file):
            for candidate in candidates:
                if all(candidate is not paired_with for _, paired_with in pairs):
                    count(
                        "flights",
                        file_name,
                        False,
                        f"invented, {candidate.flight.start:.1f}-{candidate.flight.stop:.1f} s",
                    )
    return agree, total, lines


def main(given: list[str]) -> int:
    """Compare and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks real_logs", description=__doc__)
    shared = Path("../shared/logs/real")
    parser.add_argument("--readings", type=Path, default=shared / "readings.tsv")
    parser.add_argument("--logs", type=Path, default=shared)
    options = parser.parse_args(given)
    if not options.readings.exists():
        parser.error(f"there are no readings at {options.readings}")
    agree, total, lines = compare_all(options.readings, options.logs)
    for name in NAMES:
        print(f"{name}: {agree[name]} of {total[name]}")
    print("\n".join(lines))
    return 0
