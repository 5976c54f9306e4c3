"""What lies beyond the measured band: modes of the frame that no chirp reached, and what noise shows of them.

A loop closes for noise as it does for a chirp: through a mode of loop gain d its spectrum swings, whatever the mode's
phase, so that 1 / |S| takes values d apart (the mode's resonance is a circle of diameter d through zero). A swing
larger than the scatter of the spectrum is a mode, or a vibration that cannot be told from one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from sysid.frequency.records import AxisRecord
from sysid.loops.controller import LoopSettings
from sysid.loops.filters import Complexes, Floats
from sysid.loops.loop import RateLoop
from sysid.loops.plant import FIRST_MODES
from sysid.records.filtering import densities

#: Factor by which a mode of 3 % damping that carries a third of the acceleration stands above the rigid craft.
MODE = 6.0

#: Gain of a mode that leaves it 4 dB.
_SMALL = 0.63

#: Last frequency of the noise's spectrum, in parts of half the logging rate; and how far beyond the band it must reach
#: to count as seen.
_TO, _SEEN = 0.92, 1.5

#: Frequency up to which the noise's floor is looked at, at the least, in parts of the band's end.
_FLOOR = 3.0

#: Where the chirp is when the noise is looked at: below this part of the first frequency, with this part of its power.
_CHIRP_BELOW, _NO_CHIRP = 0.8, 1e-4

#: Resolutions [Hz] of the spectrum, and what stands out of it: about as wide as a mode, of whose height the resolution
#: leaves little above twice the floor; and narrow as a loop that hardly keeps from ringing, at three times.
_STANDS_OUT = {1.5: 0.75, 0.5: 0.9}

#: Standard deviations of the spectrum's scatter beyond which nothing is taken for scatter; largest swing of 1 / |S| at
#: the first resolution that is (of 250 craft without modes there none reached 0.4).
_SCATTERS, _SWING = 4.5, 0.5

#: Amplification of disturbances at the end of a chirp below `FIRST_MODES` up to which its band holds the loop's peak.
AMPLIFIED = 10.0 ** (3.0 / 20.0)

#: Steps of the robust fit of the noise's floor, and the fewest frequencies that show one.
_FITS, _FEWEST = 10, 4

#: Factors by which a loop's gain may be raised beyond the measured band, each tried only where the one before leaves no
#: rejection gained, unless the rigid craft keeps it small there.
UNSEEN_RAISED = (1.12, 1.5)

#: The same where nothing is raised: rounding.
_NOT_RAISED = 1.0 + 1e-6

#: Factor of frequency at the end of the band over which the craft's slope is taken; the slopes that a craft without a
#: mode just beyond has, of ln gain over ln f (-1 for the integration, up to -1 for each lag) and of the phase [rad]
#: over ln f (lags and delays only turn it back); by how many standard deviations of the slope it must be beyond them;
#: and where they count however uncertain they are.
_LAST, _SLOPE, _SURE, _STEEP, _FORWARD = 1.2, (-3.0, -0.9), 2.5, (-3.5, -0.4), 1.0


def saw_modes(loop: RateLoop) -> bool:
    """Return whether the measured band reaches the frequencies at which frames first bend."""
    return bool(loop.plant.seen >= FIRST_MODES)


def amplified_at_end(loop: RateLoop, hz: Floats, broken: Complexes) -> Floats:
    """Return by how much broken loops, shape (K, n), amplify disturbances where a chirp ended, shape (K,).

    0 where the chirp saw the first modes of frames, and without one. Where it did not, a mode just beyond adds to what
    is left there of the loop: the peak of a craft that its chirp saw only half was 7.1 dB for 6.0 promised.
    """
    if saw_modes(loop) or loop.ordinary:
        return np.zeros(len(broken))
    last = (hz > loop.plant.seen / _LAST) & (hz <= loop.plant.seen)
    return np.asarray(1.0 / np.abs(1.0 + broken[:, last]).min(axis=1))


def may_raise(loop: RateLoop) -> tuple[float, ...]:
    """Return the factors by which the gain of a loop may rise beyond its measured band, in the order of trying.

    Without a chirp nothing looks for modes there: one at 20 Hz that left 4.3 dB was left 3.5 by a rise of a tenth.
    """
    if loop.ordinary:
        return (_NOT_RAISED,)
    return UNSEEN_RAISED if saw_modes(loop) else (_NOT_RAISED, UNSEEN_RAISED[0])


def bends_at_its_end(loop: RateLoop) -> str | None:
    """Report that the response turns at its end as by a mode of the frame there, of which little is known then.

    Up to a fifth below a mode its gain rises or falls more steeply, or its phase forward, than lags and delays let it.
    """
    end = loop.plant.seen
    last = (loop.hz > end / _LAST) & (loop.hz <= end)
    x = np.log(loop.hz[last])
    drawn = np.concatenate([loop.plant.response[None, last], loop.plant.own_draws[1:, last]])
    craft = np.log(drawn / loop.flown.gyro.response(loop.hz[last]))
    slopes, turns = (np.polyfit(x, values.T, 1)[0] for values in (craft.real, np.unwrap(craft.imag)))
    (slope, error), (turn, wrong) = ((float(draws[0]), _SURE * float(np.std(draws))) for draws in (slopes, turns))
    low, high = max(_SLOPE[0] - error, _STEEP[0]), min(_SLOPE[1] + error, _STEEP[1])
    if low <= slope <= high and turn <= min(wrong, _FORWARD):
        return None
    return (
        f"{loop.axis}: the response bends at its end, {end:.0f} Hz, as by a mode of the frame just beyond; "
        f"fly a chirp to {max(1.6 * end, 40.0):.0f} Hz with RATE at {4.0 * max(1.6 * end, 40.0):.0f} Hz or more"
    )


def raised_unseen(
    loop: RateLoop, settings: LoopSettings, candidates: Sequence[Mapping[str, float]]
) -> tuple[Floats, Floats]:
    """Return by how much changes of settings raise the loop beyond the measured band, shape (K,) each.

    As the rigid craft would continue it: the largest factor where it counts (1 where nowhere), since modes of the frame
    may stand above, and the largest anywhere, by which noise rises. Where the first modes were seen it counts only
    where a mode beyond them would.
    """
    hz, craft = _rigid(loop)
    gain = np.abs(settings.feedbacks(candidates, hz) * settings.gyro.response(hz))
    factor = gain / np.abs(loop.flown.feedback(hz) * loop.flown.gyro.response(hz))
    counts = MODE * gain * craft > _SMALL
    return np.asarray(np.maximum(np.where(counts, factor, 1.0).max(axis=1), 1.0)), np.asarray(factor.max(axis=1))


def _rigid(loop: RateLoop) -> tuple[Floats, Floats]:
    """Return frequencies beyond the band and how strongly a rigid craft would answer there: lags only lower it.

    Just below a mode the band may end in a dip, which is of the frame: no frequency of the last octave counts for less
    than a craft with one lag would leave of it at the end.
    """
    end = loop.plant.seen
    last = (loop.hz > 0.5 * end) & (loop.hz <= end)
    craft = np.abs(loop.plant.response[last] / loop.flown.gyro.response(loop.hz[last]))
    hz = np.geomspace(end, max(150.0, 1.1 * end), 24)
    return hz, float(np.max(craft * (loop.hz[last] / end) ** 2)) * end / hz


def chirp_end(loop: RateLoop) -> float:
    """Return the frequency up to which the craft was excited, Hz."""
    return float(max([loop.plant.seen, *(record.plant.band[1] for record in loop.records)]))


def unseen_mode(loop: RateLoop) -> str | None:
    """Return why nothing can be said of modes beyond the chirps: noise or response bend there, or show nothing."""
    hz, craft = _rigid(loop)
    counts = MODE * craft * np.abs(loop.flown.feedback(hz) * loop.flown.gyro.response(hz)) > _SMALL
    if not counts.any() or not loop.records:
        return None
    bends = bends_at_its_end(loop)
    if bends is not None:
        return bends
    end, highest = chirp_end(loop), float(hz[counts].max())
    nyquist = min(0.5 / record.plant.dt for record in loop.records)
    advice = f"fly a chirp to {max(1.3 * end, 40.0):.0f} Hz with RATE at {4.0 * max(end, 40.0):.0f} Hz or more"
    if end < FIRST_MODES and _TO * nyquist < min(_SEEN * end, highest):
        return f"{loop.axis}: no chirp went beyond {end:.0f} Hz, where frames bend, and RATE shows no more; {advice}"
    farthest = _SEEN * end if end >= FIRST_MODES else np.inf  # motors shake beyond, which is no mode of the frame
    mode = _standing_out(
        loop, min(1.1 * highest, farthest), min(_TO * nyquist, max(1.1 * highest, _FLOOR * end), farthest)
    )
    if mode is None:
        return None
    return (
        f"{loop.axis}: the gyro's noise stands out at {mode:.0f} Hz, beyond the chirp's {end:.0f} Hz, as by a mode of "
        f"the frame through which the loop nearly rings, or by vibration (that a harmonic notch lowers); {advice}"
    )


def _standing_out(loop: RateLoop, high: float, floor_to: float) -> float | None:
    """Return where the noise beyond the chirps stands out of its floor below `high`, Hz."""
    for resolution, least in _STANDS_OUT.items():
        spectrum = _noise(loop, resolution, loop.plant.seen, floor_to)
        if spectrum is None:
            continue
        looked_at = spectrum[0] <= max(high, spectrum[0][_FEWEST - 1])
        looked_at[0] = False  # still the measured band's
        hz, rest, scatter = spectrum[0][looked_at], spectrum[1][looked_at], spectrum[2]
        inverse = np.exp(-0.5 * rest)
        swings = resolution == max(_STANDS_OUT) and inverse.max() - inverse.min() > _SWING
        if rest.max() > max(least, _SCATTERS * scatter) or swings:
            return float(hz[np.argmax(rest)])
    return None


def _noise(loop: RateLoop, resolution: float, low: float, high: float) -> tuple[Floats, Floats, float] | None:
    """Return the noise before the gyro's filter over its floor: Hz, logarithm of power, and how much that scatters.

    Less what the loop makes of it by the models that fit below, and what they leave open: the rest is of no such craft.
    """
    step = loop.records[0].plant.dt
    size = round(1.0 / (step * resolution))
    hz = np.asarray(np.fft.rfftfreq(size, step), np.float64)
    kept = (hz >= low) & (hz <= high)
    alike = [r.plant for r in loop.records if np.isclose(r.plant.dt, step, rtol=1e-3)]
    windows = [_without_chirp(plant, size, hz > _CHIRP_BELOW * low)[:, kept] for plant in alike]
    power = np.concatenate(windows)
    if kept.sum() < _FEWEST or len(power) < _FEWEST:
        return None
    hz = hz[kept]
    noise = np.log(power.mean(axis=0) / np.abs(loop.flown.gyro.response(hz)) ** 2)
    known = np.searchsorted(loop.hz, hz[hz <= loop.hz[-1]])
    closed = 2.0 * np.log(np.abs(1.0 + np.vstack([loop.response, loop.own_draws])[:, known]))
    noise[: len(known)] += closed[0]
    floor = np.column_stack([np.ones(len(hz)), np.log(hz), (hz[0] / hz) ** 4])[:, : 3 if len(hz) > 8 else 2]
    weight = np.ones(len(hz))
    for _ in range(_FITS):
        rest = noise - floor @ np.linalg.lstsq(floor * weight[:, None], noise * weight, rcond=None)[0]
        rest = rest - np.median(rest)
        weight = 1.0 / np.sqrt(1.0 + (rest / (1.5 * np.median(np.abs(rest)) + 0.1)) ** 2)
    left_open = np.zeros(len(hz))
    left_open[: len(known)] = 2.0 * closed.std(axis=0)
    rest = np.sign(rest) * np.maximum(np.abs(rest) - left_open, 0.0)
    return np.asarray(hz, np.float64), np.asarray(rest, np.float64), float(1.0 / np.sqrt(len(power)))


def _without_chirp(record: AxisRecord, size: int, above: NDArray[np.bool_]) -> Floats:
    """Compute power spectra of the rate in windows in which the chirp has not reached the frequencies `above`."""
    if len(record.output) < 2 * size or not above.any():
        return np.empty((0, len(above)))
    signals = (record.instruments[:, 0], record.output)
    windows = (np.lib.stride_tricks.sliding_window_view(signal, size)[:: size // 2] for signal in signals)
    chirp, power = (densities(np.asarray(window, np.float64), 1.0 / record.dt) for window in windows)
    reached = chirp[:, above].sum(axis=1)
    return np.asarray(power[reached < _NO_CHIRP * reached.max()])


def promised(tuned: RateLoop, bounds: Mapping[str, float], aim: Mapping[str, float]) -> dict[str, float]:
    """Return bounds that a mode just beyond the measured band does not break either: of what is kept, not more."""
    hz, craft = _rigid(tuned)
    settings = tuned.settings
    beyond = MODE * float((craft * np.abs(settings.feedback(hz) * settings.gyro.response(hz)))[0])
    gain, peak = -20.0 * np.log10(beyond), -20.0 * np.log10(max(1.0 - beyond, 1e-3))
    result = dict(bounds)
    result["gain_db"] = min(bounds["gain_db"], max(gain, aim["gain_db"]))
    result["peak_db"] = max(bounds["peak_db"], min(peak, aim["peak_db"]))
    if beyond > _SMALL:
        result["phase_deg"] = min(bounds["phase_deg"], aim["phase_deg"])
    return result
