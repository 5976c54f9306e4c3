"""Cross-spectra of overlapped, tapered windows, summed over records, and the responses that follow from them.

Transforms are taken exactly at the frequencies of a logarithmic grid, as a chirp-z transform takes them at those of a
linear one (Tischler and Remple 2012, section 7.3), of the record thinned out to what the window's band asks for.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sysid.frequency._window_kernels import halved, products
from sysid.frequency.records import AxisRecord, Logged
from sysid.frequency.response import Complex, Floats
from sysid.records.filtering import detrended, hann, low_pass_taps

#: Cycles of a frequency in a window that serves it: with fewer, leakage from the trend and its neighbours bends the
#: response; with more, shorter windows give more averages.
FEWEST_CYCLES, MOST_CYCLES = 3.0, 60.0

#: Filter before every second sample is dropped.
_HALVING = low_pass_taps(41, 0.25)

#: Holes shorter than this part of a cycle are bridged without harm: command and answer in the same way, which nearly
#: cancels in their ratio. Otherwise one lost row in three would leave no window whole.
_GAP = 0.3

#: Width of a Hann window's equivalent noise bandwidth in 1/T.
HANN_BANDWIDTH = 1.5

#: In single precision.
Singles = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class DrivingSums:
    """Sums over windows of products of transforms of what drives an axis; those of several records add up."""

    #: shape (F, m, m): Instruments by instruments, instruments by inputs, inputs by inputs.
    zz: Complex
    zx: Complex
    xx: Complex
    noise_gain: Complex  #: shape (F, m, m): ``Z^H C Z`` with the correlation C that overlapping windows give to noise.
    windows: float
    independent: float  #: Number of independent windows that the overlapping ones are worth.
    #: Number of those in which the first instrument moved: all that is known of its axis may come from one kick, which
    #: no rest before and after it confirms.
    moved: float

    def __add__(self, other: DrivingSums) -> DrivingSums:
        return DrivingSums(*(getattr(self, name) + getattr(other, name) for name in self.__slots__))


@dataclass(frozen=True, slots=True, eq=False)
class AnswerSums:
    """Sums over windows of products of transforms with those of an output; those of several records add up."""

    #: shape (F, m): With instruments, with inputs.
    zy: Complex
    xy: Complex
    yy: Floats  #: shape (F,)

    def __add__(self, other: AnswerSums) -> AnswerSums:
        return AnswerSums(*(getattr(self, name) + getattr(other, name) for name in self.__slots__))


@dataclass(frozen=True, slots=True, eq=False)
class WindowEstimate:
    """Responses to all inputs from windows of one length."""

    response: Complex  #: shape (F, m)
    direct: Complex  #: shape (F, m): By plain regression on the inputs.
    sigma: Floats  #: shape (F, m): Standard deviation of ln |G|; infinite where nothing is known.
    coherence: Floats  #: shape (F, m): Partial.
    multiple: Floats  #: shape (F,)
    length: float  #: Of the windows, s.


def window_lengths(shortest_record: float, low: float, high: float) -> Floats:
    """Choose window lengths, s, longest first: five or more, from half of a record down to what `high` needs."""
    longest = min(0.5 * shortest_record, 8.0 / low)
    shortest = min(max(20.0 / high, 0.4), longest / 2.0)
    count = max(5, int(np.ceil(np.log2(longest / shortest))) + 1)
    return np.geomspace(longest, shortest, count)


def band_of_window(length: float, lengths: Floats, hz: Floats) -> NDArray[np.bool_]:
    """Return which frequencies windows of one length serve; the longest and the shortest serve what is left.

    `lengths` (windows,): all lengths, s, longest first; `hz` (n,): frequencies, Hz. Returns (n,).
    """
    low = 1.5 / length if length == lengths[0] else FEWEST_CYCLES / length
    high = np.inf if length == lengths[-1] else MOST_CYCLES / length
    return np.asarray((hz >= low) & (hz <= high))


class ThinnedSignals:
    """Signals without trend, and what is left of them at half, a quarter, ... of their rate, made when asked for."""

    def __init__(self, signals: Logged) -> None:
        straight = detrended(signals.astype(np.float64, copy=False))
        self._rates: list[Logged] = [straight.astype(signals.dtype, copy=False)]

    def at(self, halvings: int) -> Logged:
        """Return them at a rate that was halved so often, shape (N / 2^halvings, columns)."""
        while len(self._rates) <= halvings:
            self._rates.append(_half_rate(self._rates[-1]))
        return self._rates[halvings]


def _half_rate(signals: Logged) -> Logged:
    """Return every second sample of signals, shape (N, columns), without what would fold; edges are held."""
    reach = len(_HALVING) // 2
    result = np.empty(((len(signals) + 1) // 2, signals.shape[1]), signals.dtype)
    for column, values in zip(result.T, signals.T, strict=True):
        column[:] = halved(np.pad(values.astype(np.float64), reach, "edge")[None], _HALVING)[:, 0]
    return result


def thinned(record: AxisRecord, high: float) -> AxisRecord:
    """Return a record at the lowest of its halved rates that holds frequencies up to `high` [Hz]."""
    halvings = _halvings(record, high)
    if not halvings:
        return record
    driving, instruments = _driving(record)
    signals = np.column_stack([driving, record.output])
    for _ in range(halvings):
        signals = _half_rate(signals)
    every = 2**halvings
    return replace(
        record,
        dt=record.dt * every,
        inputs=signals[:, : record.inputs.shape[1]],
        output=signals[:, -1],
        instruments=signals[:, instruments],
        usable=np.logical_and.reduceat(record.usable, np.arange(0, len(record.usable), every)),
    )


def _halvings(record: AxisRecord, high: float) -> int:
    """Return how often the rate of a record can be halved for frequencies up to `high` [Hz]."""
    return max(int(np.log2(1.0 / (record.dt * 3.0 * high))), 0)


@dataclass(frozen=True, slots=True, eq=False)
class RecordWindows:
    """Windows of one length over a record, with all that does not depend on its output.

    A model is taken out of the output again and again; inputs and instruments stay.
    """

    #: shape (K, q, 2, F): Transforms of the inputs, then of the instruments that are not inputs, in each of K windows.
    columns: Singles
    instruments: list[int]  #: Column of each instrument.
    phase: Logged  #: shape (size, 2 F): What a window is multiplied by, real parts before imaginary ones.
    differenced: Complex  #: shape (F,): What differences have made of the output.
    starts: NDArray[np.intp]  #: shape (K,)
    halvings: int  #: Of the record's rate.
    driving: DrivingSums

    def sums(self, output: ThinnedSignals) -> AnswerSums:
        """Sum the products with an output."""
        y = _transforms(output.at(self.halvings), self.starts, self.phase)
        found = _products(self.columns, y, self.starts)[..., 0] / self.differenced[:, None]
        inputs = self.driving.xx.shape[1]
        return AnswerSums(
            zy=found[:, self.instruments],
            xy=found[:, :inputs],
            yy=np.einsum("kcpf,kcpf->f", y, y, dtype=np.float64) / np.abs(self.differenced) ** 2,
        )


def windows_of(record: AxisRecord, hz: Sequence[Floats], lengths: Sequence[float]) -> Iterator[RecordWindows | None]:
    """Cut a record into overlapping windows of several lengths, s; yields None where none fits into it."""
    driving, instruments = _driving(record)
    signals = ThinnedSignals(driving)
    for length, served in zip(lengths, hz, strict=True):
        yield _windows_of(record, signals, instruments, served, length)


def _driving(record: AxisRecord) -> tuple[Logged, list[int]]:
    """Return inputs and those instruments that are none of them, and the column of each instrument."""
    m = record.inputs.shape[1]
    # The outputs of other axes are instruments of themselves.
    other = [k for k in range(m) if not np.array_equal(record.instruments[:, k], record.inputs[:, k])]
    instruments = [m + other.index(k) if k in other else k for k in range(m)]
    return np.column_stack([record.inputs, record.instruments[:, other]]), instruments


def _windows_of(
    record: AxisRecord, every_rate: ThinnedSignals, instruments: list[int], hz: Floats, length: float
) -> RecordWindows | None:
    m = record.inputs.shape[1]
    halvings = _halvings(record, float(hz[-1]))
    signals, dt = every_rate.at(halvings), record.dt * 2**halvings
    usable = _bridged(record.usable, _GAP / (record.dt * float(hz[-1])))[:: 2**halvings]
    size = round(length / dt)
    if size < 16 or size > len(signals):
        return None
    hop = max(int(0.2 * size), 1)
    starts = np.arange(0, len(signals) - size + 1, hop)
    whole = np.concatenate([[0], np.cumsum(usable)])
    starts = starts[whole[starts + size] - whole[starts] >= 0.97 * size]
    if not len(starts):
        return None
    taper = hann(size)
    turning = np.exp(-2j * np.pi * np.outer(np.arange(size) * dt, hz)).astype(np.complex128)
    phase = _detrended(np.asarray(taper[:, None] * turning, dtype=np.complex128)) * np.sqrt(dt / np.sum(taper**2))
    both = np.hstack([phase.real, phase.imag]).astype(signals.dtype)
    columns = _transforms(signals, starts, both)
    count = float(len(starts))
    own = _products(columns, columns, starts)
    outside = sorted(set(instruments))
    among = [outside.index(column) for column in instruments]
    shares = np.einsum("kpf,kpf->k", *[columns[:, instruments[0]]] * 2, dtype=np.float64)
    between, worth = _overlapped(np.take(columns, outside, axis=1), taper, starts // hop, hop, dt * hz)
    gain = own[:, outside][:, :, outside] + between
    sums = DrivingSums(
        zz=own[:, instruments][:, :, instruments],
        zx=own[:, instruments, :m],
        xx=own[:, :m, :m],
        noise_gain=gain[:, among][:, :, among],
        windows=count,
        independent=worth(np.ones(len(starts))),
        moved=worth(shares),
    )
    difference = record.difference_response(hz) if record.differenced else np.ones(len(hz), dtype=np.complex128)
    return RecordWindows(columns, instruments, both, difference, starts, halvings, sums)


def _bridged(usable: NDArray[np.bool_], longest: float) -> NDArray[np.bool_]:
    """Return which samples count when holes up to `longest` samples do."""
    if usable.all():
        return usable
    edges = np.flatnonzero(np.diff(np.concatenate([[False], ~usable, [False]]).astype(int)))
    counted = usable.copy()
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        counted[start:stop] = stop - start <= longest
    return counted


def _products(left: Singles, right: Singles, places: NDArray[np.intp], turns: Complex | None = None) -> Complex:
    """Sum products of transforms over windows, shape (F, q, r); between windows with `turns`, shape (M, F)."""
    count = left.shape[-1]
    parts = np.empty((0, 2, count)) if turns is None else np.stack([turns.real, turns.imag], axis=1)
    found = products(left, right, places, parts)
    return np.asarray(np.moveaxis(found[:, :, 0] + 1j * found[:, :, 1], 2, 0))


def _transforms(signals: Logged, starts: NDArray[np.intp], phase: Logged) -> Singles:
    """Transform every window of every signal, shape (K, columns, 2, F)."""
    size, numbers = phase.shape
    columns = signals.shape[1]
    windows = np.lib.stride_tricks.sliding_window_view(signals, size, axis=0)
    # Kept for every length of window of every signal: single precision is far below the noise of any flight.
    result = np.empty((len(starts), columns, 2, numbers // 2), dtype=np.float32)
    # Copied at once, overlapping windows take many times the memory of a flight.
    step = max((1 << 17) // (size * columns), 1)
    for first in range(0, len(starts), step):
        piece = slice(first, first + step)
        result[piece].reshape(-1, numbers)[:] = windows[starts[piece]].reshape(-1, size) @ phase
    return result


def _detrended(transform: Complex) -> Complex:
    """Remove mean and slope of a window from its transform, which does to every window what detrending it does."""
    size = len(transform)
    line = np.column_stack([np.ones(size), np.arange(size) - 0.5 * (size - 1)])
    line /= np.linalg.norm(line, axis=0)
    return np.asarray(transform - line @ (line.T @ transform))


def _overlapped(
    columns: Singles, taper: Floats, places: NDArray[np.intp], hop: int, cycles: Floats
) -> tuple[Complex, Callable[[Floats], float]]:
    """Weigh products between different windows by the correlation that noise has in them, where they overlap.

    `columns` (K, q, 2, F); `taper` (size,); `places` (K,): of the windows, in hops; `cycles` (F,): of each frequency in
    a sample. Returns `between` (F, q, q): sum over all pairs of windows; those farther apart than their length have no
    correlation; and what tells of weights of the windows how many independent ones they are worth.
    """
    size = len(taper)
    spectrum = np.fft.rfft(taper, 2 * size)
    product = np.fft.irfft(np.abs(spectrum) ** 2, 2 * size)[:size]
    lags = np.arange(hop, size, hop)
    weights = product[lags] / product[0]
    # Each transform has the clock of its own window.
    turns = weights[:, None] * np.exp(2j * np.pi * np.outer(lags, cycles))

    def worth(shares: Floats) -> float:
        squares = float(shares @ shares)
        for apart in range(1, len(places)):
            far = places[apart:] - places[:-apart]
            near = far <= len(lags)
            if not near.any():
                break
            both = (shares[apart:] * shares[:-apart])[near]
            squares += 2.0 * float(both @ weights[far[near] - 1] ** 2)
        return float(shares.sum()) ** 2 / max(squares, 1e-300)

    between = _products(columns, columns, places, turns)
    return between + np.swapaxes(between, 1, 2).conj(), worth


@dataclass(frozen=True, slots=True, eq=False)
class Regression:
    """How responses follow from products with an output.

    With instruments Z, inputs X and output Y the response is ``G = (Z^H X)^-1 Z^H Y``, which is regression where Z is
    X; its covariance ``(Z^H X)^-1 Z^H C Z (Z^H X)^-H S_ee`` with the spectrum S_ee of the remainder ``Y - X G``
    (Söderström and Stoica 1989, section 8.2; for joint input-output spectra Tischler and Remple 2012, section 8.2).
    """

    #: shape (F, m, m): Inverse of instruments by inputs, of inputs by inputs, and the latter.
    inverse: Complex
    direct: Complex
    xx: Complex
    #: shape (F, m): Variances of the responses, of noise of which all windows together have one, and of instruments.
    noise_gain: Floats
    own: Floats
    windows: float
    #: Factor by which the remainder is smaller than noise, as responses were fitted to it.
    freedom: float

    @classmethod
    def of(cls, sums: DrivingSums) -> Regression | None:
        """Invert the sums; None where there are too few windows to know the error of a response."""
        others = sums.zx.shape[1] - 1
        if min(sums.independent - others, sums.moved) < 1.5:
            return None
        inverse = np.asarray(np.linalg.pinv(sums.zx), dtype=np.complex128)

        def through(products: Complex) -> Floats:
            return np.asarray(np.einsum("fij,fjk,fik->fi", inverse, products, inverse.conj()).real)

        return cls(
            inverse=inverse,
            direct=np.asarray(np.linalg.pinv(sums.xx), dtype=np.complex128),
            xx=sums.xx,
            noise_gain=through(sums.noise_gain),
            own=through(sums.zz),
            windows=sums.windows,
            freedom=(1.0 - others / sums.independent) * (1.0 - 1.0 / sums.moved),
        )

    def responses(self, sums: AnswerSums, length: float, known: Complex | None = None) -> WindowEstimate:
        """Estimate responses from products with an output.

        `known` (F,): response to the first input that was taken out of the output beforehand.
        """
        response = (self.inverse @ sums.zy[..., None])[..., 0]
        direct = (self.direct @ sums.xy[..., None])[..., 0]

        def explained() -> Floats:
            return np.asarray(np.einsum("fi,fij,fj->f", response.conj(), self.xx, response).real)

        rest = sums.yy - 2.0 * np.einsum("fi,fi->f", response.conj(), sums.xy).real + explained()
        rest = np.maximum(rest, 1e-14 * sums.yy)
        noise = _smooth(rest / self.windows) / self.freedom
        if known is not None:
            response[:, 0] += known
            direct[:, 0] += known
        power = np.abs(response) ** 2
        with np.errstate(divide="ignore", invalid="ignore"):
            sigma = np.sqrt(0.5 * self.noise_gain * noise[:, None] / power)
            coherent = power / self.own
            coherence = coherent / (coherent + noise[:, None] * self.windows)
            multiple = 1.0 - rest / (rest + explained())
        sigma = np.where(np.isfinite(sigma), sigma, np.inf)
        return WindowEstimate(
            response, direct, sigma, np.nan_to_num(np.clip(coherence, 0.0, 1.0)), np.nan_to_num(multiple), length
        )


def _smooth(power: Floats) -> Floats:
    """Average a spectrum of noise over a few neighbouring frequencies: few windows know it badly."""
    kernel = np.ones(5)
    weight = np.convolve(np.ones(len(power)), kernel, "same") if len(power) >= len(kernel) else None
    if weight is None:
        return np.full(len(power), float(np.mean(power)))
    return np.asarray(np.convolve(power, kernel, "same") / weight)
