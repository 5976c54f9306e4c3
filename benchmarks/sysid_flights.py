"""What generalises: the protocol of Elhesasy 2024 (Table 4) on flights of genuine firmware in the loop, for all inputs.

Three flights are fitted jointly and others of the same craft are foretold, from motor outputs, mixer commands, rate
controller outputs and references, in the earth's frame and the heading's, with own and common denominators; then one
octocopter mission is fitted from its references and held against every other flight. `python -m benchmarks
sysid_flights` gives the figures; `python -m benchmarks.sysid_flights` prints whole tables in the form of Table 4.
"""

import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd

from benchmarks._measure import SITL, Row, row, timed
from estimation import Trajectory, estimate
from logparse import FlightLog, read_log
from sysid import Experiment, Validation, fit_closed_loop, fit_transfer_functions, validate
from sysid.records.excitation import examine

FITTED = ("paper01", "paper02", "paper03")
JUDGED = ("paper04", "paper05", "paper06")

#: Missions and stick flights of the same airframe family; the last is gusty and is told, not counted.
MISSION = "octa01_auto_calm"
OCTAS = ("octa02_auto_wind2", "octa05_auto_quito", "octa07_loiter_sticks", "octa09_systemid_mixer")
OTHERS = (*OCTAS, *FITTED, *JUDGED)
GUSTY = "octa03_auto_wind5"

#: Input set and frame of each table; references have one frame only.
SETS = (
    ("motors", "earth"),
    ("motors", "heading"),
    ("mixer", "earth"),
    ("mixer", "heading"),
    ("rate_outputs", "earth"),
    ("rate_outputs", "heading"),
    ("reference", "earth"),
)
STRUCTURES = ("per_input", "common")


@cache
def flight(name: str) -> tuple[FlightLog, Trajectory]:
    log = read_log(SITL / f"{name}.BIN")
    return log, estimate(log.tables)


def record(name: str, inputs: str, frame: str = "earth") -> Experiment:
    return Experiment.from_flight(*flight(name), inputs=inputs, frame=frame, name=name)


def black_box(
    inputs: str, frame: str, structure: str, fitted: Sequence[str] = FITTED, judged: Sequence[str] = JUDGED
) -> tuple[Validation, float]:
    """Fit some flights jointly with 5 poles and 3 zeros and judge on all; gives CPU seconds of the fit too."""
    seen = [record(name, inputs, frame) for name in fitted]
    model, seconds = timed(lambda: fit_transfer_functions(seen, 5, 3, structure, time_limit=120.0))
    return validate(model, [*seen, *(record(name, inputs, frame) for name in judged)]), seconds


def closed_loop(fitted: Sequence[str], judged: Sequence[str]) -> Validation:
    model = fit_closed_loop([record(name, "reference") for name in fitted])
    return validate(model, [record(name, "reference") for name in (*fitted, *judged)])


def table_4(validation: Validation) -> pd.DataFrame:
    """RMSE by flight and axis, then the mean over the flights not fitted, and that of the best baseline."""
    table = validation.table
    form = table.pivot_table(index="flight", columns="output", values="rmse")[list(validation.average)]
    unseen = table[~table["trained"]]
    baselines = ["rmse_mean", "rmse_constant_position", "rmse_constant_velocity", "rmse_reference"]
    mean = unseen.groupby("output")[["rmse", *baselines]].mean().loc[form.columns]
    form.loc["mean of unseen"] = mean["rmse"]
    form.loc["best baseline"] = mean[baselines].min(axis=1)
    return form


def following(names: Sequence[str]) -> pd.DataFrame:
    """RMS of position less reference: what saying "it is where it was told to be" achieves."""
    rows = {name: _rms((exp := record(name, "reference")).y[30:] - exp.u[30:]) for name in names}
    return pd.DataFrame(rows, index=["x", "y", "z"]).T


def altitude_evidence(inputs: str = "mixer") -> pd.DataFrame:
    """Test the skill in z: RMSE with the flight's inputs, with other flights' inputs, and about the trim of the fit."""
    fitted = [record(name, inputs) for name in FITTED]
    judged = [record(name, inputs) for name in JUDGED]
    model = fit_transfer_functions(fitted, 5, 3, "common")
    trim = np.mean([exp.input_trim for exp in fitted], axis=0)
    rows = {}
    for exp in judged:
        others = []
        for other in judged:
            if other is not exp:
                n = min(len(exp.t), len(other.t))
                borrowed = replace(
                    exp, t=exp.t[:n], u=other.u[:n], y=exp.y[:n], input_trim=other.input_trim, context=None
                )
                others.append(_rms((model.simulate(borrowed) - borrowed.y)[30:, 2]))
        rows[exp.name] = {
            "own inputs": _rms((model.simulate(exp) - exp.y)[30:, 2]),
            "borrowed inputs": np.mean(others),
            "trim of the fit": _rms((model.simulate(replace(exp, input_trim=trim)) - exp.y)[30:, 2]),
            "mean of z": np.std(exp.y[30:, 2]),
        }
    return pd.DataFrame(rows).T


