"""Flights of others with ground truth: published protocols and rows.

`python -m benchmarks real_flights [--data DIR]`. DIR (default ../shared/bench) has the folders of `PARTS`, or the files
of one of them. Flights that are named as test flights (melon; other controllers than indi; runs other than 1; coaxial
flights that are not in ../shared/bench) are judged, after training on all others there, or in ../shared/bench where DIR
has none; without test flights one kind is left out at a time.
"""

import lzma
import re
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml
from scipy.ndimage import binary_erosion
from scipy.signal import butter, lfilter, sosfiltfilt

from benchmarks._measure import SHARED, Row, listed, row
from logparse import RotoridError
from sysid import Experiment, SixDofModel, estimate_trim, estimate_wind, fit_six_dof
from sysid.frequency import fit, response
from sysid.rigid_body.model_record import BodyParameter
from sysid.rigid_body.six_dof.body_record import BodyRecord
from sysid.rigid_body.six_dof.learning import choose_observer, learn_correction
from sysid.rigid_body.six_dof.shooting import state_errors

SETS = SHARED / "bench"

#: Samples of the published protocol.
STEPS = 50

NANODRONE, NEURAL_FLY, TAILSITTER, X8_COAXIAL, PX4_SITL = yaml.safe_load(
    Path(__file__).with_suffix(".yaml").read_text()
).values()

#: Wind of neural-fly by the name of the flight, m/s along -x.
WINDS = {"nowind": 0.0, "35wind": 4.2, "50wind": 6.1, "70wind": 8.5, "100wind": 12.1}


def data_folder() -> Path:
    """Folder after --data on the command line."""
    return Path(sys.argv[sys.argv.index("--data") + 1]) if "--data" in sys.argv[:-1] else SETS


def run() -> list[Row]:
    """Judge all sets; say which are missing."""
    folder = data_folder()
    rows: list[Row] = []
    for name, (suffix, part) in PARTS.items():
        files, spare = (sorted(directory.glob(f"*{suffix}")) for directory in (_folder(folder, name), SETS / name))
        if files or (folder == SETS and spare):
            rows += part(files, spare)
        elif folder == SETS:
            rows.append(row(name, f"no *{suffix} in {folder / name}"))
    if not any("no *" not in entry[1] for entry in rows):
        raise SystemExit(f"no flights of {', '.join(PARTS)} in {folder}")
    return rows


def _folder(folder: Path, name: str) -> Path:
    return folder / name if (folder / name).is_dir() else folder


# nanodrone ---------------------------------------------------------------------------------------------------------


def low_pass(values: np.ndarray, cut: float, rate: float = 100.0) -> np.ndarray:
    return sosfiltfilt(butter(4, cut / (rate / 2.0), output="sos"), values, axis=0)


def nanodrone_table(path: Path) -> pd.DataFrame:
    """Read a flight without gaps, and without the spikes of its motor telemetry (above 300,000 or by 100,000)."""
    table = pd.read_parquet(path).bfill().ffill()
    speeds = table[NANODRONE["motors"]["columns"]]
    return table.assign(**speeds.mask((speeds > 3e5) | (speeds.diff().abs() > 1e5)).interpolate().bfill())


def nanodrone_record(path: Path) -> Experiment:
    """One flight as the published protocol prepares it."""
    table = nanodrone_table(path)
    place, velocity, rates = NANODRONE["position"], NANODRONE["velocity"], NANODRONE["rates"]
    for names, cut in ((place, 10.0), (velocity, 18.0), (rates, 18.0), (NANODRONE["motors"]["columns"], 20.0)):
        table[names] = low_pass(table[names].to_numpy(np.float64), cut)
    return Experiment.from_table(table, NANODRONE, name=path.stem)


Predictor = Callable[[BodyRecord, np.ndarray, np.ndarray], np.ndarray]


def score(record: BodyRecord, predict: Predictor) -> np.ndarray:
    """Return the sums over 50 steps of the mean errors of position, velocity, attitude and body rate."""
    starts, marks = np.arange(len(record.t) - STEPS), np.arange(1, STEPS + 1)
    errors = state_errors(predict(record, starts, marks), record.states[starts[:, None] + marks])
    return np.linalg.norm(errors.reshape(len(starts), STEPS, 4, 3), axis=-1).mean(axis=0).sum(axis=0)


