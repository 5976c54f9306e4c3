"""Loops foretold and flown: pairs of firmware flights, pairs and random craft of the simulator, tuning, real logs.

The tables of issue 16: margins predicted from one flight against those measured on a later one with other gains, how
many 95 % intervals hold, what tuned gains do in truth, and that nothing is proposed without the evidence.
"""

import tempfile
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks._measure import CRAFT, LOGS, Row, readable, rms, row, timed, unpacked
from logparse import FlightLog, RotoridError, read_log
from simulation.axis_loop import (
    AxisPlant,
    AxisRun,
    LoopGains,
    Shaking,
    random_axis,
    run_axis,
    settings_of,
    write_rate_log,
)
from sysid.frequency import fit
from sysid.frequency.axes import axis_of
from sysid.frequency.estimate import response_of_records
from sysid.loops import Limits, prove, tune
from sysid.loops.chirps import DEFAULT_BAND, DEFAULT_MAGNITUDE, FADE_OUT, design_chirp, first_chirp
from sysid.loops.evidence import unsupported
from sysid.loops.known_margins import Margins
from sysid.loops.safety import Aim
from sysid.loops.search import AxisTuning, tune_axis
from tests.sysid.axis_flights import (
    flown_loop,
    fly_chirp,
    loop_of_flight,
    procedure_loop,
    records_of_flight,
    true_margins,
)

QUANTITIES = ("crossover_hz", "phase_deg", "gain_db", "rejection_hz", "peak_db")

#: The firmware's own SID_T_FADE_IN and SID_T_FADE_OUT in parts of its SID_T_REC.
DEFAULT_FADES = (15.0 / 70.0, 2.0 / 70.0)


def run() -> list[Row]:
    rows: list[Row] = []
    if (LOGS / "pairs").exists():
        with tempfile.TemporaryDirectory() as folder:
            rows += _firmware(Path(folder))
    rows += _simulated_pairs()
    rows += _random_craft("random craft, chirps to 40 Hz", 100, goal="70 of 100")
    rows += _random_craft("published procedure, 0.1 to 10 Hz, I at 0", 60, goal="48 of 60", procedure=True)
    with tempfile.TemporaryDirectory() as folder:
        rows += _sticks(Path(folder) / "sticks.bin")
    with tempfile.TemporaryDirectory() as folder:
        rows += _long_log(Path(folder) / "long.bin")
    rows += _designs()
    if (LOGS / "real").exists():
        rows += _real_logs()
    return rows


class Errors:
    """Differences between predicted and measured, by quantity, with whether the interval held."""

    def __init__(self) -> None:
        self.absolute: dict[str, list[float]] = defaultdict(list)
        self.relative: dict[str, list[float]] = defaultdict(list)
        self.held: list[bool] = []

    def add(self, name: str, predicted: float, measured: float, *, held: bool) -> None:
        if np.isfinite(predicted) and np.isfinite(measured):
            self.absolute[name].append(abs(predicted - measured))
            self.relative[name].append(abs(predicted / measured - 1.0))
            self.held.append(held)

    def rows(self, what: str) -> Iterable[Row]:
        def spread(values: list[float], unit: str, scale: float = 1.0) -> str:
            return f"{scale * np.median(values):.2g} median, {scale * max(values):.2g} worst {unit} ({len(values)})"

        yield row(f"{what}: crossover", spread(self.relative["crossover_hz"], "%", 100.0), goal="5 %")
        yield row(f"{what}: phase margin", spread(self.absolute["phase_deg"], "deg"), goal="3 median, 6 worst")
        yield row(f"{what}: gain margin", spread(self.absolute["gain_db"], "dB"), goal="1 dB")
        yield row(f"{what}: rejection bandwidth", spread(self.relative["rejection_hz"], "%", 100.0), goal="10 %")
        yield row(f"{what}: 95 % intervals hold", f"{100.0 * np.mean(self.held):.0f} %", goal="90-98 %")


def _read(folder: Path, name: str) -> FlightLog:
    return read_log(unpacked(LOGS / "pairs" / f"{name}.BIN.xz", folder))


