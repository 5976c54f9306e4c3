"""One log to one result: read, estimate, identify on the first part of the flight, judge on the rest."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

import estimation
import logparse
import sysid
from core.findings import gathered
from logparse import Boot, Finding, FlightLog, MissingDataError, RotoridError, completeness
from pipeline.config import SHORTEST, AnalysisConfig
from pipeline.execution.stages import NEXT_FLIGHT, Overall, Progress, Stages, silent
from pipeline.execution.workload import Workload
from pipeline.flight import without_trajectory
from pipeline.flight.account import account_of_flight
from pipeline.flight.account.account import account_of
from pipeline.flight.account.readings import Readings
from pipeline.flight.answer import compose_answer
from pipeline.flight.coverage import logged_rates, measure
from pipeline.flight.craft import fingerprint, tune_of
from pipeline.flight.identification import compare_parameters, identify, without_model
from pipeline.flight.kinds import KINDS, RIGID_BODY_KEY, THRUST_KEY, ModelKind
from pipeline.flight.next_flights import for_flight
from pipeline.flight.signals import flight_signals
from pipeline.flight.training import busiest, loss_findings, part_findings
from pipeline.names import flight_name, printable
from pipeline.results.account import Account
from pipeline.results.coverage import Coverage, LoggedRate
from pipeline.results.failure import Failure, findings_of, present
from pipeline.results.flight import FlightResult, LogFacts, ModelResult
from pipeline.results.rotation import RotationResult
from pipeline.results.signals import FlightSignals
from pipeline.results.span import Span
from pipeline.storage.sources import digest
from sysid.autopilot.gathering import batch_values, body_values, feed_forward
from sysid.autopilot.values import AutopilotValue
from sysid.loops.settings import firmware_version
from sysid.rotors.thrust import thrust_changes
from sysid.rotors.thrust_regression import THRUST_CHANGED

#: In the place of what is not identified yet.
_FOLLOWS = Failure("models", "being identified")


def analyze(
    path: str | Path, config: AnalysisConfig | None = None, progress: Progress | None = None, *, name: str | None = None
) -> FlightResult:
    """Analyse the longest flight of a log as far as its content allows.

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
        Stages that could not be done have a `Failure` in the place of their result.

    Raises
    ------
    RotoridError
        The file is not a readable log, or holds neither a flight nor a trajectory.
    """
    path, progress = Path(path), progress or silent
    progress("read", 0.0)
    log = logparse.read_log(path)
    return _analyze(log, config or AnalysisConfig(), progress, name or printable(path.stem), digest(str(path)), {})


def analyze_flights(
    source: str | Path | Sequence[FlightLog],
    config: AnalysisConfig | None = None,
    progress: Progress | None = None,
    *,
    name: str | None = None,
    alone: bool = False,
    announce: Callable[[FlightResult], None] | None = None,
) -> Iterator[FlightResult]:
    """Analyse every flight of a log, one after the other.

    Parameters
    ----------
    source : str, Path or sequence of FlightLog
        The file, or what `logparse.read_flights` made of it.
    config, progress
        As `analyze` takes them; `progress` hears of the fraction of a stage over all flights.
    name : str, optional
        What the log is called; of several flights each is called ``NAME#NUMBER``, see `pipeline.names.flight_name`.
    alone : bool
        Whether this process does nothing else, so that a copy of it may use a second processor.
    announce : callable, optional
        Called with each flight as soon as what happened is known, before anything is identified.

    Yields
    ------
    FlightResult
        In the order in which they were flown.

    Raises
    ------
    RotoridError
        As `analyze` raises it.
    """
    config, progress = config or AnalysisConfig(), progress or silent
    progress("read", 0.0)
    logs = logparse.read_flights(source) if isinstance(source, str | Path) else source
    name = name or printable(logs[0].path.stem)
    sha256 = digest(str(logs[0].path))
    # All flights of a power-up are parts of one trajectory.
    trajectories: dict[Boot, estimation.Trajectory | Failure] = {}
    for number, log in enumerate(logs, start=1):
        progress(NEXT_FLIGHT, 1.0 / len(logs))
        called = flight_name(name, number, len(logs))
        result = _analyze(log, config, progress, called, sha256, trajectories, alone=alone, announce=announce)
        yield replace(result, log=replace(result.log, flight_number=number, flight_count=len(logs)))


def _analyze(
    log: FlightLog,
    config: AnalysisConfig,
    progress: Progress,
    name: str,
    sha256: str,
    trajectories: dict[Boot, estimation.Trajectory | Failure],
    *,
    alone: bool = False,
    announce: Callable[[FlightResult], None] | None = None,
) -> FlightResult:
    """Analyse the flight that a log shows; `trajectories` are those of its power-ups, as far as they are known."""
    stages = Stages(progress, config.time_limit)
    tables = stages.run("tables", lambda _: log.tables)
    if isinstance(tables, Failure):
        stages.raise_unforeseen("tables")
        raise MissingDataError(tables.reason)
    checked = present(stages.run("account", lambda _: completeness.check(log))) or ()
    flight = stages.run("flight", lambda _: _flight(log, checked))
    if isinstance(progress, Overall):
        expected = Workload.of(log, present(flight)).seconds()
        progress.expect(
            {stage: time for stage, time in expected.items() if not (alone and stage in without_trajectory.STAGES)}
        )
    begun = _begun(log, flight, name, sha256, config, stages)
    account = begun.account
    # Now that the inertial sensors' table is there: built again for its times alone, it takes a second of a long log.
    rates = (
        None if isinstance(flight, Failure) else present(stages.run("account", lambda _: logged_rates(tables, flight)))
    )
    if announce is not None:
        announce(replace(begun, answer=compose_answer(begun)))
    sound = flight if isinstance(account, Failure) or account.sound is None else account.sound
    part = sound if isinstance(sound, Failure) else stages.run("account", lambda _: busiest(log, sound))
    # Models of the motion take longer than what needs no trajectory, and neither waits for the other.
    pending = without_trajectory.begin(log, sound, part, progress, config.time_limit, alone=alone)
    if isinstance(trajectories.get(log.boot), Failure | None):
        trajectories[log.boot] = stages.run("trajectory", lambda _: estimation.estimate(tables, date=log.start_utc))
    estimated = trajectories[log.boot]
    # What contradicts its own sensors is no result; what it found out about them is.
    contradicted = isinstance(estimated, estimation.Trajectory) and estimated.inconsistency
    trajectory = Failure("trajectory", contradicted) if contradicted else estimated
    if isinstance(flight, Failure) and isinstance(trajectory, Failure):
        stages.raise_unforeseen("flight", "trajectory")
        raise MissingDataError(f"{flight.reason}; no trajectory either: {trajectory.reason}")

    fitted = _fitted(replace(begun, trajectory=trajectory), log, part, stages)
    coverage = _measured(fitted, log, rates, stages)
    independent = pending()
    stages.take(independent.stages)

    # Findings about the fits stay with their models; those of the experiments are about the log.
    known = len(stages.findings)
    result = replace(
        fitted,
        coverage=coverage,
        trims=independent.trims,
        rotation=independent.rotation,
        autopilot=(
            *(present(stages.run("advice", lambda _: _autopilot(log, fitted, independent.rotation))) or ()),
            *independent.gains,
        ),
        findings=(
            *log.findings,
            *checked,
            *(() if isinstance(account, Failure) else loss_findings(account)),
            *(part_findings(sound, part) if isinstance(sound, Span) and isinstance(part, Span) else ()),
            *findings_of(independent.rotation),
            *independent.motor_findings,
            *findings_of(estimated, fitted.thrust, fitted.parameters, *fitted.experiments.values()),
            *stages.findings,
        ),
        timings=stages.timings,
    )
    advice = present(stages.run("advice", lambda _: for_flight(result)))
    result = replace(result, advice=advice or (), findings=gathered((*result.findings, *stages.findings[known:])))
    return replace(result, answer=stages.run("answer", lambda _: compose_answer(result)))


def _begun(
    log: FlightLog, flight: Span | Failure, name: str, sha256: str, config: AnalysisConfig, stages: Stages
) -> FlightResult:
    """Return the result as it is when it is known what happened and nothing is identified."""
    tables, simulated = log.tables, log.tables.truth is not None
    account: Account | Failure
    signals: FlightSignals | Failure
    if isinstance(flight, Failure):
        account, signals = stages.run("account", lambda _: account_of_flight(log, None)), flight
    else:
        readings = Readings.of(log, flight)  # of both
        account = stages.run("account", lambda _: account_of(readings))
        signals = stages.run("account", lambda _: flight_signals(readings))
    return FlightResult(
        name=name,
        log=LogFacts(
            file=log.path.name,
            bytes=log.path.stat().st_size,
            sha256=sha256,
            format=log.format,
            duration_s=log.duration,
            start_utc=None if log.start_utc is None else log.start_utc.isoformat(),
            boots=len(log.boots),
            flights=tuple(Span(flown.start, flown.stop) for flown in log.flights),
            flight_number=1,
            flight_count=1,
        ),
        vehicle=log.vehicle,
        craft=fingerprint(log.vehicle, log.parameters, simulated=simulated),
        tune=tune_of(log.vehicle, log.parameters),
        board=None if simulated else log.vehicle.board_id,
        config=config,
        flight=flight,
        motors=tables.motors,
        modes=tables.modes,
        gps=tables.gps,
        tables=tables,
        trajectory=_FOLLOWS,
        thrust=_FOLLOWS,
        parameters=_FOLLOWS,
        coverage=_FOLLOWS,
        rotation=_FOLLOWS,
        account=account,
        signals=signals,
        findings=log.findings,
    )


def _fitted(begun: FlightResult, log: FlightLog, part: Span | Failure, stages: Stages) -> FlightResult:
    """Fit every kind of model to the beginning of the flight's part that models are of, and validate it on the rest."""
    flight, trajectory, config, name = begun.flight, begun.trajectory, begun.config, begun.name
    if isinstance(flight, Failure) or isinstance(part, Failure) or isinstance(trajectory, Failure):
        missing = next(stage for stage in (flight, part, trajectory) if isinstance(stage, Failure))
        return _nothing_fitted(begun, missing.reason)
    thrust: sysid.ThrustModel | Failure = Failure("thrust", "no kind of model uses motor outputs")
    experiments: dict[str, sysid.Experiment] = {}
    models: list[ModelResult] = []
    unfit = trajectory.unknown_position(flight.start, flight.stop)
    for kind in KINDS:
        cut = partial(_record, kind, log, trajectory, part, config, name, experiments.values())
        record = stages.run("experiment", cut)
        if isinstance(record, Failure):
            failure = Failure(record.stage, record.reason.removeprefix(f"{name}: "))
            models.append(without_model(kind, failure))
            if kind.key == THRUST_KEY:
                thrust = Failure("thrust", failure.reason)
            continue
        experiments[kind.key] = record
        training, held_out = record.split(config.training_fraction)
        if kind.key == THRUST_KEY:
            thrust = stages.run("thrust", partial(_thrust, training, record, config))
        if unfit:
            models.append(without_model(kind, Failure("experiment", unfit)))
        else:
            models.append(identify(kind, [training], [held_out], config, stages, flight=name))
    if not experiments:
        return _nothing_fitted(begun, models[0].report.missing)
    body = None if unfit else experiments.get(RIGID_BODY_KEY)
    compared = [] if body is None else [body.split(config.training_fraction)[0]]
    parameters = compare_parameters(compared, models, config, stages)
    return replace(begun, thrust=thrust, parameters=parameters, experiments=experiments, models=tuple(models))