def held(record: BodyRecord, starts: np.ndarray, marks: np.ndarray) -> np.ndarray:
    """Naive: the state stays."""
    return np.repeat(record.states[starts][:, None], len(marks), axis=1)


def published_physics(record: BodyRecord, starts: np.ndarray, marks: np.ndarray) -> np.ndarray:
    """Predict as the benchmark's physics does when its code is run: K_t of its stand, 45 g, and body rates that stay.

    Its angular acceleration is multiplied by zero (identification/models.py, commit e5525de), which is why its body
    rates err as the naive ones do.
    """
    dt, out = 0.01, np.empty((len(starts), len(marks), 18))
    state = record.states[starts].copy()
    rotation, rates = state[:, 6:15].reshape(-1, 3, 3), state[:, 15:]
    angle = np.linalg.norm(rates, axis=1)[:, None, None] * dt
    x, y, z = (rates / np.maximum(np.linalg.norm(rates, axis=1, keepdims=True), 1e-12)).T
    zero = np.zeros_like(x)
    skew = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    for step in range(len(marks)):
        pull = 3.72e-8 * (record.inputs[starts + step] ** 2).sum(axis=1) / 0.045
        half = rotation @ (np.eye(3) + np.sin(angle / 2) * skew + (1 - np.cos(angle / 2)) * skew @ skew)
        acceleration = -half[:, :, 2] * pull[:, None] + np.array([0.0, 0.0, 9.81])
        state[:, :3] += dt * state[:, 3:6] + 0.5 * dt**2 * acceleration
        state[:, 3:6] += dt * acceleration
        rotation = rotation @ (np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * skew @ skew)
        out[:, step], out[:, step, 6:15] = state, rotation.reshape(-1, 9)
    return out


def _sums(name: str, values: np.ndarray, peer: str, target: str) -> Row:
    return row(
        f"nanodrone: {name}: position, velocity, attitude, rate",
        f"{listed(values)}; sum {values.sum():.2f}",
        peer=peer,
        goal=target,
    )


PUBLISHED = {
    "naive": "17.79, 38.92, 8.21, 29.09; sum 94.0 (published, melon)",
    "physics": "2.322, 10.623, 5.101, 29.087; sum 47.13 (published, melon); 46.63 recomputed",
    "best network": "GRU 2.383, 9.144, 5.096, 24.28; sum 40.90 (third party, GPU, melon)",
}


def nanodrone(files: list[Path], spare: list[Path]) -> list[Row]:
    test = [path for path in files if path.name.startswith("melon")]
    training = [path for path in files if path not in test] or [p for p in spare if not p.name.startswith("melon")]
    records = {path: nanodrone_record(path) for path in [*training, *test]}
    if test:
        return _nanodrone_fold("melon (test)", [records[p] for p in training], [records[p] for p in test])
    rows: list[Row] = []
    kinds = sorted({path.name.split("_")[0] for path in training})
    for kind in kinds:
        out = [records[p] for p in training if p.name.startswith(kind)]
        rows += _nanodrone_fold(f"{kind} left out", [r for r in records.values() if r not in out], out)
    return rows


def _nanodrone_fold(label: str, training: Sequence[Experiment], test: Sequence[Experiment]) -> list[Row]:
    began = time.process_time()
    model = fit_six_dof(training, mass=0.045, indoors=True)
    seconds = time.process_time() - began
    bodies = [model.record(record) for record in test]

    def mean(predict: Predictor) -> np.ndarray:
        return np.mean([score(body, predict) for body in bodies], axis=0)

    ours = f"{label}: ours, six degrees of freedom ({seconds:.0f} s CPU)"
    rows = [
        _sums(f"{label}: naive", mean(held), PUBLISHED["naive"], "-"),
        _sums(f"{label}: published physics", mean(published_physics), PUBLISHED["physics"], "-"),
        _sums(ours, mean(model.ahead), PUBLISHED["best network"], "40.0, then 38 on melon"),
    ]
    began = time.process_time()
    corrected = learn_correction(model, training, STEPS * bodies[0].dt, ridge=1e-4)
    seconds += time.process_time() - began
    learned = f"{label}: ours with learned correction ({seconds:.0f} s CPU)"
    rows.append(_sums(learned, mean(corrected.ahead), "-", "1.90, 8.9, 5.05, 24.3 on melon"))
    return rows


# neural-fly --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Tunnel:
    """One flight in the wind tunnel."""

    path: Path
    controller: str
    wind: str