def _firmware(folder: Path) -> list[Row]:
    errors, ways, fits, cpu, proposed = Errors(), Errors(), [], [], 0
    for craft in CRAFT:
        for later in ("g1", "g2"):
            proof = prove(_read(folder, f"{craft}_id"), _read(folder, f"{craft}_{later}"))
            for axis, (_, second) in proof.loops.items():
                for name in QUANTITIES:
                    known = proof.table.loc[(axis, name)]
                    spread = 1.96 * np.hypot(known["predicted_sigma"], known["measured_sigma"])
                    held = abs(known["predicted"] - known["measured"]) <= spread
                    errors.add(name, known["predicted"], known["measured"], held=bool(held))
                fits.append(float(proof.table.loc[(axis, "step_fit"), "predicted"]))
                _both_ways(ways, second.own_margins, second.measured_margins)
        tuning, seconds = timed(lambda: tune(_read(folder, f"{craft}_id")))  # noqa: B023
        proposed += tuning.refused is None
        cpu.append(seconds)
    hot = prove(_read(folder, "quad15_id"), _read(folder, "quad15_hot"))
    called = all(predicted.margins.unstable > 0.95 for predicted, _ in hot.loops.values())
    return [
        *errors.rows("firmware, before -> after"),
        *ways.rows("firmware, computed -> measured by chirp"),
        row("firmware: closed-loop step fit", f"{min(fits):.1f} % worst, {np.median(fits):.1f} % median", goal="90 %"),
        row("firmware: gains of quad15_hot", "called unstable" if called else "MISSED", goal="unstable"),
        row("firmware: tune proposes", f"{proposed} of {len(CRAFT)}"),
        row("firmware: tune, CPU of a 5 min log at 100 Hz", f"{max(cpu):.1f} s worst"),
    ]


def _both_ways(errors: Errors, computed: Margins, measured: Margins) -> None:
    for name in QUANTITIES:
        a, b = getattr(computed, name), getattr(measured, name)
        if a.value is not None and b.value is not None:
            errors.add(name, a.value, b.value, held=abs(a.value - b.value) <= 1.96 * np.hypot(a.sigma, b.sigma))


def _simulated_pairs(count: int = 40) -> list[Row]:
    """Identify, change gains at random, and fly again: the truth and the later flight's own measurement."""
    rng = np.random.default_rng(1)
    truth_errors, errors = Errors(), Errors()
    for seed in range(1, count + 1):
        axis, gains = random_axis(rng)
        p, i, d = (float(rng.uniform(0.6, 1.5)) for _ in range(3))
        other = replace(gains, P=p * gains.P, I=i * gains.I, D=d * gains.D, FLTD=float(rng.choice([15.0, 20.0, 30.0])))
        truth = true_margins(axis, other)
        loop = flown_loop(axis, gains, seed)
        foretold = loop.with_gains(P=other.P, I=other.I, D=other.D, FLTD=other.FLTD).margins
        later = flown_loop(axis, other, 1000 + seed).own_margins
        for name in QUANTITIES:
            value = getattr(foretold, name).value
            if value is not None:
                low, high = foretold.intervals[name]
                truth_errors.add(name, value, truth[name], held=low <= truth[name] <= high)
        _both_ways(errors, foretold, later)
    return [*truth_errors.rows("simulator, before -> truth"), *errors.rows("simulator, before -> after")]


def _random_craft(what: str, count: int, goal: str, *, procedure: bool = False) -> list[Row]:
    """Tune random craft and look at the truth of what was proposed."""
    rng = np.random.default_rng(2)
    truths = Truths()
    for seed in range(1, count + 1):
        axis, gains = random_axis(rng)
        loop = (procedure_loop if procedure else flown_loop)(axis, gains, seed)
        if not unsupported(loop):
            truths.add(axis, gains, tune_axis(loop, Aim()))
    return truths.rows(what, count, goal)


