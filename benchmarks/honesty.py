"""Every number that is stated with a sigma against known truth: firmware in the loop, and simulated gusts.

Flights with the firmware in the loop are read from ../shared/logs/sitl and ../shared/logs/pairs where these are, with
the truth beside them. A row has the root mean square and the largest of z = (value - truth) / sigma.

`python -m benchmarks honesty --halves DIR` holds the halves of every flight in a folder of real logs against each other
instead: a row has chi-square over degrees of freedom of what they differ by, and the flight where that is largest. What
both halves share (air, motors, the curve in the parameters where methods go by it) does not count.
"""

from __future__ import annotations

import itertools
import json
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks._measure import Row, logs
from estimation import Trajectory, estimate
from logparse import FlightLog, MissingDataError, RotoridError, read_flights, read_log
from pipeline.flight.account import account_of_flight
from pipeline.results.span import Span
from simulation.elhesasy2024 import octocopter, quadcopter
from simulation.kim2017 import quadcopter as kim_quadcopter
from simulation.mission import Mission
from simulation.place import Wind
from sysid import Experiment, fit_rigid_body, fit_six_dof, physical_parameters
from sysid.frequency.survey import survey
from sysid.records.thrust_curve import reference_voltage
from sysid.rigid_body.six_dof.body_record import BodyQuantity
from sysid.rotors.thrust_regression import vehicle_of
from tests.sysid.craft_flights import EXCITING, HOVER, flown, record
from tests.sysid.honesty import (
    Stated,
    firmware_truth,
    hover_part,
    simulated_truth,
    stated_by_body,
    stated_side_by_side,
    table,
)
from tests.sysid.six_dof.papers import measured, stated

#: Of every row: root mean square and largest of z.
TARGET = "1.3, 4"

#: Mean wind, m/s, and factor on Dryden's intensity.
WINDS = ((3.0, 1.0), (6.0, 1.5), (9.0, 1.0))
SEEDS = 3

#: Shortest half of a flight, s.
SHORTEST_HALF = 20.0

#: Numbers that go with the square of the battery's voltage, which is each half's own.
AT_VOLTAGE = ("thrust", "thrust over mass", "thrust over mass at hover", "yaw torque over inertia")


class Number(NamedTuple):
    """What half a flight says of a number."""

    value: float
    sigma: float
    curve: float = 0.0  #: Part of the standard error by the thrust curve in the parameters, which halves share.

    def over(self, unit: float) -> Number:
        """Return the number in other units."""
        return Number(self.value / unit, self.sigma / unit, self.curve / unit)

    def apart_from(self, other: Number) -> float:
        """Return how far it is from the number of the other half, in standard errors."""
        own = (float(np.sqrt(max(number.sigma**2 - number.curve**2, 0.0))) for number in (self, other))
        return (self.value - other.value) / float(np.linalg.norm([*own, self.curve - other.curve]))


#: By method and name.
Half = dict[tuple[str, str], Number]

#: Flights of each craft and kind of input for the body with six degrees of freedom.
PAPER_FLIGHTS = 10


def run() -> list[Row]:
    if "--halves" in sys.argv[:-1]:
        return halves(Path(sys.argv[sys.argv.index("--halves") + 1]))
    return [
        *_rows("gusts", simulated(EXCITING)),
        *_rows("hovers in gusts", simulated(HOVER)),
        *_rows("papers", papers()),
        *_rows("firmware", firmware()),
    ]


def papers() -> Iterator[Stated]:
    """Fly the papers' craft, measured by motion capture, for the body with six degrees of freedom."""
    for craft in (octocopter(), kim_quadcopter(), quadcopter()):
        for quantity in (BodyQuantity.SPEED, BodyQuantity.PWM):
            for seed in range(PAPER_FLIGHTS):
                seen = measured(craft, seed, quantity)
                model = fit_six_dof(seen, mass=craft.mass, indoors=True, most_runs=800)
                yield from stated(model, craft, f"{craft.name} {seed}")


def _rows(kind: str, stated: Iterator[Stated]) -> Iterator[Row]:
    for method, parameter, count, rms, most, error, sigma, worst in table(list(stated)):
        label = f"{kind}: {method}, {parameter} ({count})"
        yield label, f"{rms:.2f}, {most:.1f}", f"error {error:.2g}, sigma {sigma:.2g}", worst, TARGET


