"""What generalises: the protocol of Elhesasy 2024 (Table 4) on flights of genuine firmware in the loop, for all inputs.

Three flights are fitted jointly and others of the same craft are foretold, from motor outputs, mixer commands, rate
controller outputs and references; then one octocopter mission is fitted from its references and held against every
other flight.
"""

import numpy as np

from benchmarks._measure import SITL, Row, listed, row, sitl_flight, timed
from sysid import Experiment, Validation, fit_closed_loop, fit_transfer_functions, validate

FITTED, HELD_OUT = ("paper01", "paper02", "paper03"), ("paper04", "paper05", "paper06")
#: A mission, and missions and stick flights of the same airframe family.
MISSION = "octa01_auto_calm"
OTHERS = ("octa02_auto_wind2", "octa05_auto_quito", "octa07_loiter_sticks", "octa09_systemid_mixer", *FITTED, *HELD_OUT)
#: Input set and frame of each table; references have one frame only.
SETS = tuple((inputs, frame) for inputs in ("motors", "mixer", "rate_outputs") for frame in ("earth", "heading"))
BASELINES = ["rmse_mean", "rmse_constant_position", "rmse_constant_velocity", "rmse_reference"]


def record(name: str, inputs: str, frame: str = "earth") -> Experiment:
    return Experiment.from_flight(*sitl_flight(name), inputs=inputs, frame=frame, name=name)


def black_box(inputs: str, frame: str) -> tuple[Validation, float]:
    """Fit some flights jointly with 5 poles and 3 zeros and judge on others; gives CPU seconds of the fit too."""
    seen = [record(name, inputs, frame) for name in FITTED]
    model, seconds = timed(lambda: fit_transfer_functions(seen, 5, 3, "common", time_limit=120.0))
    return validate(model, [*seen, *(record(name, inputs, frame) for name in HELD_OUT)]), seconds


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
    for inputs, frame in (*SETS, ("reference", "earth")):
        validation, seconds = black_box(inputs, frame)
        held_out = validation.table[~validation.table["trained"]].groupby("output")[["rmse", *BASELINES]].mean()
        ours, best = held_out["rmse"], held_out[BASELINES].min(axis=1)
        what = f"paper01-03 -> 04-06, {inputs}, {frame} frame, 5/3 common: free run of {', '.join(ours.index)}"
        text, peer = f"{listed(ours)} m, {seconds:.1f} s", f"{listed(best)} m (no model)"
        rows.append(row(what, text, peer, float((ours / best).max()), "ratio < 0.95"))
    gain, expected = thrust_gain()
    what, peer = "climb per thrust at 2 rad/s, fitted to paper01-03", f"{expected:.1f} m/s^2 (g over hover)"
    rows.append(row(what, f"{gain:.1f} m/s^2", peer, gain / expected, "1 within 5 %"))
    model = fit_closed_loop([record(MISSION, "reference")])
    table = validate(model, [record(name, "reference") for name in OTHERS]).table
    worst, plain = (table.groupby("output")[name].max() for name in ("rmse", "rmse_reference"))
    what = f"{MISSION} -> {len(OTHERS)} other calm or light-wind flights, closed loop: worst RMSE"
    peer = f"{listed(plain)} m (reference itself)"
    rows.append(row(what, f"{listed(worst)} m", peer, float((worst / plain).max()), "0.10 0.10 0.06 m"))
    return rows
