"""Frequency responses and their fits against truth: firmware in the loop, simulated rate loops, real flights."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.signal import csd, welch

import logparse
from benchmarks._measure import CRAFT, LOGS, SHARED, Row, readable, row, timed, unpacked
from benchmarks.real_flights import nanodrone_table
from logparse import FlightLog
from pipeline.fleet.history import history
from pipeline.fleet.meta_analysis import ALPHA, holm
from pipeline.flight.rotation import turning_of
from pipeline.results.drift import FlightPoint
from simulation.axis_loop import AxisPlant, AxisRun, LoopGains, Shaking, run_axis, write_rate_log
from sysid import Experiment, frequency
from sysid.frequency.structures import low_pass
from sysid.frequency.survey import survey

#: Simulated craft of each kind of flight.
MADE = 20


def run() -> Iterator[Row]:
    """Yield what was measured, row by row."""
    with tempfile.TemporaryDirectory() as folder:
        scratch = Path(folder)
        if LOGS.is_dir():
            yield from _firmware(scratch)
        yield from _made(scratch, sticks=False)
        yield from _made(scratch, sticks=True)
        yield from _histories(scratch)
        yield from _speed(scratch)
        if LOGS.is_dir():
            yield from _real()
        if (SHARED / "bench" / "nanodrone").is_dir():
            yield from _nanodrone()


def _truth(name: str, axis: str, frf: frequency.FrequencyResponse, climb: float) -> tuple[np.ndarray, float]:
    """Return response and gain of a firmware craft, as its truth and the prose beside it state them.

    Damping is that of the simulator, of the motors' momentum drag as they move with the turn, and of their inflow where
    the craft climbs (as it does by 1.5 m/s in SYSTEMID mode); the delay is half a period of the 400 Hz loop.
    """
    truth = json.loads((LOGS / "pairs" / f"{name}_id.json").read_text())["truth"]
    count, mass = truth["num_motors"], truth["mass_kg"]
    density = 0.93 if name == "y6high" else 1.165
    momentum = truth["mdrag_coef_used"] * np.sqrt(density * truth["true_prop_area_per_motor"] * mass * 9.81 / count)
    damping = truth["rotational_damping_per_s"] + 0.5 * count * momentum / (0.0625 * mass)
    inflow = density * truth["effective_prop_area_per_motor"] * max(climb, 0.0)
    damping += 0.5 * count * inflow / (0.0625 * mass)
    gain = truth[f"{axis}_gain_rad_s2_per_unit_sea_level"]
    s = 2j * np.pi * frf.hz
    return gain / (s + damping) * low_pass(frf.hz, frf.gyro_filter_hz) * np.exp(-0.00125 * s), gain


class Compared:
    """Responses of known truth, and their fits: errors at the usable frequencies from 0.5 to 15 Hz."""

    def __init__(self) -> None:
        self.decibels: list[np.ndarray] = []
        self.degrees: list[np.ndarray] = []
        self.coherent: list[float] = []
        self.scores: list[float] = []
        self.costs: list[float] = []

    def add(self, frf: frequency.FrequencyResponse, truth: np.ndarray) -> frequency.FrequencyFit:
        """Compare a response with its truth, and return its fit."""
        band = (frf.hz >= 0.5) & (frf.hz <= 15.0)
        error = np.log(frf.response / truth)[band & frf.usable]
        self.decibels.append(8.686 * np.abs(error.real))
        self.degrees.append(np.degrees(np.abs(error.imag)))
        self.coherent.append(float(np.mean(frf.usable[band])))
        fit = frequency.fit(frf)
        self.costs.append(fit.cost)
        return fit

    def rows(self, kind: str, stated: str) -> Iterator[Row]:
        """Yield what frequencies are near the truth, what is `stated` within twice its sigma, and the fits' costs."""
        near = (np.concatenate(self.decibels) < 1.0) & (np.concatenate(self.degrees) < 5.0)
        share = 100.0 * float(np.mean(np.abs(self.scores) < 2.0))
        yield row(f"{kind}: frequencies within 1 dB and 5 deg (%)", 100.0 * float(np.mean(near)), goal="100")
        yield row(f"{kind}: {stated} (%)", share, goal="90-98")
        yield row(f"{kind}: J median, largest", f"{np.median(self.costs):.1f}, {max(self.costs):.1f}", goal="50, 100")


