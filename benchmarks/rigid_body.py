"""The rigid body from flight: accuracy on craft of known truth, prediction, the core paper's protocol, speed.

Flights with the firmware in the loop are read from ../shared/logs/sitl where that folder is.
"""

import json
from functools import cache

import numpy as np

from benchmarks._measure import SITL, Row, listed, row, sitl_flight, timed
from simulation.elhesasy2024 import octocopter
from sysid import Experiment, fit_rigid_body, validate
from tests.sysid.craft_flights import exciting, record
from tests.sysid.honesty import firmware_truth, simulated_truth

NOT_HERE = "no logs"


def run() -> list[Row]:
    return [*simulated(), *firmware(), *paper_protocol()]


def simulated() -> list[Row]:
    """Fit the octocopter: worst error of what is determined, and the time that it takes."""
    seen, craft = record(exciting(50.0), np.random.default_rng(1)), octocopter()
    fit_rigid_body([seen.window(seen.t[0], seen.t[0] + 20.0)])  # compiles
    model, seconds = timed(lambda: fit_rigid_body([seen], mass=craft.mass))
    judged = ("thrust", "drag", "roll_gain", "pitch_gain")
    stated = simulated_truth(craft, model.reference_voltage, (0.0, 0.0)).parameters
    truth = {name: value for name, value in stated.items() if name.startswith(judged)}
    errors = {n: model.value(n) / v - 1.0 for n, v in truth.items() if model.parameters[n].determined}
    worst = max(errors, key=lambda n: abs(errors[n]))
    sigmas = {n: abs(model.value(n) - truth[n]) / model.parameters[n].sigma for n in errors}
    farthest = max(sigmas, key=lambda n: sigmas[n])
    minutes = seen.duration / 60.0
    return [
        row("simulated octocopter: worst error", f"{100 * errors[worst]:.1f} % ({worst})", goal="3 %"),
        row("simulated octocopter: farthest", f"{sigmas[farthest]:.1f} sigma ({farthest})", goal="2 sigma"),
        row(f"full rigid body, {minutes:.1f} min at 50 Hz, CPU s", f"{seconds:.2f}", goal="< 0.5"),
    ]


@cache
def flight(name: str) -> Experiment:
    return Experiment.from_flight(*sitl_flight(name), rate=50.0)


def firmware() -> list[Row]:
    """Judge parameters on flights of known truth from sea level to 2850 m, and prediction on others."""
    if not SITL.is_dir():
        return [row("firmware in the loop", NOT_HERE)]
    rows = []
    for names in (("octa07_loiter_sticks",), ("octa09_systemid_mixer",), ("octa01_auto_calm", "octa05_auto_quito")):
        facts = json.loads((SITL / f"{names[0]}.json").read_text())
        flown = [flight(name) for name in names]
        model = fit_rigid_body(flown, mass=facts["truth"]["mass_kg"])
        truth = firmware_truth(facts, flown[0], model.reference_voltage).parameters
        hover, true_hover = (
            values["thrust"] * (0.55 - 0.2475 * values["thrust_expo"])
            for values in ({name: model.value(name) for name in ("thrust", "thrust_expo")}, truth)
        )
        label = ", ".join(names)
        rows.append(row(f"{label}: thrust at hover command", f"{100 * (hover / true_hover - 1):+.2f} %", goal="2 %"))
        gains = (_off(model.parameters[name].value, truth[name]) for name in ("roll_gain", "pitch_gain"))
        rows.append(row(f"{label}: effectiveness of roll, pitch", ", ".join(gains), goal="5 %"))
        drag = truth["drag_linear_x"] * 4.0 + truth["drag_quadratic_x"] * 16.0
        known = {axis: model.parameters[f"drag_quadratic_{axis}"].determined for axis in "xyz"}
        drags = (_off(model.drag(axis, 4.0)[0] if known[axis] else None, drag) for axis in "xyz")
        rows.append(row(f"{label}: drag along x, y, z at 4 m/s", ", ".join(drags), goal="15 %"))
    model = fit_rigid_body([flight("octa01_auto_calm"), flight("octa07_loiter_sticks")])
    result = validate(model, [flight("octa02_auto_wind2"), flight("octa05_auto_quito")], horizons=(1.0, 5.0))
    for horizon, target in ((1.0, "0.03 m"), (5.0, "0.35 m")):
        part = result.horizons[result.horizons["horizon"] == horizon]
        ratio = (part["rmse_constant_velocity"] / part["rmse"]).min()
        rows.append(
            (
                f"{horizon:g} s ahead on other flights, worst axis",
                f"{part['rmse'].max():.3f} m",
                f"{part['rmse_constant_velocity'].max():.2f} m (constant velocity)",
                f"{ratio:.0f} x at least",
                target,
            )
        )
    return rows


def _off(value: float | None, truth: float) -> str:
    """Return how far a value is off the truth, in words."""
    return "not determined" if value is None else f"{100 * (value / truth - 1.0):+.1f} %"


def paper_protocol() -> list[Row]:
    """Fit three flights of the core paper's protocol, run freely over every other flight of it."""
    if not SITL.is_dir():
        return [row("core paper's protocol", NOT_HERE)]
    model = fit_rigid_body([flight(f"paper0{k}") for k in (1, 2, 3)])
    others = [flight(path.stem) for path in sorted(SITL.glob("paper*.BIN")) if path.stem[-2:] not in ("01", "02", "03")]
    rows = []
    for seconds, what in ((None, "whole flight"), (30.0, "first 30 s")):
        average = validate(model.trimmed(others, seconds=seconds), others, horizons=()).average
        numbers = listed(average[axis] for axis in "xyz")
        label = f"paper protocol, {len(others)} flights, wind and thrust scale from {what}: RMSE x, y, z"
        rows.append(
            row(
                label,
                f"{numbers} m",
                peer="Elhesasy 2024, own flights",
                goal="0.32, 0.27, 0.25 m" if not seconds else "-",
            )
        )
    return rows