def tunnel(path: Path) -> Tunnel | None:
    match = re.fullmatch(r"(.+)_([^_]+)_(nowind|\d+wind|\d+p\d+sint)\.csv\.xz", path.name)
    return Tunnel(path, match[2], match[3]) if match else None


def neural_fly(files: list[Path], spare: list[Path]) -> list[Row]:
    flights = [flight for flight in map(tunnel, files) if flight]
    training = [f for f in flights if f.controller == "indi"] or [
        f for f in map(tunnel, spare) if f and f.controller == "indi"
    ]
    judged = [f for f in flights if f.controller != "indi"]
    records = {f: Experiment.from_table(f.path, NEURAL_FLY) for f in [*training, *judged]}
    # 8.5 m/s is left out of the fit, so that it is interpolated.
    known = [f for f in training if f.wind in WINDS and f.wind != "70wind"]
    if not known or not judged:
        return [row("neural-fly", "no flights of two controllers")]
    began = time.process_time()
    model = fit_six_dof(
        [records[f] for f in known],
        winds={records[f].name: (-WINDS[f.wind], 0.0) for f in known},
        horizons=(0.5, 1.5, 3.0),
        most_runs=1200,
        attitude="measured",
    )
    learned = learn_correction(_blown(model, [records[f] for f in training]), [records[f] for f in training], 1.0, 2.5)
    rows = [row("neural-fly: fit to indi at known winds, CPU s", f"{time.process_time() - began:.0f}", goal="300")]
    trims = {f.controller: estimate_trim(model, records[f]) for f in [*training, *judged] if f.wind == "nowind"}
    for flight in judged:
        record = records[flight]
        label = f"neural-fly: {flight.controller} {flight.wind}"
        tracks = [estimate_wind(model, record)]
        if flight.controller in trims:
            tracks.insert(0, estimate_wind(model, record, trim=trims[flight.controller]))
        if flight.wind in WINDS:
            speed = WINDS[flight.wind]
            texts = [
                f"{-track.mean[0]:.2f} ± {track.mean_sigma[0]:.2f} m/s"
                + (f" ({100 * (-track.mean[0] / speed - 1):+.1f} %)" if speed else "")
                for track in tracks
            ]
            limit = "6 %" if flight.wind == "70wind" else "10 %" if speed else "-"
            rows.append(row(f"{label}: wind", "; not tared ".join(texts), peer=f"{speed} m/s (known)", goal=limit))
        else:
            texts = [f"{_sine_error(track.t, -track.wind[:, 0]):.2f} m/s" for track in tracks]
            what = f"{label}: wind 8.5 + 2.4 sin (t + phase), RMS"
            rows.append(row(what, "; not tared ".join(texts), goal="0.8 m/s"))
        ours, velocity = ahead_errors(_blown(learned, [record]), record, 1.0, 3.0)
        what = f"{label}: position 1 s ahead, attitude measured, learned observer"
        rows.append((what, f"{ours:.3f} m", f"{velocity:.3f} m (constant velocity)", f"{velocity / ours:.1f} x", "8 x"))
    return rows


def _blown(model: SixDofModel, records: Sequence[Experiment]) -> SixDofModel:
    """Model with the wind of the first three seconds of each record, before the first prediction that is judged."""
    winds = {record.name: estimate_wind(model, record[: round(3.0 / record.dt)]).mean for record in records}
    return model.with_wind(winds)


def _sine_error(t: np.ndarray, wind: np.ndarray) -> float:
    """RMS from 8.5 + 2.4 sin (t + phase); the fan's clock is not in the record, so the phase is the one that fits."""
    waves = np.column_stack([np.sin(t), np.cos(t)])
    phase = np.arctan2(*np.linalg.lstsq(waves, wind - wind.mean(), rcond=None)[0][::-1])
    return float(np.sqrt(np.mean((wind - 8.5 - 2.4 * np.sin(t + phase)) ** 2)))


def ahead_errors(model: SixDofModel, record: Experiment, horizon: float, after: float) -> tuple[float, float]:
    """RMS of position errors of the model and of constant velocity, m; by norm."""
    body = model.record(record)
    steps, first = round(horizon / body.dt), round(after / body.dt)
    starts = np.arange(first, len(body.t) - steps)
    truth = body.states[starts + steps, :3]
    predicted = model.ahead(body, starts, np.array([steps]))[:, 0, :3]
    moved = body.states[starts, :3] + horizon * body.states[starts, 3:6]
    return tuple(float(np.sqrt(np.mean(np.sum((positions - truth) ** 2, axis=1)))) for positions in (predicted, moved))