def _sticks(path: Path, count: int = 40) -> list[Row]:
    """Tune random craft from 90 s of sticks, RATE at 50 Hz."""
    rng = np.random.default_rng(7)
    truths = Truths()
    for seed in range(1, count + 1):
        axis, gains = random_axis(rng)
        run = run_axis(axis, gains, Shaking(duration=90.0, stick=0.15, gust=0.2, gyro_noise=0.015), seed)
        write_rate_log(path, {"roll": run}, rate=50.0, filter_hz=axis.filter_hz, gains={"roll": gains})
        for item in tune(read_log(path)).axes[:1]:
            truths.add(axis, gains, item)
    return truths.rows("random craft, sticks", count, "20 of 40")


class Truths:
    """What proposals are in truth."""

    def __init__(self) -> None:
        self.accepted = self.unsafe = self.better = self.broken = 0

    def add(self, craft: AxisPlant, gains: LoopGains, tuning: AxisTuning) -> None:
        if tuning.tuned is None:
            return
        before = true_margins(craft, gains)
        after = true_margins(craft, tuning.tuned.settings)
        worst = tuning.worst
        self.accepted += 1
        self.unsafe += after["phase_deg"] < 30.0 or after["gain_db"] < 4.0 or not after["stable"]
        self.better += after["rejection_hz"] > before["rejection_hz"]
        self.broken += (
            after["gain_db"] < worst["gain_db"]
            or after["phase_deg"] < worst["phase_deg"]
            or after["peak_db"] > worst["peak_db"]
        )

    def rows(self, what: str, tried: int, goal: str) -> list[Row]:
        return [
            row(f"simulator: {what}: proposed", f"{self.accepted} of {tried}", goal=goal),
            row(f"simulator: {what}: true PM < 30 deg or GM < 4 dB", str(self.unsafe), goal="0"),
            row(f"simulator: {what}: rejection better than before", f"{self.better} of {self.accepted}"),
            row(f"simulator: {what}: true margins worse than promised", str(self.broken), goal="0"),
        ]


def _long_log(path: Path) -> list[Row]:
    """Tune a flight of 3 min whose RATE, PID and SIDD come at 400 Hz."""
    runs, flown = {}, {}
    for k, (name, gain, p) in enumerate((("roll", 300.0, 0.08), ("pitch", 220.0, 0.11), ("yaw", 40.0, 0.35))):
        axis = AxisPlant(gain=gain, damping=1.0, lag=0.02, delay=0.003, filter_hz=40.0)
        flown[name] = LoopGains(P=p, I=p if k < 2 else 0.1 * p, D=0.025 * p if k < 2 else 0.0)
        shaken = Shaking(
            duration=180.0,
            chirp=(0.5, 40.0, 0.08),
            chirp_start=20.0 + 45.0 * k,
            chirp_seconds=25.0,
            sid_axis=10 + k,
            gust=0.3,
            gyro_noise=0.015,
        )
        runs[name] = run_axis(axis, flown[name], shaken, k)
    write_rate_log(path, runs, rate=400.0, filter_hz=40.0, gains=flown)
    result, took = timed(lambda: tune(read_log(path)))
    outcome = "proposed" if result.refused is None else result.refused
    return [row("simulator: tune of 3 min at 400 Hz, CPU", f"{took:.1f} s ({outcome})", goal="5 s")]