def thrust_gain() -> tuple[float, float]:
    """Acceleration per unit of the mixer's thrust at 2 rad/s as fitted, and gravity over the hover's thrust."""
    fitted = [record(name, "mixer") for name in FITTED]
    model = fit_transfer_functions(fitted, 5, 3, "common")
    gain = np.abs(model.transfer_functions["z"]["thrust"].response(np.array([2.0])))[0] * 2.0**2
    return float(gain), 9.81 / float(np.mean([exp.input_trim[0] for exp in fitted]))


def run() -> list[Row]:
    if not SITL.is_dir():
        return [row("flights of firmware in the loop", "shared logs are not here")]
    rows = []
    for inputs, frame in SETS:
        validation, seconds = black_box(inputs, frame, "common")
        means, best = (table_4(validation).loc[row].to_numpy() for row in ("mean of unseen", "best baseline"))
        rows.append(
            (
                f"paper01-03 -> 04-06, {inputs}, {frame} frame, 5/3 common: free run",
                f"{_three(means)} m, {seconds:.1f} s",
                f"{_three(best)} m (no model)",
                f"{np.max(means / best):.2f}",
                "ratio < 0.95",
            )
        )
    evidence = altitude_evidence().mean()
    gain, expected = thrust_gain()
    rows += [
        row(
            "z from mixer commands, unseen flights: own inputs, those of other flights",
            f"{evidence['own inputs']:.2f} m, {evidence['borrowed inputs']:.1f} m",
            peer=f"{evidence['mean of z']:.1f} m (mean)",
            ratio=f"{evidence['own inputs'] / evidence['mean of z']:.2f}",
        ),
        row(
            "the same about the trim of the fitted flights",
            f"{evidence['trim of the fit']:.0f} m",
            peer=f"{evidence['mean of z']:.1f} m (mean)",
            ratio=f"{evidence['trim of the fit'] / evidence['mean of z']:.0f}",
        ),
        (
            "climb per thrust at 2 rad/s, fitted to paper01-03",
            f"{gain:.1f} m/s^2",
            f"{expected:.1f} m/s^2 (g over hover)",
            f"{gain / expected:.2f}",
            "1 within 5 %",
        ),
    ]
    validation = closed_loop([MISSION], OTHERS)
    unseen = validation.table[~validation.table["trained"]]
    worst = unseen.groupby("output")["rmse"].max()
    plain = following(OTHERS).max()
    rows.append(
        (
            f"{MISSION} -> {len(OTHERS)} other calm or light-wind flights, closed loop: worst RMSE",
            f"{_three(worst.to_numpy())} m",
            f"{_three(plain.to_numpy())} m (reference itself)",
            f"{np.max(worst.to_numpy() / plain.to_numpy()):.2f}",
            "0.10 0.10 0.06 m",
        )
    )
    return rows


def tables() -> None:
    """Print every flight of every table."""
    protocol, mission = (FITTED, JUDGED), ((MISSION,), OCTAS)
    for inputs, frame in SETS:
        for structure, flights in (("per_input", protocol), ("common", protocol), ("common", mission)):
            validation, seconds = black_box(inputs, frame, structure, *flights)
            _print(f"{inputs}, {frame} frame, {structure}, {seconds:.1f} s", validation)
        excitation = examine([record(name, inputs, frame) for name in FITTED])
        print(f"\ncondition {excitation.condition:.3g}; {'; '.join(f.reason for f in excitation.findings)}")
    for fitted, judged in (protocol, ((MISSION,), (*OTHERS, GUSTY))):
        _print("closed loop", closed_loop(fitted, judged))


def _print(what: str, validation: Validation) -> None:
    form = table_4(validation)
    print(f"\n{what}\n{form.to_string(float_format='{:.3f}'.format)}", *validation.verdicts, sep="\n- ")


def _rms(error: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(error**2, axis=0))


def _three(values: np.ndarray) -> str:
    return " ".join(f"{value:.3g}" for value in values)


if __name__ == "__main__":
    tables()
    sys.exit(0)