# tailsitter, x8-coaxial --------------------------------------------------------------------------------------------


def tailsitter(files: list[Path], spare: list[Path]) -> list[Row]:
    first = [path for path in files if path.stem.endswith("_1")]
    training = first or [path for path in spare if path.stem.endswith("_1")]
    limit = {"1 s": "0.090, 0.055, 0.140 m", "5 s": "a fifth of constant velocity"}
    return _left_out("tailsitter", TAILSITTER, training, [path for path in files if path not in first], limit)


def x8_coaxial(files: list[Path], spare: list[Path]) -> list[Row]:
    known = {path.name for path in spare}
    test = [path for path in files if path.name not in known] if spare else []
    limit = dict.fromkeys(("1 s", "5 s"), "less than constant velocity")
    return _left_out("x8-coaxial", X8_COAXIAL, spare or files, test, limit)


def _left_out(
    name: str, columns: dict[str, Any], training: list[Path], test: list[Path], limit: dict[str, str]
) -> list[Row]:
    """Judge on the test flights, or on each of the training flights by the model of the others, 1 and 5 s ahead."""
    records = {path: Experiment.from_table(path, columns) for path in [*training, *test]}
    folds = [(training, test)] if test else [([p for p in training if p != out], [out]) for out in training]
    errors: dict[str, list[np.ndarray]] = {}
    for known, judged in folds:
        for attitude in ("measured", "state"):
            model = fit_six_dof(
                [records[p] for p in known],
                mass=columns.get("mass"),
                indoors=True,
                horizons=(0.2, 0.5, 1.0),
                most_runs=1200,
                attitude=attitude,
            )
            for horizon in (1.0, 5.0):
                watching = choose_observer(model, [records[p] for p in known], horizon)
                for path in judged:
                    for what, predictor in (
                        (f"attitude {attitude}", model),
                        (f"attitude {attitude}, observer", watching),
                    ):
                        errors.setdefault(f"{what}, {horizon:g} s", []).append(
                            axis_errors(predictor, records[path], horizon)
                        )
        for path in judged:
            for horizon in (1.0, 5.0):
                errors.setdefault(f"constant velocity, {horizon:g} s", []).append(
                    axis_errors(None, records[path], horizon)
                )
    how = "flights kept aside" if test else "one left out at a time"
    rows = []
    for what, error in sorted(errors.items()):
        rms = np.sqrt(np.mean(np.square(error), axis=0))
        text = f"{listed(rms, '.3f')} m" if np.isfinite(rms).all() else "diverges"
        rows.append(row(f"{name}, {how}: {what}: x, y, z", text, goal=limit[what[-3:]]))
    return rows


def axis_errors(model: SixDofModel | None, record: Experiment, horizon: float) -> np.ndarray:
    """RMS of x, y, z, m; constant velocity without a model."""
    steps, first = round(horizon / record.dt), round(3.0 / record.dt)
    starts = np.arange(first, len(record.t) - steps, 2)
    truth = record.y[starts + steps]
    if model is None:
        velocity = record.context[["v_n", "v_e", "v_d"]].to_numpy()[starts] * np.array([1.0, 1.0, -1.0])
        return np.sqrt(np.mean((record.y[starts] + horizon * velocity - truth) ** 2, axis=0))
    predicted = model.ahead(model.record(record), starts, np.array([steps]))[:, 0, :3] * np.array([1.0, 1.0, -1.0])
    return np.sqrt(np.mean((predicted - truth) ** 2, axis=0))


# px4-sitl ----------------------------------------------------------------------------------------------------------

#: The simulator's x500 with its rotors: mass [kg], thrust of a rotor [N s^2], its arm [m] and torque over thrust [m],
#: inertia [kg m^2]. The suite that is kept aside carries 0.1 kg more.
_MASS, _THRUST, _ARM, _TORQUE = 0.864, 4e-6, 0.174, 0.0125
_INERTIA = {"roll": 0.005 + 0.064 * 0.123**2, "pitch": 0.005 + 0.064 * 0.123**2, "yaw": 0.009 + 0.064 * _ARM**2}
#: What a published identification from the same traces misses.
_PUBLISHED = {"mass": "+25 %", "roll": "-80.6 %", "pitch": "+696 %", "yaw": "-103 %"}