def _designs(count: int = 50, flights: int = 2) -> list[Row]:
    """Fly designed chirps and the firmware's of equal time twice on each craft: scatter and errors against predictions.

    The scatter of the firmware's counts twice: as flown at 0.05 of the mixer, where it leans and turns some craft
    beyond the limits of the design and ends itself beyond 30 deg; and for the magnitude that keeps these limits.
    """
    rng = np.random.default_rng(4)
    limits = Limits()
    bounds = np.array([limits.lean_deg, limits.rate_deg, limits.mixer])
    scatter: dict[str, list[float]] = defaultdict(list)
    beyond = ended = undetermined = 0
    for number in range(1, count + 1):
        axis, gains = random_axis(rng)
        gust, noise = float(rng.uniform(0.1, 0.6)), float(rng.uniform(0.005, 0.05))
        first = first_chirp(settings_of(axis, gains), limits)
        fly = partial(fly_chirp, axis, gains, gust=gust, noise=noise, seconds=first.seconds)
        own = {"magnitude": first.magnitude, "band": (first.low, first.high), "fades": (first.fade_in, FADE_OUT)}
        before = fly(seed=100 * number, **own)
        chirp = design_chirp(loop_of_flight(before, axis, gains), limits)
        own = {"magnitude": chirp.magnitude, "band": (chirp.low, chirp.high), "fades": (chirp.fade_in, FADE_OUT)}
        fades = tuple(first.seconds * part for part in DEFAULT_FADES)
        seeds = range(100 * number + 1, 100 * number + 1 + flights)
        designed = [fly(seed=seed, **own) for seed in seeds]
        plain = [fly(seed=seed + 50, magnitude=DEFAULT_MAGNITUDE, band=DEFAULT_BAND, fades=fades) for seed in seeds]
        leaned = np.max([_motion(flight) for flight in plain], axis=0)
        beyond += bool((np.max([_motion(flight) for flight in (before, *designed)], axis=0) > bounds).any())
        ended += bool(leaned[0] > 30.0)
        within = max(1.0, float(np.max(leaned / bounds)))
        known, default = (np.array([_gain_and_delay(flight, axis) for flight in group]) for group in (designed, plain))
        undetermined += int(np.isnan(known).any(axis=1).sum())
        truth, size = (axis.gain, axis.lag + axis.total_delay), (axis.gain, 1.0)
        for k, (name, parameter) in enumerate((("gain", "gain"), ("delay", "effective_delay"))):
            error = next(error for error in chirp.errors if error.name == parameter)
            spread, other = (float(np.std(estimates[:, k], ddof=1) / size[k]) for estimates in (known, default))
            scatter[f"{name} random"].append(spread / error.random)
            scatter[f"{name} total"] += ((known[:, k] - truth[k]) / size[k] / error.sigma).tolist()
            scatter[f"{name} default"].append(within * other / error.random)
            scatter[f"{name} plain"].append(np.inf if leaned[0] > 30.0 else other / error.random)
    rows: list[Row] = []
    for name in ("gain", "delay"):
        random, total, default = (rms(scatter[f"{name} {kind}"]) for kind in ("random", "total", "default"))
        unlike = np.median(scatter[f"{name} plain"]) / np.nanmedian(scatter[f"{name} random"])
        limited = f"designs: {name}, scatter of the default chirp within the same limits over the design's"
        rows += [
            row(f"designs, {count} craft: {name}, scatter over predicted", f"{random:.2f}", goal="0.75-1.33"),
            row(f"designs: {name}, error over predicted total", f"{total:.2f}", goal="below 1.33"),
            row(limited, f"{default / random:.1f}", goal="2"),
            row(f"designs: {name}, the same at 0.05 of the mixer whatever its limits, medians", f"{unlike:.1f}"),
        ]
    return [
        *rows,
        row("designs: craft with a limit exceeded; flights without result", f"{beyond}; {undetermined}", goal="0; 0"),
        row("designs: craft on which the default chirp ends itself (30 deg)", str(ended)),
    ]


def _motion(flight: AxisRun) -> tuple[float, float, float]:
    lean, rate, mixer = (float(np.abs(signal).max()) for signal in (flight.attitude, flight.measured, flight.output))
    return float(np.degrees(lean)), float(np.degrees(rate)), mixer


def _gain_and_delay(flight: AxisRun, plant: AxisPlant) -> tuple[float, float]:
    try:
        records = [record.plant for record in records_of_flight(flight)]
        parameters = fit(response_of_records(records, axis_of("roll"), gyro_filter_hz=plant.filter_hz)).parameters
    except RotoridError:
        return np.nan, np.nan
    gain, late = parameters["gain"].value, parameters["effective_delay"].value
    return np.nan if gain is None else gain, np.nan if late is None else late


def _real_logs() -> list[Row]:
    refused = [tune(log).refused is not None for _, log in readable("real/*")]
    proposed = len(refused) - sum(refused)
    return [
        row("tune on real logs", f"{sum(refused)} refused with a sentence, {proposed} proposals", goal="no traceback")
    ]