def simulated(mission: Mission) -> Iterator[Stated]:
    """Fly two craft in gusts."""
    for craft in (octocopter(), quadcopter()):
        for speed, gusts in WINDS:
            for seed in range(SEEDS):
                wind = Wind(speed=speed, from_deg=120.0 * seed, gusts=gusts)
                flight = flown(craft, mission, wind=wind, altitude=300.0 * seed, seed=seed)
                seen = record(flight, np.random.default_rng(seed), 0.05, f"{craft.name} {speed:g} {gusts:g} {seed}")
                blown = flight.truth.loc[seen.t[0] : seen.t[-1], ["wind_n", "wind_e"]].mean()
                model = fit_rigid_body([seen], mass=craft.mass)
                truth = simulated_truth(craft, model.reference_voltage, (blown["wind_n"], blown["wind_e"]))
                yield from stated_by_body(model, seen, truth)


def firmware() -> Iterator[Stated]:
    """Read every flight whose truth is known."""
    for packed, path in logs("sitl/*.BIN", "pairs/*.BIN.xz"):
        name = path.stem
        facts = json.loads((packed.parent / f"{name}.json").read_text())
        try:
            log = read_log(path)
            seen = Experiment.from_flight(log, estimate(log.tables), rate=50.0, name=name)
        except MissingDataError:  # a craft at the edge of its loops, whose trajectory is withdrawn
            continue
        mass, arm = facts["truth"]["mass_kg"], facts["truth"]["arm_length_m"]
        model = fit_rigid_body([seen], mass=mass)
        truth = firmware_truth(facts, seen, model.reference_voltage, rotor_drag=model.rotor_drag)
        yield from stated_by_body(model, seen, truth)
        parameters = physical_parameters([seen], mass, arm=arm, rigid_body=model)
        yield from stated_side_by_side(parameters, seen, truth)


def halves(folder: Path) -> list[Row]:
    """Hold the halves of every flight in a folder against each other: chi-square over degrees of freedom by number."""
    apart: dict[tuple[str, str], dict[str, float]] = {}
    for path in sorted(file for file in folder.iterdir() if file.suffix not in (".md", ".tsv")):
        with suppress(OSError, RotoridError):
            for log in read_flights(path):
                if log.flight is None or log.flight.duration < 2.0 * SHORTEST_HALF:
                    continue
                try:
                    trajectory = estimate(log.tables)
                except RotoridError:
                    trajectory = None
                flown = Span(log.flight.start, log.flight.stop)
                sound = account_of_flight(log, flown).sound or flown
                ends = np.linspace(sound.start, sound.stop, 3)
                one, other = (stated_within(log, trajectory, within) for within in itertools.pairwise(ends))
                for key in one.keys() & other.keys():
                    apart.setdefault(key, {})[f"{path.name} {log.flight.start:.0f} s"] = one[key].apart_from(other[key])
    rows = []
    for (method, name), distances in sorted(apart.items()):
        farthest = max(distances, key=lambda flight: abs(distances[flight]))
        chi2 = float(np.mean(np.square(list(distances.values()))))
        rows.append(
            (f"{method}: {name} ({len(distances)})", f"{chi2:.2f}", f"{distances[farthest]:.1f}", farthest, "0.5-1.5")
        )
    return rows


def stated_within(log: FlightLog, trajectory: Trajectory | None, within: tuple[float, float]) -> Half:
    """List what a part of a flight states of its craft, motors as at one volt: the battery of the other is another."""
    half: Half = {}
    for axis in survey(log, within=within).axes:
        numbers = {} if axis.fit is None else dict(axis.fit.parameters)
        if axis.attitude is not None:
            numbers |= {"bandwidth": axis.attitude.bandwidth, "phase delay": axis.attitude.phase_delay}
        half |= {
            (axis.axis, name): Number(number.value, number.sigma)
            for name, number in numbers.items()
            if number.value is not None and number.sigma
        }
    with suppress(RotoridError):
        if trajectory is None:
            return half
        seen = Experiment.from_flight(log, trajectory, rate=50.0, within=within)
        if seen.t[-1] - seen.t[0] < SHORTEST_HALF:
            return half
        try:
            body = fit_rigid_body(seen)
        except RotoridError:
            body = None
        for name, parameter in () if body is None else body.parameters.items():
            if parameter.value is not None and parameter.sigma:
                half["body", name] = Number(parameter.value, parameter.sigma)
        for (method, name), row in physical_parameters(seen, rigid_body=body).table.swaplevel().iterrows():
            if np.isfinite([row["value"], row["sigma"]]).all() and row["sigma"] > 0.0:
                half[method, name] = Number(row["value"], row["sigma"], row["curve"])
        volts = reference_voltage([seen]) or 1.0
        for key in [key for key in half if key[1] in AT_VOLTAGE]:
            # The command flown on average, too, is each half's own.
            unit = volts**2 * (hover_part(seen, vehicle_of(seen)[0].thrust_expo) if "hover" in key[1] else 1.0)
            half[key] = half[key].over(unit)
    return half
