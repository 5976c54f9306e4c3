"""Results over several logs in short: flights, which train and which judge, crafts identified jointly, failures.

Entries are what the coordinator of a folder keeps of each flight and craft while their trajectories and models lie in
the store: light (some kilobytes), they travel between processes, and stand as ``entry.json`` in the folder of their
products, where they also say that the folder is whole: an entry is written last.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime

from logparse import Finding
from pipeline.names import file_name
from pipeline.results.account import Account
from pipeline.results.coverage import Coverage
from pipeline.results.span import Span
from sysid.autopilot.values import AutopilotValue
from sysid.rotors.steady_trims import SteadyTrims


@dataclass(frozen=True, slots=True)
class LogFailure:
    """A log that gave nothing, and why, in a sentence for the person who has the log."""

    source: str  #: Path or URL.
    reason: str
    lasting: bool = False  #: It would be the same again with the same log, settings and software.
    full: bool = False  #: Nothing more can be stored.

    @property
    def file(self) -> str:
        """The file's name, without its folder, as text that can be shown."""
        return file_name(self.source)


@dataclass(frozen=True, slots=True, kw_only=True)
class Split:
    """Names of flights that train and that judge, in order of name."""

    training: tuple[str, ...]
    held_out: tuple[str, ...]
    judging: tuple[str, ...]  #: Those held out that models are judged on.
    unused: Mapping[str, str] = field(default_factory=dict)  #: Flights that do neither, and why.
    never_train: Mapping[str, str] = field(default_factory=dict)  #: Flights that judge only, and why.
    sentence: str = ""  #: How the two were chosen, with the numbers.


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightParameter:
    """A parameter of a craft by one method, as one flight alone tells it, with its standard error."""

    parameter: str
    method: str
    value: float
    sigma: float
    unit: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ResponseCurve:
    """The frequency response of an axis to its command as one flight tells it, where it is coherent."""

    flight: str
    axis: str  #: ``"roll"``, ``"pitch"``, ``"yaw"`` or ``"vertical"``.
    unit: str  #: Of output per input.
    source: str  #: What stood for the rate controller's messages; empty where they were logged.
    #: shape (n,): Frequencies [Hz], gain [dB] and phase [deg].
    hz: tuple[float, ...]
    gain_db: tuple[float, ...]
    phase_deg: tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightEntry:
    """One analysed flight, in short: what advice and the split into training and held-out flights are computed from."""

    name: str  #: Of the flight, unique among the logs analysed together.
    #: Which flight of its log it is, 1 for the first, and how many the log has.
    number: int = 1
    of: int = 1
    #: Of the log and its craft, as in `pipeline.FlightResult`.
    sha256: str
    size: int
    format: str
    start_utc: datetime | None
    duration: float
    craft: str  #: Equal for logs of the same craft, see `pipeline.flight.craft.fingerprint`.
    craft_name: str  #: The craft for people, such as ``"ArduCopter octa plus"``.
    frame_class: str | None  #: As in `logparse.Vehicle`.
    vehicle: str  #: The craft as partition ``vehicle=`` of the datasets, see `partition`.
    flight: Span | None = None  #: The airborne time that was analysed, s on the log's boot clock.
    #: Latitude and longitude, rad, and altitude, m, of the origin of `track`; None where the log does not tell.
    origin: tuple[float, float, float] | None = None
    #: tuple of (t, north, east, down): At most `TRACK_ROWS` rows over the flight, s on the boot clock and m from
    #: `origin`.
    track: tuple[tuple[float, float, float, float], ...] = ()
    #: Whether there is a horizontal position, and not only what inertial navigation without GPS drifted to.
    position_known: bool = False
    #: Kinds of models (`pipeline.flight.kinds`) that the store has an experiment for.
    experiments: tuple[str, ...] = ()
    #: Why a stage or a kind of model gave nothing, by its key.
    missing: Mapping[str, str] = field(default_factory=dict)
    coverage: Coverage | None = None  #: What the flight excited and covered.
    board: str | None = None  #: The autopilot's own id, as in `pipeline.FlightResult`.
    #: How the craft is built, and its gains and filters, as `pipeline.flight.craft.build_of` and `tune_of` list them.
    build: Mapping[str, str | float | None] = field(default_factory=dict)
    tune: Mapping[str, str | float] = field(default_factory=dict)
    #: What the flight alone says about its craft, as `pipeline.flight.summary` lists it.
    parameters: tuple[FlightParameter, ...] = ()
    responses: tuple[ResponseCurve, ...] = ()  #: Of the axes whose gain the flight tells.
    trims: SteadyTrims | None = None  #: As of the result of the flight.
    account: Account | None = None  #: What happened, and what was read.
    autopilot: tuple[AutopilotValue, ...] = ()  #: As of the result of the flight.
    findings: tuple[Finding, ...] = ()  #: What the log, the trajectory and the fits had to say.
    #: Where its products lie, below ``flights/`` of the store and as partition ``flight=`` of the datasets; empty where
    #: they are nowhere.
    folder: str = ""
    source: str = ""  #: Path or URL of the log.
    #: Equal for equal content of the log, name, configuration and software: then the result is the same too.
    key: str = ""
    #: Equal for equal pages of equal results, see `pipeline.storage.manifest.page_key`; empty where none were written.
    pages: str = ""

    @property
    def log_name(self) -> str:
        """What its log is called: of several flights that without the flight's number."""
        return self.name if self.of == 1 else self.name.rpartition("#")[0]


@dataclass(frozen=True, slots=True, kw_only=True)
class GroupEntry:
    """Several flights of one craft, identified jointly, in short."""

    name: str  #: The craft for people.
    folder: str  #: Where its products lie, below ``crafts/`` of the store.
    key: str  #: Equal for equal flights (by their keys), split, configuration and software.
    #: As of its flights.
    craft: str
    vehicle: str
    #: Names of the flights fitted and of those kept to judge.
    training: tuple[str, ...]
    held_out: tuple[str, ...]
    split: str  #: How the two were chosen, in a sentence.
    pages: str = ""  #: As of a flight.