def _firmware(scratch: Path) -> Iterator[Row]:
    """Compare responses and parameters of six firmware craft with their truth."""
    for kind, target in (("id", "5 %, 5 ms"), ("g1", "5 %, 5 ms"), ("g2", "5 %, 5 ms"), ("sticks", "10 %, 10 ms")):
        compared, gains, delays = Compared(), [], []
        for name in CRAFT:
            log = logparse.read_log(unpacked(LOGS / "pairs" / f"{name}_{kind}.BIN.xz", scratch))
            for axis in ("roll", "pitch"):
                frf = frequency.response(log, axis)
                truth, gain = _truth(name, axis, frf, 0.0 if kind == "sticks" else _climb(log, axis))
                parameters = compared.add(frf, truth).parameters
                known, late = parameters["gain"], parameters["effective_delay"]
                if known.value is not None and known.sigma is not None:
                    gains.append(known.value / gain - 1.0)
                    compared.scores.append(gains[-1] * gain / known.sigma)
                if late.value is not None:
                    delays.append(1e3 * (late.value - 0.00125))
        worst = f"{max(map(np.max, compared.decibels)):.2f} dB, {max(map(np.max, compared.degrees)):.1f} deg"
        errors = f"{100 * np.max(np.abs(gains)):.1f} %, {np.max(np.abs(delays)):.1f} ms"
        coherent = 100.0 * min(compared.coherent)
        yield row(f"firmware, {kind}: worst error where coherent", worst, goal="1 dB, 5 deg")
        yield row(f"firmware, {kind}: least share of 0.5-15 Hz coherent (%)", coherent, goal="90 calm")
        yield row(f"firmware, {kind}: largest error of gain, delay", errors, goal=target)
        yield from compared.rows(f"firmware, {kind}", "gain within 2 sigma")


def _climb(log: FlightLog, axis: str) -> float:
    """Return how fast the craft climbed in the slow part of a chirp, m/s."""
    chirp = next(chirp for chirp in frequency.find_chirps(log) if chirp.axis == axis)
    assert log.tables.truth is not None
    return -float(log.tables.truth["v_d"].loc[chirp.start + 2.0 : chirp.start + 12.0].mean())


def made_craft(number: int, scratch: Path, *, sticks: bool, flight: int = 0) -> tuple[AxisPlant, FlightLog]:
    """Make a rate loop with random gain, damping, lag, delay, filter and, every fourth, a flexible mode."""
    rng = np.random.default_rng(7000 + number)
    kind = number % 4
    flexible = kind == 3 and not sticks
    plant = AxisPlant(
        gain=float(10.0 ** rng.uniform(1.8, 3.0)),
        damping=float(rng.uniform(0.5, 5.0)),
        lag=float(rng.uniform(0.02, 0.07)) if kind else 0.0,
        delay=float(rng.uniform(0.0, 0.008)),
        filter_hz=float(rng.choice([20.0, 40.0, 60.0, 80.0])),
        flex_hz=float(rng.uniform(14.0, 25.0)) if flexible else 0.0,
        flex_damping=float(rng.uniform(0.02, 0.06)),
        flex_share=float(rng.uniform(0.1, 0.4)) if flexible else 0.0,
    )
    excitation = Shaking(
        duration=70.0,
        chirp=(0.4, 40.0, 0.0 if sticks else 25.0 / plant.gain),
        chirp_seconds=69.8,
        gust=float(rng.uniform(0.05, 0.5) if sticks else rng.uniform(0.2, 2.0)),
        noise=float(rng.uniform(0.001, 0.01)),
        stick=0.15 if sticks else 0.0,
    )
    run = run_axis(
        plant, LoopGains.crossing_at(plant, 2.5 if plant.lag else 4.0), excitation, number + 100_000 * flight
    )
    path = scratch / "made.BIN"
    write_rate_log(path, {"roll": run}, rate=50.0 if sticks else 400.0, filter_hz=plant.filter_hz)
    return plant, logparse.read_log(path)