def px4_sitl(files: list[Path], spare: list[Path]) -> list[Row]:
    """Mass and inertia from measured rotor speeds and the thrust of a rotor; of yaw, torque over inertia."""
    model = fit_six_dof([Experiment.from_table(path, PX4_SITL) for path in files or spare], indoors=True)
    rows = [_against("mass", model.parameters["thrust"], _THRUST, _MASS)]
    rows += [
        _against(axis, model.parameters[f"{axis}_gain"], _THRUST * _ARM, _INERTIA[axis]) for axis in ("roll", "pitch")
    ]
    yaw = model.parameters["yaw_gain"]
    text = "not determined: motion shows no torque of a rotor"
    if yaw.si_value is not None and yaw.si_sigma is not None:
        parts = [value * _INERTIA["yaw"] / (_THRUST * _TORQUE) for value in (yaw.si_value, yaw.si_sigma)]
        text += f", and torque over inertia is {parts[0]:.2f} ± {parts[1]:.2f} of the model file's"
    return [*rows, row("px4-sitl: yaw", text, peer=_PUBLISHED["yaw"], goal="5 % or not determined")]


def _against(what: str, parameter: BodyParameter, factor: float, truth: float) -> Row:
    """Return what a parameter makes of `factor` beside the truth."""
    label, text = f"px4-sitl: {what}", f"not determined: {parameter.reason}"
    if parameter.si_value is not None and parameter.si_sigma is not None:
        value, sigma = factor / parameter.si_value, parameter.si_sigma / parameter.si_value
        text = f"{value:.4g} ± {100.0 * sigma:.1f} % ({100.0 * (value / truth - 1.0):+.1f} % of {truth:.4g})"
    return row(label, text, peer=_PUBLISHED[what], goal="5 % or not determined")


# crazyflie ---------------------------------------------------------------------------------------------------------

#: Published from the same logs: thrust of a motor [N] by powers of its command, and inertia [kg m^2]; arm of a motor
#: about roll and pitch, m.
_CRAZYFLIE_THRUST, _CRAZYFLIE_INERTIA = (0.02127, -0.01118, 0.12013), {"roll": 1.029e-5, "pitch": 1.105e-5}
_CRAZYFLIE_ARM = 0.046 / np.sqrt(2.0)

#: Axis of the gyro, and what each motor adds to the torque about it.
_TORQUES = {"roll": ("x", (-1, -1, 1, 1)), "pitch": ("y", (-1, 1, 1, -1)), "yaw": ("z", (-1, 1, -1, 1))}

#: Mean command of motors that fly, and time at either end of flying that does not count, s.
_FLIES, _ENDS = 0.35, 0.3


def crazyflie(files: list[Path], spare: list[Path]) -> list[Row]:
    """Thrust curve and inertia from motors, accelerometer and gyro alone, which no trajectory can be had from."""
    flights = {path.name.split(".")[0]: crazyflie_flight(path) for path in files or spare}
    rows = [row("crazyflie: analyze --columns", "no position and no attitude are logged: no table of a flight")]
    if "log10" in flights:
        rows.append(_crazyflie_thrust(flights["log10"]))
    for axis, name in (("roll", "log15"), ("pitch", "log15"), ("yaw", "log16")):
        if name not in flights:
            continue
        records = _crazyflie_records(flights[name], axis)
        try:
            gain = fit(response(records, axis)).parameters["gain"]
        except RotoridError as error:
            rows.append(row(f"crazyflie: {axis}", f"not determined: {error}"))
            continue
        text = f"not determined: {gain.reason}"
        if axis == "yaw" and gain.value and gain.sigma:  # published with an assumed ratio of torque to thrust
            text = (
                f"inertia over torque per thrust {1.0 / gain.value:.2g} kg m ± {100.0 * gain.sigma / gain.value:.0f} %"
            )
        elif gain.value and gain.sigma:
            text = f"{1.0 / gain.value:.3g} kg m^2 ± {100.0 * gain.sigma / gain.value:.0f} %"
        rows.append(row(f"crazyflie: {axis}", text, peer=str(_CRAZYFLIE_INERTIA.get(axis, "-"))))
    return rows


