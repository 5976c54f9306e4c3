"""Cross-spectra of overlapped, tapered windows, summed over records, and the responses that follow from them.

Transforms are taken exactly at the frequencies of a logarithmic grid, as a chirp-z transform takes them at those of a
linear one (Tischler and Remple 2012, section 7.3), of the record thinned out to what the window's band asks for.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.compiled import njit
from core.kernel_types import Int64s, Stack
from core.runs import runs
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

#: Transforms are kept as real numbers, shape (K, q, 2, F): of K windows and q signals the real and the imaginary parts
#: at F frequencies, which the innermost loops go along.
Transforms = Annotated[NDArray[np.float32] | NDArray[np.float64], np.empty((0, 0, 0, 0), np.float32)]


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def halved(padded: Floats, taps: Floats) -> Floats:
    """Filter signals and keep every second sample.

    `padded` (q, N): N at least as many as the taps; `taps` (n,). Returns ((N - n) // 2 + 1, q).
    """
    count = (padded.shape[1] - taps.size) // 2 + 1
    result = np.empty((count, padded.shape[0]))
    for signal in range(padded.shape[0]):
        for k in range(count):
            total = 0.0
            for i in range(taps.size):
                total += padded[signal, 2 * k + i] * taps[i]
            result[k, signal] = total
    return result


@njit(cache=True, nogil=True)
def products(left: Transforms, chosen: Int64s, right: Transforms, places: Int64s, turns: Stack) -> Floats:
    """Sum the products of the transforms of one set of signals, conjugate, with those of another over windows.

    `left` (K, c, 2, F), of which the q signals `chosen` count; `right` (K, r, 2, F); `places` (K,): place of each
    window, ascending, in the unit by which windows are shifted; `turns` (M, 2, F): weight and turn of the products
    between a window and one that comes 1, 2, ... M units later, whose transform is the conjugate one. With M = 0
    windows meet themselves, and nothing else.
    Returns (q, r, 2, F).
    """
    windows, _, _, count = left.shape
    result = np.zeros((chosen.size, right.shape[1], 2, count))
    met = np.empty((2, count))
    for k in range(windows):
        for i, signal in enumerate(chosen):
            if turns.shape[0] == 0:
                for f in range(count):
                    met[0, f], met[1, f] = left[k, signal, 0, f], left[k, signal, 1, f]
            else:
                for f in range(count):
                    met[0, f] = met[1, f] = 0.0
                for other in range(k + 1, windows):
                    apart = places[other] - places[k]
                    if apart > turns.shape[0]:
                        break
                    for f in range(count):
                        a, b = left[other, signal, 0, f], left[other, signal, 1, f]
                        x, y = turns[apart - 1, 0, f], turns[apart - 1, 1, f]
                        # The conjugate of the turn, since the transform is conjugate below.
                        met[0, f] += a * x + b * y
                        met[1, f] += b * x - a * y
            for j in range(right.shape[1]):
                for f in range(count):
                    a, b, x, y = met[0, f], met[1, f], right[k, j, 0, f], right[k, j, 1, f]
                    result[i, j, 0, f] += a * x + b * y
                    result[i, j, 1, f] += a * y - b * x
    return result


class DrivingSums(NamedTuple):
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


class AnswerSums(NamedTuple):
    """Sums over windows of products of transforms with those of an output; those of several records add up."""

    #: shape (F, m): With instruments, with inputs.
    zy: Complex
    xy: Complex
    yy: Floats  #: shape (F,)


@dataclass(frozen=True, slots=True, eq=False)
class WindowEstimate:
    """Response to the first input from windows of one length, or of several merged; all of shape (F,)."""

    response: Complex
    direct: Complex  #: By plain regression on the inputs.
    sigma: Floats  #: Standard deviation of ln |G|; infinite where nothing is known.
    coherence: Floats  #: Partial.
    multiple: Floats
    resolution: Floats  #: Width of the spectral window, Hz.


def merged(parts: Sequence[tuple[NDArray[np.bool_], WindowEstimate]]) -> WindowEstimate:
    """Merge estimates of several window lengths by their random error, each with the frequencies, of all, that it has.

    Weights are the fourth power of the smallest error over each window's own (Tischler and Remple 2012, eq. 10.3).
    The windows share their data: errors are averaged as they are, not reduced.
    """
    count = (len(parts), len(parts[0][0]))
    sigma = np.full(count, np.inf)
    response, direct = np.ones(count, dtype=complex), np.ones(count, dtype=complex)
    coherence, multiple, width = np.zeros(count), np.zeros(count), np.zeros(count)
    for k, (mask, part) in enumerate(parts):
        sigma[k, mask], width[k, mask] = part.sigma, part.resolution
        response[k, mask], direct[k, mask] = part.response, part.direct
        coherence[k, mask], multiple[k, mask] = part.coherence, part.multiple
    best, at = np.argmin(sigma, axis=0), np.arange(count[1])
    with np.errstate(invalid="ignore"):
        weight = np.where(np.isfinite(sigma), (sigma[best, at] / np.maximum(sigma, 1e-300)) ** 4, 0.0)
    known = np.sum(weight, axis=0) > 0.0
    weight[best[~known], at[~known]] = 1.0
    weight /= np.sum(weight, axis=0)

    def mean_log(values: Complex) -> Complex:
        first = values[best, at]
        with np.errstate(divide="ignore", invalid="ignore"):
            apart = np.where(weight > 0.0, np.log(values / first), 0.0)
        return np.asarray(first * np.exp(np.sum(weight * apart, axis=0)))

    return WindowEstimate(
        response=mean_log(response),
        direct=mean_log(direct),
        sigma=np.where(known, np.sum(weight * np.where(weight > 0.0, sigma, 0.0), axis=0), np.inf),
        coherence=np.where(known, np.sum(weight * coherence, axis=0), 0.0),
        multiple=np.sum(weight * multiple, axis=0),
        resolution=np.sum(weight * width, axis=0),
    )


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
        answers = _products(self.columns, y, self.starts)[..., 0] / self.differenced[:, None]
        inputs = self.driving.xx.shape[1]
        return AnswerSums(
            zy=answers[:, self.instruments],
            xy=answers[:, :inputs],
            yy=np.einsum("kcpf,kcpf->f", y, y, dtype=np.float64) / np.abs(self.differenced) ** 2,
        )


def windows_of(record: AxisRecord, hz: Sequence[Floats], lengths: Sequence[float]) -> Iterator[RecordWindows | None]:
    """Cut a record into overlapping windows of several lengths, s; yields None where none fits into it."""
    driving, instruments = _driving(record)
    signals = ThinnedSignals(driving)
    del driving
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
    between, worth = _overlapped(columns, outside, taper, starts // hop, hop, dt * hz)
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
    counted = usable.copy()
    for start, stop in runs(~usable):
        counted[start:stop] = stop - start <= longest
    return counted


def _products(
    left: Singles,
    right: Singles,
    places: NDArray[np.intp],
    chosen: Sequence[int] | None = None,
    turns: Complex | None = None,
) -> Complex:
    """Sum products of transforms over windows, shape (F, q, r); between windows with `turns`, shape (M, F)."""
    count = left.shape[-1]
    signals = np.asarray(range(left.shape[1]) if chosen is None else chosen, dtype=np.int64)
    parts = np.empty((0, 2, count)) if turns is None else np.stack([turns.real, turns.imag], axis=1)
    halves = products(left, signals, right, places, parts)
    return np.asarray(np.moveaxis(halves[:, :, 0] + 1j * halves[:, :, 1], 2, 0))


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
    columns: Singles, chosen: Sequence[int], taper: Floats, places: NDArray[np.intp], hop: int, cycles: Floats
) -> tuple[Complex, Callable[[Floats], float]]:
    """Weigh products between different windows by the correlation that noise has in them, where they overlap.

    `columns` (K, c, 2, F), of which the q `chosen` count; `taper` (size,); `places` (K,): of the windows, in hops;
    `cycles` (F,): of each frequency in a sample.
    Returns `between` (F, q, q): sum over all pairs of windows; those farther apart than their length have no
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

    between = _products(columns, columns, places, chosen, turns)[:, :, chosen]
    return between + np.swapaxes(between, 1, 2).conj(), worth


@dataclass(frozen=True, slots=True, eq=False)
class SpectralRegression:
    """How responses follow from products with an output.

    With instruments Z, inputs X and output Y the response is ``G = (Z^H X)^-1 Z^H Y``, which is regression where Z is
    X; its covariance ``(Z^H X)^-1 Z^H C Z (Z^H X)^-H S_ee`` with the spectrum S_ee of the remainder ``Y - X G``
    (Söderström and Stoica 1989, section 8.2; for joint input-output spectra Tischler and Remple 2012, section 8.2).
    """

    #: shape (F, m, m): Inverse of instruments by inputs, of inputs by inputs, and the latter.
    inverse: Complex
    direct: Complex
    xx: Complex
    #: shape (F,): Variances of the first response, of noise of which all windows together have one, and of instruments.
    noise_gain: Floats
    own: Floats
    windows: float
    length: float  #: Of the windows, s.
    #: Factor by which the remainder is smaller than noise, as responses were fitted to it.
    freedom: float

    @classmethod
    def of(cls, records: Sequence[DrivingSums], length: float) -> SpectralRegression | None:
        """Invert the sums of records; None where there are too few windows to know the error of a response."""
        if not records:
            return None
        sums = DrivingSums(*(sum(record[1:], record[0]) for record in zip(*records, strict=True)))
        others = sums.zx.shape[1] - 1
        if min(sums.independent - others, sums.moved) < 1.5:
            return None
        inverse = np.asarray(np.linalg.pinv(sums.zx), dtype=np.complex128)

        def through(products: Complex) -> Floats:
            first = inverse[:, 0]
            return np.asarray(np.einsum("fj,fjk,fk->f", first, products, first.conj()).real)

        return cls(
            inverse=inverse,
            direct=np.asarray(np.linalg.pinv(sums.xx), dtype=np.complex128),
            xx=sums.xx,
            noise_gain=through(sums.noise_gain),
            own=through(sums.zz),
            windows=sums.windows,
            length=length,
            freedom=(1.0 - others / sums.independent) * (1.0 - 1.0 / sums.moved),
        )

    def estimate(self, records: Sequence[AnswerSums], known: Complex | None = None) -> WindowEstimate:
        """Estimate the first response from products with an output.

        `known` (F,): response to the first input that was taken out of the output beforehand.
        """
        sums = AnswerSums(*(sum(record[1:], record[0]) for record in zip(*records, strict=True)))
        responses = (self.inverse @ sums.zy[..., None])[..., 0]
        response, direct = responses[:, 0], (self.direct @ sums.xy[..., None])[:, 0, 0]
        shared = np.einsum("fi,fij,fj->f", responses.conj(), self.xx, responses).real
        rest = sums.yy - 2.0 * np.einsum("fi,fi->f", responses.conj(), sums.xy).real + shared
        rest = np.maximum(rest, 1e-14 * sums.yy)
        noise = _smooth(rest / self.windows) / self.freedom
        if known is not None:
            response, direct = response + known, direct + known
            responses[:, 0] = response
            shared = np.einsum("fi,fij,fj->f", responses.conj(), self.xx, responses).real
        power = np.abs(response) ** 2
        with np.errstate(divide="ignore", invalid="ignore"):
            sigma = np.sqrt(0.5 * self.noise_gain * noise / power)
            coherent = power / self.own
            coherence = coherent / (coherent + noise * self.windows)
            multiple = 1.0 - rest / (rest + shared)
        return WindowEstimate(
            response,
            direct,
            np.where(np.isfinite(sigma), sigma, np.inf),
            np.nan_to_num(np.clip(coherence, 0.0, 1.0)),
            np.nan_to_num(multiple),
            np.full(len(response), HANN_BANDWIDTH / self.length),
        )


def _smooth(power: Floats) -> Floats:
    """Average a spectrum of noise over a few neighbouring frequencies: few windows know it badly."""
    kernel = np.ones(5)
    weight = np.convolve(np.ones(len(power)), kernel, "same") if len(power) >= len(kernel) else None
    if weight is None:
        return np.full(len(power), float(np.mean(power)))
    return np.asarray(np.convolve(power, kernel, "same") / weight)
