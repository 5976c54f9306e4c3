"""A measured frequency response with its coherence and random error: what every fit and every margin starts from."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from core.summary import Summarised
from logparse import Finding

Floats = NDArray[np.float64]
Complex = NDArray[np.complex128]

#: Below this coherence a frequency does not count (Tischler and Remple 2012, section 7.5.2).
COHERENT = 0.6

#: Standard deviation of ln G below which it is as good as one of G: beyond, chance makes some look known.
_KNOWN = 0.2

#: Fields with one value for each frequency.
OVER_FREQUENCY = (
    *("hz", "response", "coherence", "sigma", "averages", "resolution"),
    *("multiple_coherence", "direct"),
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class FrequencyResponse(Summarised):
    """Output per input over frequency, with what it is worth.

    Errors of the complex response are circular: the real and the imaginary part of ``ln G``, which are gain and phase,
    have the same standard deviation and are independent of each other. Neighbouring frequencies closer than
    `resolution` share data: their errors are correlated.
    """

    axis: str  #: ``"roll"``, ``"pitch"``, ``"yaw"`` or ``"vertical"``.
    #: What the response goes from and to, such as ``"out_roll"`` and ``"w_x"``.
    input: str
    output: str
    unit: str  #: Of output per input, SI: ``"rad/s"`` per unit of the rate controller's output for a rate axis.
    hz: Floats  #: shape (n,): Frequencies, increasing, evenly spaced in their logarithm.
    response: Complex  #: shape (n,): SI.
    #: shape (n,): Part of the output's power that the input explains, 0..1; with several inputs the partial coherence
    #: of this one, and with an instrument the part that is explained through it. Less one standard error.
    coherence: Floats
    sigma: Floats  #: shape (n,): Standard deviation of ln abs(G).
    averages: Floats  #: shape (n,): Effective number of independent averages.
    resolution: Floats  #: shape (n,): Width of the spectral window, Hz.
    multiple_coherence: Floats  #: shape (n,): Part of the output's power that all inputs explain together.
    #: ``"instrument"`` where an injected signal or a reference from outside the loop was the instrument, else
    #: ``"direct"``.
    method: str
    instrument: str  #: What the instrument was; empty without one.
    #: shape (n,): Plain regression of the output on the input: biased where a loop is closed. Equal to `response`
    #: without an instrument.
    direct: Complex
    step: float  #: Time between logged samples, s.
    #: Corner of the second-order low-pass through which the rate was measured (INS_GYRO_FILTER); None where unknown or
    #: not in the path.
    gyro_filter_hz: float | None = None
    records: tuple[str, ...] = ()  #: The records that were summed.
    duration: float = 0.0  #: Their length together, s.
    systematic: float = 0.0  #: Standard deviation of ln abs(G) that all frequencies have in common, beside `sigma`.
    #: Output per input in steady flight, where both are known as they are: specific force per throttle in hover.
    trim: float | None = None
    source: str = ""  #: What input and output were taken from, where it is not the rate controller's messages.
    findings: tuple[Finding, ...] = field(default=())
    systematic_delay: float = 0.0  #: Standard deviation of a delay that all frequencies have in common, s.
    limited: float = 0.0  #: Part of the samples in which a motor was at a limit.

    @property
    def sigma_phase(self) -> Floats:
        """Return the standard deviation of the phase, rad, shape (n,): that of ln abs(G)."""
        return self.sigma

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Return where the coherence is at least 0.6, shape (n,)."""
        return np.asarray(self.coherence >= COHERENT)

    @property
    def counts(self) -> NDArray[np.bool_]:
        """Return which frequencies count in a fit, shape (n,): coherent, and with a known error.

        What an instrument explains is right whatever its part of the output is: such a response counts beyond the
        coherent frequencies as far as its error is small, where lags part from delays.
        """
        usable = self.usable
        known = np.isfinite(self.sigma) & (np.abs(self.response) > 0.0)
        if self.method == "instrument" and usable.any():
            beyond = int(np.flatnonzero(usable)[-1]) + 1
            usable[beyond:] = np.logical_and.accumulate(self.sigma[beyond:] < _KNOWN)
        return usable & known

    @property
    def gain_db(self) -> Floats:
        """Return ``20 log10 |G|``, shape (n,); NaN where no window fits and nothing was estimated."""
        return np.where(np.isfinite(self.sigma), 20.0 * np.log10(np.maximum(np.abs(self.response), 1e-300)), np.nan)

    @property
    def phase(self) -> Floats:
        """Return the phase, continuous over frequency, rad, shape (n,); NaN where nothing was estimated."""
        return np.where(np.isfinite(self.sigma), np.unwrap(np.angle(self.response)), np.nan)

    @property
    def weight_of_points(self) -> Floats:
        """Return how many independent measurements each frequency is worth, at most one, shape (n,).

        The spacing of the grid over the width of the spectral window: neighbours closer than it share their data.
        """
        if len(self.hz) < 2:
            return np.ones(len(self.hz))
        return np.asarray(np.minimum(np.gradient(self.hz) / np.maximum(self.resolution, 1e-9), 1.0))

    def at(self, hz: Floats) -> Complex:
        """Interpolate the response: straight lines of log gain and phase over log frequency; NaN outside."""
        asked = np.log(np.asarray(hz, dtype=np.float64))
        known = np.log(self.hz)
        log_gain = np.interp(asked, known, np.log(np.maximum(np.abs(self.response), 1e-300)), np.nan, np.nan)
        return np.asarray(np.exp(log_gain) * np.exp(1j * np.interp(asked, known, np.unwrap(np.angle(self.response)))))

    def between(self, low: float, high: float) -> FrequencyResponse:
        """Return the part from `low` to `high`, Hz."""
        keep = (self.hz >= low) & (self.hz <= high)
        return replace(self, **{name: getattr(self, name)[keep] for name in OVER_FREQUENCY})

    def summary(self) -> dict[str, str]:
        """Return what responds to what, and over which band it is known."""
        good = self.hz[self.usable]
        return {
            "axis": self.axis,
            "response": f"{self.source or f'{self.input} → {self.output}'} [{self.unit}], {self.method}, "
            f"{self.duration:.0f} s",
            "band": f"{len(self.hz)} frequencies from {self.hz[0]:.2g} to {self.hz[-1]:.3g} Hz",
            "coherent": f"from {good[0]:.2g} to {good[-1]:.3g} Hz" if len(good) else "nowhere",
        }


def lagging(hz: Floats, responses: Complex, level: float) -> tuple[Floats, Floats]:
    """Return where each response first lags by a level [rad], Hz, and its phase at twice that frequency, shape (K,).

    `responses` (K, n). NaN where none does, or twice the frequency lies beyond `hz`; one that lags so from the start
    never came to it either.
    """
    phase = np.unwrap(np.angle(responses), axis=1)
    # A response to a target leads by less than a quarter turn: it lags by more than half a turn.
    phase -= np.where(phase[:, :1] > 0.5 * np.pi, 2.0 * np.pi, 0.0)
    first = np.argmax(phase <= level, axis=1)
    rows, before = np.arange(len(phase)), np.maximum(first - 1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (level - phase[rows, before]) / (phase[rows, first] - phase[rows, before])
    at = np.where(first > 0, hz[before] * (hz[first] / hz[before]) ** share, np.nan)
    return at, np.array([np.interp(2.0 * f, hz, row, right=np.nan) for f, row in zip(at, phase, strict=True)])