def _thrust(
    training: sysid.Experiment, whole: sysid.Experiment, config: AnalysisConfig, _: Progress
) -> sysid.ThrustModel:
    """Fit thrust to the first part of the flight; whether a load was dropped is asked of all of it."""
    fitted = sysid.fit_thrust([training], mass=config.mass)
    others = [finding for finding in fitted.findings if finding.id != THRUST_CHANGED]
    return replace(fitted, findings=(*thrust_changes(whole), *others))


def _nothing_fitted(begun: FlightResult, reason: str) -> FlightResult:
    """Report that nothing was fitted, since there is no flight, trajectory or experiment."""
    failure = Failure("experiment", reason)
    return replace(begun, thrust=failure, parameters=failure)


def _measured(
    fitted: FlightResult, log: FlightLog, rates: Mapping[str, LoggedRate] | None, stages: Stages
) -> Coverage | Failure:
    """Compute what the flight covered."""
    flight, trajectory, records = fitted.flight, fitted.trajectory, fitted.experiments.values()
    if isinstance(flight, Failure):
        return flight
    if isinstance(trajectory, Failure):
        return trajectory
    return stages.run(
        "coverage", lambda _: measure(log, trajectory, flight, fitted.models, experiments=records, rates=rates)
    )


def _autopilot(log: FlightLog, fitted: FlightResult, rotation: RotationResult | Failure) -> tuple[AutopilotValue, ...]:
    """Return what models and raw gyro propose to the autopilot, or why not; nothing to another than ArduPilot."""
    values: list[AutopilotValue] = []
    with suppress(RotoridError):
        firmware_version(log)
        flown = log.parameters_flown
        record = fitted.experiments.get(RIGID_BODY_KEY)
        model = next((model.model for model in fitted.models if model.key == RIGID_BODY_KEY), None)
        if record is not None and isinstance(model, sysid.RigidBodyModel):
            training, _ = record.split(fitted.config.training_fraction)
            values += body_values(model, [log], [training], flown)
        values += batch_values([log], [], flown)
        if isinstance(rotation, RotationResult) and log.tables.has("rates"):
            values += feed_forward({axis.axis: axis.gain for axis in rotation.axes}, flown)
    return tuple(values)


def _flight(log: FlightLog, checked: Sequence[Finding]) -> Span:
    if log.flight is None:
        reasons = [finding.reason for finding in checked if finding.id == "no-flight"]
        raise MissingDataError(reasons[0].rstrip(".") if reasons else "The craft is no multirotor")
    return Span(log.flight.start, log.flight.stop)


def _record(
    kind: ModelKind,
    log: FlightLog,
    trajectory: estimation.Trajectory,
    part: Span,
    config: AnalysisConfig,
    name: str,
    beside: Iterable[sysid.Experiment],
    _: Progress,
) -> sysid.Experiment:
    """Cut the flight as a kind of model needs it."""
    whole = sysid.Experiment.from_flight(
        log,
        trajectory,
        rate=kind.rate or config.rate,
        inputs=kind.inputs,
        outputs="position",
        frame=kind.frame,
        name=name,
        beside=beside,
        within=(part.start, part.stop),
    )
    if whole.duration < SHORTEST:
        raise MissingDataError(
            f"only {whole.duration:.0f} s without a gap in inputs and position; "
            f"at least {SHORTEST:.0f} s are needed to fit and judge a model"
        )
    return whole
