"""One log to one result: read, estimate, identify on the first part of the flight, judge on the rest."""

import hashlib
import math
from pathlib import Path

import estimation
import logparse
import sysid
from logparse import Finding, FlightLog, MissingDataError, health
from pipeline.config import AnalysisConfig
from pipeline.craft import fingerprint
from pipeline.names import printable
from pipeline.results import POSITION_KNOWN, FlightResult, LogFacts, Prediction, Span, horizontal_sigma
from pipeline.stages import Progress, Stages, silent

#: Shortest flight that models are fitted to, s: less says nothing of a craft that takes seconds to move.
SHORTEST_EXPERIMENT = 20.0


def analyze(
    path: str | Path, config: AnalysisConfig | None = None, progress: Progress | None = None, *, name: str | None = None
) -> FlightResult:
    """Analyse one log as far as its content allows.

    Parameters
    ----------
    path : str or Path
    config : AnalysisConfig, optional
    progress : callable, optional
        Called with a stage's name and the fraction of it that is done.
    name : str, optional
        What the flight is called in the result; the file name without its extension.

    Returns
    -------
    FlightResult
        Stages that could not be done are None there, with their reason in `FlightResult.missing`.

    Raises
    ------
    RotoridError
        The file is not a readable log, or holds neither a flight nor a trajectory.
    """
    path = Path(path)
    name = name or printable(path.stem)
    config = config or AnalysisConfig()
    stages = Stages(progress or silent, config.time_limit)

    stages.progress("read", 0.0)
    log = logparse.read_log(path)
    tables = stages.run("tables", lambda _: log.tables)
    if tables is None:
        raise MissingDataError(stages.missing["tables"])
    checked = stages.run("health", lambda _: health.check(log)) or ()
    flight = stages.run("flight", lambda _: _longest_flight(log, checked))
    trajectory = stages.run(
        "trajectory", lambda _: estimation.estimate(tables, rate=config.estimation_rate, date=log.start_utc)
    )
    if flight is None and trajectory is None:
        raise MissingDataError(f"{stages.missing['flight']}; no trajectory either: {stages.missing['trajectory']}")

    experiment = model = thrust = validation = None
    predictions: tuple[Prediction, ...] = ()
    if flight is None or trajectory is None:
        stages.missing["experiment"] = stages.missing["flight" if flight is None else "trajectory"]
    else:
        cut = stages.run("experiment", lambda _: _cut(log, trajectory, config, name))
        if cut is not None:
            experiment, fitted, held_out = cut
    if experiment is not None:
        thrust = stages.run("thrust", lambda _: sysid.fit_thrust([fitted], mass=config.mass))
        model = stages.run("model", lambda report: _fit(fitted, trajectory, flight, config, report))
    if model is not None:
        fit_model = model
        validation = stages.run("validation", lambda _: sysid.validate(fit_model, [fitted, held_out]))
    if validation is not None:
        predictions = tuple(
            Prediction(experiment=part, y_hat=validation.predictions[part.name], training=part is fitted)
            for part in (fitted, held_out)
        )

    later = (part.findings for part in (trajectory, model, thrust) if part is not None)
    return FlightResult(
        name=name,
        log=_facts(log, path),
        config=config,
        flight=flight,
        motors=tables.motors,
        modes=tables.modes,
        gps=tables.gps,
        baro=tables.baro,
        trajectory=trajectory,
        experiment=experiment,
        model=model,
        thrust=thrust,
        predictions=predictions,
        validation=validation,
        findings=(*log.findings, *checked, *(finding for part in later for finding in part), *stages.findings),
        missing=stages.missing,
        timings=stages.timings,
    )


def _longest_flight(log: FlightLog, checked: tuple[Finding, ...]) -> Span:
    if not log.flights:
        reasons = [finding.reason for finding in checked if finding.id == "no-flight"]
        raise MissingDataError(reasons[0].rstrip(".") if reasons else "The log shows no flight")
    longest = max(log.flights, key=lambda flight: flight.stop - flight.start)
    return Span(longest.start, longest.stop)


def _cut(
    log: FlightLog, trajectory: estimation.Trajectory, config: AnalysisConfig, name: str
) -> tuple[sysid.Experiment, sysid.Experiment, sysid.Experiment]:
    """Cut the whole flight, the part to fit, and the part that judges."""
    whole = sysid.Experiment.from_flight(
        log, trajectory, rate=config.rate, inputs="motors", outputs="position", name=name
    )
    if whole.duration < SHORTEST_EXPERIMENT:
        raise MissingDataError(
            f"only {whole.duration:.0f} s of the flight have motor outputs and positions without a gap; "
            f"at least {SHORTEST_EXPERIMENT:.0f} s are needed to fit and judge a model"
        )
    return whole, *whole.split(config.training_fraction)


def _fit(
    fitted: sysid.Experiment,
    trajectory: estimation.Trajectory | None,
    flight: Span | None,
    config: AnalysisConfig,
    report: Progress,
) -> sysid.TransferFunctionModel:
    sigma = math.inf if trajectory is None else horizontal_sigma(trajectory, flight)
    if not sigma <= POSITION_KNOWN:
        raise MissingDataError(
            f"the horizontal position is not known (its 1-sigma grows to {sigma:.0f} m), so there is no motion to fit: "
            "the log has no usable GPS"
        )
    return sysid.fit_transfer_functions(
        [fitted], poles=config.poles, zeros=config.zeros, structure=config.structure, progress=report
    )


def _facts(log: FlightLog, path: Path) -> LogFacts:
    with path.open("rb") as file:
        sha256 = hashlib.file_digest(file, "sha256").hexdigest()
    return LogFacts(
        path=path,
        size=path.stat().st_size,
        sha256=sha256,
        format=log.format,
        duration=log.duration,
        start_utc=log.start_utc,
        boots=len(log.boots),
        vehicle=log.vehicle,
        craft=fingerprint(log.vehicle, log.parameters, simulated=log.tables.truth is not None),
        flights=tuple(Span(flight.start, flight.stop) for flight in log.flights),
    )