def _made(scratch: Path, *, sticks: bool) -> Iterator[Row]:
    """Compare parameters of simulated craft with their truth."""
    errors: dict[str, list[float]] = {}
    compared = Compared()
    for number in range(MADE):
        plant, log = made_craft(number, scratch, sticks=sticks)
        frf = frequency.response(log, "roll")
        parameters = compared.add(frf, plant.response(frf.hz)).parameters
        late = "effective_delay"
        truth = {"gain": plant.gain, "damping": plant.damping, late: plant.total_delay + plant.lag}
        if plant.lag and "lag" in parameters:
            truth["lag"] = plant.lag
        if plant.flex_hz:
            truth |= {"mode_frequency": 2.0 * np.pi * plant.flex_hz, "mode_damping": plant.flex_damping}
        for name, true in truth.items():
            known = parameters.get(name)
            if known is None or known.value is None or known.sigma is None:
                continue
            label = "delay (ms)" if name == late else f"{name} (%)"
            wrong = known.value - true
            errors.setdefault(label, []).append(1e3 * abs(wrong) if name == late else 100.0 * abs(wrong / true))
            compared.scores.append(wrong / known.sigma)
    kind = "sticks at 50 Hz" if sticks else "chirps"
    targets = {"gain (%)": "10" if sticks else "5", "delay (ms)": "10" if sticks else "5"}
    targets |= {"lag (%)": "" if sticks else "3", "mode_frequency (%)": "3", "mode_damping (%)": "5"}
    for label, values in sorted(errors.items()):
        text = f"{np.median(values):.2f}, {np.percentile(values, 90):.2f}"
        yield row(f"made, {kind}: {label}, median and 90 %, n = {len(values)}", text, goal=targets.get(label, ""))
    yield from compared.rows(f"made, {kind}", f"truth within 2 sigma, n = {len(compared.scores)}")


def _histories(scratch: Path) -> Iterator[Row]:
    """Count craft of which nothing changes, but whose effectiveness or delay over flights is said to."""
    craft, flights, alarms = 30, 8, 0
    for number in range(craft):
        points: dict[str, list[FlightPoint]] = {"effectiveness": [], "delay": []}
        for k in range(flights):
            _, log = made_craft(500 + number, scratch, sticks=True, flight=k + 1)
            with suppress(frequency.FrequencyError):
                known = frequency.fit(frequency.response(log, "roll")).parameters
                for name, estimate in (("effectiveness", known["gain"]), ("delay", known["effective_delay"])):
                    if estimate.value is not None and estimate.sigma is not None:
                        flown = {"flight": str(k), "number": k + 1, "start_utc": None}
                        points[name].append(FlightPoint(value=estimate.value, sigma=estimate.sigma, **flown))
        followed = [history(name, "", {"": point}) for name, point in points.items() if len(point) > 3]
        changes = [change for course in followed for change in (course.trend, course.step) if change is not None]
        alarms += any(p < ALPHA for p in holm([change.p for change in changes]))
    share = f"{alarms} of {craft}"
    yield row(f"craft of {flights} flights, unchanged, whose gain or delay is said to drift or jump", share, goal="5 %")


