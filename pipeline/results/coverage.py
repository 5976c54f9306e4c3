"""Coverage of a flight, and of the flights of a craft: speeds, heights, winds and quality of logging."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import atan2, hypot, pi

from logparse import Finding


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisExcitation:
    """Movement in one axis."""

    #: About the mean: of the angular rate [rad/s], or for thrust of the specific force along body z [m/s^2] in
    #: one-second means.
    rms: float
    unit: str
    #: ``"none"``, ``"weak"``, ``"fair"`` or ``"strong"``; from ``"fair"`` on identification uses the axis
    #: (`sysid.rigid_body.rotation.STILL`, `sysid.records.thrust_curve.VARYING`).
    word: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Linearity:
    """How much of an output is a linear response to the inputs."""

    multiple_median: float | None = None  #: Multiple coherence with the inputs, median over the band.
    above_chance: float | None = None  #: Part of the band's frequencies at which it is above what chance gives.


@dataclass(frozen=True, slots=True, kw_only=True)
class Movement:
    """Movement of one flight."""

    #: Of changes of velocity over one second, m/s^2: the motion that models have to explain.
    acceleration_rms: float | None
    #: The same from the estimate's own uncertainty alone, m/s^2; None where that is not known.
    acceleration_noise: float | None
    #: Standard deviation of the velocity over the ground along and across the nose, about the flight's mean velocity,
    #: m/s: what separates drag from wind.
    speed_std: tuple[float, float]
    headings: int  #: Sectors of 45 degrees in which the nose pointed for three seconds or more.
    axes: Mapping[str, AxisExcitation]  #: ``roll pitch yaw thrust``.


@dataclass(frozen=True, slots=True, kw_only=True)
class LoggedRate:
    """How fast a table was logged in flight [Hz], how many gaps it has, and the longest of them [s]."""

    rate: float
    gaps: int
    longest_gap: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PositionSigma:
    """Horizontal 1-sigma of position over a flight, m; None where it is not known."""

    median: float | None
    max: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class LogHealth:
    """How well a flight was logged; what GPS, vibration and battery read is in its account."""

    rates: Mapping[str, LoggedRate]  #: By table.
    position_sigma: PositionSigma
    settings: Mapping[str, float]  #: Parameters of the autopilot that decide what is logged.


@dataclass(frozen=True, slots=True)
class FlownQuantity:
    """A quantity whose distribution is computed: title, unit and width of its bins, which begin at multiples of it."""

    title: str
    unit: str
    step: float


#: In the order of reports.
QUANTITIES: Mapping[str, FlownQuantity] = {
    "ground_speed": FlownQuantity("ground speed", "m/s", 1.0),
    "airspeed": FlownQuantity("horizontal airspeed", "m/s", 1.0),
    "climb_rate": FlownQuantity("climb rate", "m/s", 0.5),
    "altitude": FlownQuantity("altitude above the start", "m", 5.0),
    "density": FlownQuantity("air density", "kg/m^3", 0.02),
    "thrust": FlownQuantity("mean thrust command", "part of full thrust", 0.025),
    "tilt": FlownQuantity("tilt", "rad", pi / 72),
    "yaw_rate": FlownQuantity("yaw rate", "rad/s", pi / 36),
}


#: The two quantities of the map.
MAP = ("ground_speed", "altitude")

#: Bin of ground speed, bin of altitude, seconds.
Cell = tuple[int, int, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Distribution:
    """Time that a flight spent at each value of a quantity."""

    #: Of the quantity.
    title: str
    unit: str
    #: In that unit.
    min: float
    p05: float
    median: float
    p95: float
    max: float
    step: float  #: Width of a bin.
    first: int  #: Number of the first bin: it begins at ``first * step``.
    seconds: tuple[float, ...]  #: Time in each bin from there on.


@dataclass(frozen=True, slots=True, kw_only=True)
class MeanWind:
    """Mean wind of a flight by the fit of the rigid body."""

    #: Where the air goes, 10 m above the start, m/s.
    north: float
    east: float
    #: The same as speed, m/s, and where the wind comes from, rad clockwise from north.
    speed: float
    direction: float
    sigma: float | None  #: Standard error of north and east, m/s.
    source: str

    @classmethod
    def towards(cls, north: float, east: float, sigma: float | None, source: str) -> MeanWind:
        """Return the wind whose air moves to the north and to the east at these speeds, m/s."""
        direction = atan2(-east, -north) % (2.0 * pi)
        return cls(north=north, east=east, speed=hypot(north, east), direction=direction, sigma=sigma, source=source)


@dataclass(frozen=True, slots=True, kw_only=True)
class Coverage:
    """What one flight covered."""

    seconds: float  #: Of flight.
    quantities: Mapping[str, Distribution]  #: Of those of `QUANTITIES` that are known.
    map: tuple[Cell, ...]  #: Time at each ground speed and altitude; cells without any are left out.
    wind: MeanWind | None
    excitation: Movement
    health: LogHealth
    missing: Mapping[str, str] = field(default_factory=dict)  #: Why a quantity, or the wind, is not known.


@dataclass(frozen=True, slots=True, kw_only=True)
class RangeFlown:
    """Time at each value of a quantity, of training and of held-out flights."""

    title: str
    unit: str
    step: float  #: Width of a bin.
    first: int  #: Number of the first bin, which begins at ``first * step``.
    #: s in each bin.
    training: tuple[float, ...]
    held_out: tuple[float, ...]
    #: Range that holds all but `MARGIN` of the training time at either end; None without any.
    fitted: tuple[float, float] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Excursion:
    """A held-out flight outside the range of the training flights: for which part of its time, and how far."""

    flight: str
    quantity: str
    part: float
    reach: float
    fitted: tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class EnvelopeMap:
    """Time at each ground speed and altitude, of training and of held-out flights."""

    training: tuple[Cell, ...]
    held_out: tuple[Cell, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightWind:
    """Mean wind of a flight: speed and its error [m/s], and where it came from, rad clockwise from north."""

    flight: str
    part: str
    speed: float
    direction: float
    sigma: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Envelope:
    """What the flights of a craft covered together."""

    training: tuple[str, ...]
    held_out: tuple[str, ...]
    quantities: Mapping[str, RangeFlown]  #: By the names of `pipeline.results.coverage.QUANTITIES`.
    map: EnvelopeMap
    winds: tuple[FlightWind, ...]  #: Of flights whose wind is known.
    outside: tuple[Excursion, ...]
    findings: tuple[Finding, ...]
