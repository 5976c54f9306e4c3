"""Every number that is stated with a sigma against known truth: firmware in the loop, and simulated gusts.

Flights with the firmware in the loop are read from ../shared/logs/sitl and ../shared/logs/pairs where these are, with
the truth beside them. A row has the root mean square and the largest of z = (value - truth) / sigma.
"""

import json
from collections.abc import Iterator

import numpy as np

from benchmarks._measure import Row, logs
from estimation import estimate
from logparse import MissingDataError, read_log
from simulation.elhesasy2024 import octocopter, quadcopter
from simulation.kim2017 import quadcopter as kim_quadcopter
from simulation.place import Wind
from sysid import Experiment, fit_rigid_body, fit_six_dof, physical_parameters
from sysid.rigid_body.six_dof.body_record import Quantity
from tests.sysid.flown_craft import flown, record
from tests.sysid.honesty import (
    Stated,
    firmware_truth,
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

#: Flights of each craft and kind of input for the body with six degrees of freedom.
PAPER_FLIGHTS = 10


def run() -> list[Row]:
    return [*_rows("gusts", simulated()), *_rows("papers", papers()), *_rows("firmware", firmware())]


def papers() -> Iterator[Stated]:
    """Fly the papers' craft, measured by motion capture, for the body with six degrees of freedom."""
    for craft in (octocopter(), kim_quadcopter(), quadcopter()):
        for quantity in (Quantity.SPEED, Quantity.PWM):
            for seed in range(PAPER_FLIGHTS):
                seen = measured(craft, seed, quantity)
                model = fit_six_dof(seen, mass=craft.mass, indoors=True, most_runs=800)
                yield from stated(model, craft, f"{craft.name} {seed}")


def _rows(kind: str, stated: Iterator[Stated]) -> Iterator[Row]:
    for method, parameter, count, rms, most, error, sigma, worst in table(list(stated)):
        label = f"{kind}: {method}, {parameter} ({count})"
        yield label, f"{rms:.2f}, {most:.1f}", f"error {error:.2g}, sigma {sigma:.2g}", worst, TARGET


def simulated() -> Iterator[Stated]:
    """Fly two craft in gusts."""
    for craft in (octocopter(), quadcopter()):
        for speed, gusts in WINDS:
            for seed in range(SEEDS):
                wind = Wind(speed=speed, from_deg=120.0 * seed, gusts=gusts)
                flight = flown(craft, wind=wind, altitude=300.0 * seed, seed=seed)
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
        found = physical_parameters([seen], mass, arm=arm, rigid_body=model)
        yield from stated_side_by_side(found, seen, truth)
