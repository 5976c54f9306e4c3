"""What report.json holds: of one flight, of one craft from several flights, or of a folder of logs.

SI units, time in seconds on the log's boot clock, angles in radians unless a name ends in ``_deg``; outputs x north,
y east, z up, in metres from the first sample. What could not be determined is None.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

from logparse import Finding, Severity, Vehicle
from pipeline.config import AnalysisConfig
from pipeline.results.account import Account
from pipeline.results.answer import Advice, Answer
from pipeline.results.coverage import Coverage, Envelope
from pipeline.results.drift import Drift
from pipeline.results.flight import LogFacts
from pipeline.results.model import ModelReport, ParameterRow, RmseRow
from pipeline.results.rotation import RotationResult
from sysid.autopilot.values import AutopilotValues
from sysid.rotors.thrust_record import ThrustModel
from sysid.validation.uses import Verdict

#: Lines of an answer that tables over all flights show.
_TABULATED = ("Happened", "Loops", "Parameters", "Predict ahead")


@dataclass(frozen=True, slots=True, kw_only=True)
class ModeSpan:
    """A flight mode, and when it was in force."""

    mode: str
    start_s: float
    stop_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class FlownReport:
    """The analysed airborne interval: its modes, how high and how fast over the ground it went, as read."""

    start_s: float
    stop_s: float
    duration_s: float
    modes: tuple[ModeSpan, ...] = ()
    height_m: float | None = None
    speed_max_m_s: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class OriginReport:
    """Where the trajectory is counted from; None where the log does not tell."""

    latitude_deg: float | None
    longitude_deg: float | None
    altitude_m: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class TrajectoryReport:
    """How the trajectory was estimated, and the median 1-sigma of its states in flight."""

    method: str
    origin: OriginReport
    sigma_median: Mapping[str, float | None]
    diagnostics: Mapping[str, object]


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightReport:
    """One log, analysed as far as its content allows; `missing` says why a stage gave nothing."""

    kind: Literal["flight"] = "flight"
    rotorid: str
    name: str
    log: LogFacts
    vehicle: Vehicle
    flight: FlownReport | None
    config: AnalysisConfig
    verdict: Verdict
    rmse: tuple[RmseRow, ...]  #: Of all models.
    models: tuple[ModelReport, ...]
    thrust: ThrustModel | None
    parameters: tuple[ParameterRow, ...] | None
    trajectory: TrajectoryReport | None
    coverage: Coverage | None
    account: Account | None
    rotation: RotationResult | None
    answer: Answer | None
    advice: tuple[Advice, ...]
    findings: tuple[Finding, ...]
    missing: Mapping[str, str]
    timings_s: Mapping[str, float]  #: Seconds that each stage took.
    folder: str = ""  #: Of its products, in the report of a folder of logs.

    @property
    def happened(self) -> str:
        """What happened, in a few words."""
        return "" if self.account is None else self.account.in_short

    def in_short(self, folder: str) -> FlightReport:
        """Return what tables over all flights show; the report.json in its folder has the rest."""
        coverage, account, answer = self.coverage, self.account, self.answer
        if coverage is not None:
            quantities = {name: replace(quantity, seconds=()) for name, quantity in coverage.quantities.items()}
            coverage = replace(coverage, quantities=quantities, map=())
        if account is not None:
            account = Account(
                flight=account.flight,
                happenings=account.notable[:1],
                story=account.story,
                headline=account.headline,
                unseen=account.unseen,
                battery=account.battery,
                vibration=account.vibration,
                gps=account.gps,
            )
        if answer is not None:
            answer = replace(answer, lines=tuple(line for line in answer.lines if line.purpose in _TABULATED))
        return replace(
            self,
            folder=folder,
            vehicle=replace(self.vehicle, motors=()),
            rmse=(),
            models=tuple(model.in_short() for model in self.models),
            thrust=None if self.thrust is None else replace(self.thrust, findings=()),
            parameters=None,
            trajectory=None,
            coverage=coverage,
            account=account,
            rotation=None,
            answer=answer,
            advice=(),
            findings=tuple(replace(finding, reason="", advice="", evidence={}) for finding in self.findings),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class CraftReport:
    """Several flights of one craft, identified jointly from some and judged on the others."""

    kind: Literal["craft"] = "craft"
    rotorid: str
    name: str
    vehicle: Vehicle
    training: tuple[str, ...]
    held_out: tuple[str, ...]
    split: str  #: How the flights to fit and those to judge were chosen.
    verdict: Verdict
    rmse: tuple[RmseRow, ...]
    models: tuple[ModelReport, ...]
    thrust: ThrustModel | None
    parameters: tuple[ParameterRow, ...] | None
    coverage: Envelope | None
    drift: Drift | None
    autopilot: AutopilotValues | None  #: What the flights propose to the autopilot, or why not.
    advice: tuple[Advice, ...]
    findings: tuple[Finding, ...]
    missing: Mapping[str, str]
    timings_s: Mapping[str, float]
    folder: str = ""  #: Of its products, in the report of a folder of logs.


@dataclass(frozen=True, slots=True, kw_only=True)
class CommonFinding:
    """A finding with the flights that it holds for; its words are those of the flight `example`."""

    id: str
    severity: Severity
    reason: str
    advice: str
    example: str
    flights: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftOut:
    """A file, and why it gave nothing or was not used."""

    file: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class FleetReport:
    """A folder of logs: crafts in full, flights in short."""

    kind: Literal["fleet"] = "fleet"
    rotorid: str
    config: AnalysisConfig
    groups: tuple[CraftReport, ...]
    flights: tuple[FlightReport, ...]  #: See `FlightReport.in_short`.
    findings: tuple[CommonFinding, ...]
    #: Logs that gave nothing, files that were not used, copies, and logs that an earlier run knew and this did not
    #: find.
    failures: tuple[LeftOut, ...] = ()
    passed_over: tuple[LeftOut, ...] = ()
    duplicates: tuple[LeftOut, ...] = ()
    removed: tuple[LeftOut, ...] = ()
    again: tuple[str, ...] = ()  #: Flights of which another recording is here too; they are not counted twice.
    timings_s: Mapping[str, float]
