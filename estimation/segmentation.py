"""The log's time cut into segments without holes, each carried by one IMU: the likeliest of those that span it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime

import numpy as np
import pandas as pd

from core.units import STANDARD_GRAVITY
from estimation import _kernels
from estimation.alignment import Alignment, align, lost, turned
from estimation.filter import COARSE, assemble, matched_scale, run
from estimation.lags import DECISIVE
from estimation.observations import Observations, find_origin, is_stuck
from estimation.place import LocalFrame, MagneticField, World, world_field
from estimation.states import SensorNoise
from estimation.timing import ACCEL, GYRO, LONGEST_HOLE, InertialSignal, sample_rate, segments, usable
from estimation.tuning import WINDOW
from logparse import Geodetic, Tables
from logparse.craft.vehicle import is_simulated
from logparse.tables import between


@dataclass(frozen=True, slots=True)
class Surroundings:
    """Where the log was flown, as far as it is known, and whether its compass is of any use."""

    origin: Geodetic | None
    frame: LocalFrame | None
    field: MagneticField | None
    world: World
    compass_useless: bool  #: Nor is then the heading that the autopilot took from it.

    @classmethod
    def of(cls, tables: Tables, date: datetime | None) -> "Surroundings":
        """Find the origin and what gravity, Earth's rotation and magnetic field are there."""
        origin = find_origin(tables)
        stuck = is_stuck(tables.mag, tables.imu)
        if origin is None:
            return cls(None, None, None, World(STANDARD_GRAVITY, np.zeros(3)), stuck)
        simulated = is_simulated(tables.parameters)
        frame = LocalFrame.at(origin, spherical=simulated)
        field = world_field(origin, tables.parameters, date)
        # The world of the firmware's simulator does not turn and has one gravity everywhere (GRAVITY_MSS).
        world = World(STANDARD_GRAVITY, np.zeros(3)) if simulated else World(frame.gravity, frame.earth_rate)
        return cls(origin, frame, field, world, stuck)


#: Segments of the log shorter than this are left out, s.
SHORTEST_SEGMENT = 2.0
FEWEST_SAMPLES = 10
#: An IMU logged slower than this cannot carry attitude from sample to sample, Hz: at the 10 Hz of telemetry, movement
#: and vibration alias so far that the autopilot's own attitude is the better guide.
SLOWEST_IMU = 15.0
#: Headings that are tried where nothing tells the heading.
HEADINGS = 8

#: Number of an IMU (0 is the first) and its samples without a hole.
Piece = tuple[int, pd.DataFrame]


@dataclass(frozen=True, slots=True)
class Segment:
    """A stretch of the log without holes in its IMU, and where it starts."""

    imu: int  #: Which IMU carries it, 0 for the first; never a mixture.
    samples: pd.DataFrame
    signal: InertialSignal
    aligned: Alignment
    #: Log-likelihood by which this IMU is better than the first one; inf where that one does not span the segment.
    gain: float = 0.0

    @property
    def length(self) -> float:
        """Time that the IMU knows, s."""
        return self.signal.stop - self.signal.start

    def rescaled(self, yaw: float) -> "Segment":
        """Return the segment with the rate about the down axis times a factor."""
        return self if yaw == 1.0 else replace(self, signal=self.signal.rescaled(yaw))


def find_segments(tables: Tables, place: Surroundings, observations: Observations, noise: SensorNoise) -> list[Segment]:
    """Cut the log at the holes that no IMU fills, and choose one IMU for each segment, in order of time."""
    pieces = [(number, piece) for number, imu in _imus(tables) for piece in segments(imu)]
    likeliest = []
    for rivals in cover(pieces):
        aligned = [_aligned(tables, rival, place, observations, noise) for rival in rivals]
        likeliest.append(_likeliest(aligned, observations, place, noise))
    return likeliest


def cover(pieces: Sequence[Piece]) -> list[list[Piece]]:
    """Cover the log's time with pieces of IMUs: the longest first, then the longest of what sticks out, and so on."""
    left = [piece for piece in pieces if _is_long(piece)]
    spans = []
    while left:
        _, longest = max(left, key=lambda piece: (piece[1].index[-1] - piece[1].index[0], -piece[0]))
        first, last = longest.index[0], longest.index[-1]
        spans.append(
            [
                (number, between(samples, first, last))
                for number, samples in left
                if samples.index[0] <= first + LONGEST_HOLE and samples.index[-1] >= last - LONGEST_HOLE
            ]
        )
        left = [rest for piece in left for rest in _outside(piece, first, last) if _is_long(rest)]
    return sorted(spans, key=lambda rivals: float(rivals[0][1].index[0]))