def crazyflie_flight(path: Path) -> pd.DataFrame:
    """Read a log of Bitcraze's micro-SD deck (version 2, one event) at 1 kHz; commands from 0 to 1, SI units."""
    data = lzma.decompress(path.read_bytes())
    place = data.index(b"\0", 7) + 1  # behind magic byte, version, number of events, and the event's number and name
    count = int.from_bytes(data[place : place + 2], "little")
    *names, rest = data[place + 2 :].split(b"\0", count)
    kinds = {"f": "<f4", "I": "<u4"}
    columns = [(str(name[:-3], "ascii"), kinds[chr(name[-2])]) for name in names]
    whole = np.dtype([("event", "<u2"), ("time", "<u8"), *columns])
    rows = np.frombuffer(rest, whole, len(rest) // whole.itemsize)
    t = np.arange(rows["time"][0], rows["time"][-1], 1000) * 1e-6
    frame = pd.DataFrame({name: np.interp(t, rows["time"] * 1e-6, rows[name]) for name, _ in columns}, index=t)
    motors = frame.filter(like="motor") / 65535.0
    return frame.filter(like="acc").mul(9.80665).join(np.radians(frame.filter(like="gyro"))).join(motors)


def _flying(flight: pd.DataFrame) -> np.ndarray:
    mean = flight.filter(like="motor").mean(axis=1).to_numpy()
    return binary_erosion(mean > _FLIES, iterations=round(1000 * _ENDS))


def _crazyflie_thrust(flight: pd.DataFrame) -> Row:
    """Fit the specific force to powers of the commands behind a motor's lag, below 8 Hz."""
    flying, felt = _flying(flight), low_pass(flight["acc.z"].to_numpy(), 8.0, 1000.0)
    fits = []
    for lag in np.arange(0.02, 0.12, 0.01):
        part = 1.0 - np.exp(-0.001 / lag)
        u = lfilter([part], [1.0, part - 1.0], flight.filter(like="motor").to_numpy(), axis=0)
        powers = np.column_stack([(u**k).sum(axis=1) for k in range(3)])
        x, y = low_pass(powers, 8.0, 1000.0)[flying], felt[flying]
        values, left, *_ = np.linalg.lstsq(x, y, rcond=None)
        fits.append((float(left[0]), lag, values, x, y))
    _, lag, values, x, y = min(fits, key=lambda candidate: candidate[0])
    published = x @ _CRAZYFLIE_THRUST
    mass = float(published @ published / (published @ y))
    at = np.array([0.6, 0.7, 0.8])
    ours, theirs = (1e3 * np.polyval(np.flip(polynomial), at) for polynomial in (mass * values, _CRAZYFLIE_THRUST))
    square = mass * float(x[:, 2] @ y / (x[:, 2] @ x[:, 2]))
    return row(
        "crazyflie: thrust of a motor at 0.6, 0.7, 0.8; square alone",
        f"{listed(ours, '.1f')} mN; {square:.4f} N; lag {lag:.2f} s, for the {1e3 * mass:.1f} g of the published curve",
        peer=f"{listed(theirs, '.1f')} mN; 0.1500 N",
    )


def _crazyflie_records(flight: pd.DataFrame, axis: str) -> list[Experiment]:
    """Return stretches of flying at 100 Hz: torque (thrust difference about yaw) by the published curve, and rate."""
    letter, signs = _TORQUES[axis]
    thrust = np.polyval(np.flip(_CRAZYFLIE_THRUST), flight.filter(like="motor").to_numpy())
    torque = thrust @ np.array(signs) * (1.0 if axis == "yaw" else _CRAZYFLIE_ARM)
    pair = low_pass(np.column_stack([torque, flight[f"gyro.{letter}"]]), 40.0, 1000.0)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], _flying(flight), [False]]).astype(int))).reshape(-1, 2)
    stretches = [pair[first:last:10] for first, last in edges if last - first > 2000]
    names = {"input_names": [axis], "output_names": [f"w_{letter}"]}
    return [Experiment.from_arrays(0.01 * np.arange(len(stretch)), *stretch.T, **names) for stretch in stretches]


#: Sets by the name of their folder: ending of their files, and what judges them.
PARTS: dict[str, tuple[str, Callable[[list[Path], list[Path]], list[Row]]]] = {
    "nanodrone": (".parquet", nanodrone),
    "neural-fly": (".csv.xz", neural_fly),
    "tailsitter": (".mat", tailsitter),
    "x8-coaxial": (".log.xz", x8_coaxial),
    "px4-sitl": (".csv.xz", px4_sitl),
    "crazyflie": ("[0-9].xz", crazyflie),
}