def _speed(scratch: Path) -> Iterator[Row]:
    """Measure the processor time of a 70 s record at 400 Hz, all axes, beside scipy's cross-spectra by hand."""
    names = ("roll", "pitch", "yaw", "vertical")
    runs, plants = {}, {}
    for k, axis in enumerate(names):
        turning = axis != "vertical"
        plant = AxisPlant(gain=300.0 if turning else 30.0, lag=0.03, integrates=turning)
        magnitude = 0.08 if turning else 0.05
        excitation = Shaking(
            duration=70.0, chirp=(0.4, 40.0, magnitude), chirp_seconds=69.8, sid_axis=10 + k, gust=0.5, noise=0.005
        )
        plants[axis] = plant
        runs[axis] = run_axis(plant, LoopGains.crossing_at(plant, 3.0), excitation, k)
    logs = {}
    for axis, run in runs.items():
        write_rate_log(scratch / f"{axis}.BIN", {axis: run}, rate=400.0)
        logs[axis] = logparse.read_log(scratch / f"{axis}.BIN")
        assert logs[axis].tables.rates is not None
    frequency.fit(frequency.response(logs["roll"], "roll"))  # what is compiled and imported once
    responses, spectra = timed(lambda: {axis: frequency.response(logs[axis], axis) for axis in names})
    _, fits = timed(lambda: [frequency.fit(frf) for frf in responses.values()])
    _, everything = timed(lambda: survey(list(logs.values())))
    plain, peer = timed(lambda: {axis: _by_scipy(run) for axis, run in runs.items()})
    ours = spectra + fits

    def worst(given: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> float:
        """Return what 95 % of the errors of the gain from 0.5 to 15 Hz are below, dB."""
        errors = []
        for axis, (hz, estimate) in given.items():
            band = (hz >= 0.5) & (hz <= 15.0)
            errors.append(np.abs(8.686 * np.log(np.abs(estimate[band] / plants[axis].response(hz[band])))))
        return float(np.percentile(np.concatenate(errors), 95))

    ours_db, peer_db = worst({axis: (frf.hz, frf.response) for axis, frf in responses.items()}), worst(plain)
    what = "all that `rotorid frequency` does with them: checks, coupling, attitude, log by log (s)"
    yield row("70 s at 400 Hz, four axes: responses and fits, CPU (s); scipy.signal.csd", ours, peer, ours / peer, "2")
    yield row("of that the responses (s)", spectra)
    yield row(what, everything, goal="2")
    yield row("95 % of gain errors, 0.5-15 Hz, same records (dB)", ours_db, peer_db, ours_db / peer_db, "1")


def _by_scipy(run: AxisRun) -> tuple[np.ndarray, np.ndarray]:
    """Return frequencies and response by Welch's spectra."""
    hz, cross = csd(run.output, run.measured, 400.0, nperseg=1600)
    return hz, cross / welch(run.output, 400.0, nperseg=1600)[1]


def _real() -> Iterator[Row]:
    """Count real flights with a determined statement."""
    flights = determined = 0
    for path, log in readable("real/*"):
        flight = log.flight
        rates = [_rate(log.tables.attitude), _rate(log.tables.rates)]
        if "plane" in path.name or "rover" in path.name or flight is None or flight.duration < 20.0 or max(rates) < 9.5:
            continue
        flights += 1
        determined += any(turning_of(axis).determined for axis in survey(log).axes)
    yield row(f"real logs with a determined axis, of {flights} (%)", 100.0 * determined / max(flights, 1), goal="70")


def _rate(table: pd.DataFrame | None) -> float:
    return 0.0 if table is None or len(table) < 2 else 1.0 / float(np.median(np.diff(table.index)))


def _nanodrone() -> Iterator[Row]:
    """Identify a nano-quadrotor from motor speeds to body rates, the acceleration of its references as instrument.

    Multisines and random flights ask nothing above 0.55 Hz, where motors work against the moment of the air alone;
    squares reach 3.5 Hz.
    """
    groups = {"multisine": ("multisine",), "square": ("square",), "square and random": ("square", "random1", "random2")}
    folder = SHARED / "bench" / "nanodrone"
    for axis in ("roll", "pitch"):
        for label, kinds in groups.items():
            flights = [path for path in sorted(folder.glob("*.parquet")) if path.name.startswith(kinds)]
            known = regression = top = "not determined"
            with suppress(frequency.FrequencyError):
                frf = frequency.response([_nano_flight(path, axis) for path in flights], axis)
                low = (frf.hz > 0.5) & (frf.hz < 2.0)
                regression = f"{float(np.median((frf.direct * 2j * np.pi * frf.hz).real[low])):.0f}"
                top = f"coherent to {frf.hz[frf.usable][-1]:.2f} Hz"
                known = str(frequency.fit(frf).parameters["gain"])
            yield row(
                f"nano-drone, {axis}, {label} ({top}): gain; by regression, 0.5-2 Hz",
                known,
                peer=regression,
                goal="alike",
            )


def _nano_flight(path: Path, axis: str) -> Experiment:
    """Read the inputs and the rate of an axis, and the acceleration of its reference."""
    table = nanodrone_table(path)
    speeds = table[[f"m{k}_erpm" for k in range(1, 5)]].to_numpy() * 2.0 * np.pi / 360.0
    signs = np.array([-1.0, -1.0, 1.0, 1.0] if axis == "roll" else [-1.0, 1.0, 1.0, -1.0])
    rate, velocity = ("wx", "vy_r") if axis == "roll" else ("wy", "vx_r")
    columns = np.column_stack([speeds**2 / np.mean(speeds**2) @ signs / 4.0, np.gradient(table[velocity], 0.01)])
    names = {"input_names": [axis, "instrument"], "output_names": ["w_x" if axis == "roll" else "w_y"]}
    return Experiment.from_arrays(np.arange(len(table)) * 0.01, columns, table[rate].to_numpy(), **names)