def _is_long(piece: Piece) -> bool:
    index = piece[1].index
    return len(index) >= FEWEST_SAMPLES and index[-1] - index[0] >= SHORTEST_SEGMENT


def _outside(piece: Piece, first: float, last: float) -> Iterator[Piece]:
    """Yield what of a piece lies before and after a span."""
    number, samples = piece
    yield number, samples[samples.index < first]
    yield number, samples[samples.index > last]


def _imus(tables: Tables) -> Iterator[tuple[int, pd.DataFrame]]:
    """Yield number and usable rows of every IMU that is logged fast enough; the first one is the caller's care."""
    for number, table in enumerate((tables.imu, *tables.others("imu"))):
        imu = usable(table, GYRO + ACCEL)
        if imu is not None and (number == 0 or sample_rate(imu) >= SLOWEST_IMU):
            yield number, imu


def _aligned(
    tables: Tables, piece: Piece, place: Surroundings, observations: Observations, noise: SensorNoise
) -> Segment:
    """Align one piece of one IMU."""
    number, samples = piece
    signal = InertialSignal.of(samples, tables.parameters, (noise.gyro, noise.accel))
    field = place.field.ned if place.field and not place.compass_useless else None
    aligned = align(tables, samples, place.frame, field, noise, heading_known=not place.compass_useless)
    segment = Segment(number, samples, signal, aligned)
    if not aligned.still:
        # What the autopilot, or a force in the air, says of the attitude may be worth nothing.
        adrift = replace(segment, aligned=lost(aligned))
        fits = [_fit(candidate, observations, place, noise, matched=True) for candidate in (segment, adrift)]
        if fits[1] - fits[0] > DECISIVE:
            segment, aligned = adrift, adrift.aligned
    if aligned.yaw_source != "unknown" or place.frame is None:
        return segment
    if not np.any(observations.between(signal.start, signal.stop).kind == _kernels.GPS_VELOCITY):
        return segment
    # Try headings all around and take that under which GPS and IMU agree best.
    step = 2.0 * np.pi / HEADINGS
    tries = [Segment(number, samples, signal, turned(aligned, k * step, 0.5 * step)) for k in range(HEADINGS)]
    return max(tries, key=lambda tried: _fit(tried, observations, place, noise))


def _fit(
    segment: Segment, observations: Observations, place: Surroundings, noise: SensorNoise, *, matched: bool = False
) -> float:
    """Return the log-likelihood of a segment's beginning with everything as documented, or white noise `matched`."""
    signal, aligned = segment.signal, segment.aligned
    outputs = np.array([signal.start])
    stop = signal.start + WINDOW
    problem = assemble(
        signal, observations, outputs, aligned.x, aligned.P, place.world, noise, stop=stop, finest=COARSE
    )
    result = run(problem, keep=False)
    if not matched:
        return result.log_likelihood
    return replace(problem, white_scale=matched_scale(problem, result)).log_likelihood


def _likeliest(rivals: list[Segment], observations: Observations, place: Surroundings, noise: SensorNoise) -> Segment:
    """Choose the IMU that agrees best with the other sensors; the first one unless it is decisively worse."""
    if len(rivals) == 1:
        return _with_gain(rivals[0], np.inf if rivals[0].imu else 0.0)
    # The same measurements for all, or the likelihoods would not compare.
    seen = observations.between(max(s.signal.start for s in rivals) + 0.1, min(s.signal.stop for s in rivals) - 0.1)
    # A compass beside motors says more of their currents than of gyros.
    if np.any(seen.kind == _kernels.GPS_VELOCITY):
        seen = seen.without(_kernels.MAG)
    fits = [_fit(segment, seen, place, noise, matched=True) for segment in rivals]
    best = int(np.argmax(fits))
    gain = fits[best] - fits[0]
    if gain <= DECISIVE:
        best, gain = 0, 0.0
    return _with_gain(rivals[best], gain if rivals[0].imu == 0 else np.inf)


def _with_gain(segment: Segment, gain: float) -> Segment:
    return Segment(segment.imu, segment.samples, segment.signal, segment.aligned, gain)
