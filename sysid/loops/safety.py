"""What a proposal must keep: margins at the worst of the 95 % set, actuator noise, and those of axes that stay."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from logparse import FlightLog
from sysid.loops.filters import Floats
from sysid.loops.loop import RateLoop
from sysid.loops.margins import margins_of
from sysid.loops.unseen import may_raise, raised_unseen

#: Part of the draws beyond the bound of each margin: so few that gain margin, phase margin, peak and rejection hold
#: together for 95 % of what the data leave possible, and more.
TAIL = 0.005

#: Standard deviations of the draws that the bound leaves at the least.
DEVIATIONS = 3.0

#: Least gain, dB, and phase, deg, that another filter of the gyro may take from an axis whose gains stay.
_BYSTANDER_GAIN, _BYSTANDER_PHASE = 0.5, 3.0

#: Margins of an aim in words, with the sign of those of which more is better.
MARGIN_WORDS = {
    "gain_db": (1.0, "dB of gain margin"),
    "phase_deg": (1.0, "deg of phase margin"),
    "peak_db": (-1.0, "dB of peak"),
}

#: Median of horizontal vibration, m/s^2, from which the gyro filter is not opened.
_CALM = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Aim:
    """What a tune must keep, at the worst of the 95 % set.

    `noise` is the largest factor by which rms and slew of the actuators' noise may rise over the flown settings, and
    the controller's gain at any frequency beyond the measured band.
    """

    gain_db: float = 6.0
    phase_deg: float = 45.0
    peak_db: float = 6.0
    noise: float = 1.5

    def at_least(self, flown: Mapping[str, float]) -> Aim:
        """Return the same, and in nothing less than margins that flew."""
        return Aim(
            gain_db=max(self.gain_db, flown["gain_db"]),
            phase_deg=max(self.phase_deg, flown["phase_deg"]),
            peak_db=min(self.peak_db, flown["peak_db"]),
        )

    def missed_by(self, margins: Mapping[str, float]) -> float:
        """Return by which part margins miss the aim where they miss it most; negative where they keep it."""
        return float(self.all_missed_by(margins))

    def all_missed_by(self, margins: Mapping[str, float | Floats]) -> Floats:
        """Return the same of K loops, shape (K,); a gain margin that the band does not show is kept."""
        gain = np.where(np.isnan(margins["gain_db"]), np.inf, margins["gain_db"])
        phase, peak = 1.0 - margins["phase_deg"] / self.phase_deg, margins["peak_db"] / self.peak_db - 1.0
        return np.asarray(np.maximum(np.maximum(1.0 - gain / self.gain_db, phase), peak))

    def lacking(self, margins: Mapping[str, float]) -> list[str]:
        """Return in words the margins that are less than the aim."""
        return [
            f"{margins[name]:.2g} {words}"
            for name, (sign, words) in MARGIN_WORDS.items()
            if name in margins and sign * margins[name] < sign * getattr(self, name)
        ]

    def keeping(self, spare: Mapping[str, float]) -> Aim:
        """Return the aim of a best estimate of which a worst case may take so much."""
        return Aim(
            gain_db=self.gain_db + spare["gain_db"],
            phase_deg=self.phase_deg + spare["phase_deg"],
            peak_db=self.peak_db - spare["peak_db"],
        )

    @property
    def words(self) -> str:
        """Return the margins in words."""
        return f"{self.gain_db:g} dB, {self.phase_deg:g} deg and a peak of {self.peak_db:g} dB"


#: Aims by name: most rejection, quiet actuators, wide margins.
AIMS: Mapping[str, Aim] = {
    "rejection": Aim(),
    "quiet": Aim(noise=1.0),
    "margins": Aim(gain_db=8.0, phase_deg=55.0, peak_db=5.0),
}

#: What a first step from gains that keep less must keep at the worst: a craft flies well with it, and is then measured.
LEAST = Aim(gain_db=4.5, phase_deg=35.0, peak_db=8.0)


def worst_case(loop: RateLoop) -> dict[str, float] | None:
    """Return the bound of each margin that the 95 % set keeps; None where a draw is unstable.

    A gain margin that the band does not show is bounded by the gain at the band's end.
    """
    broken = loop.draws
    draws = margins_of(loop.hz, broken)
    if not draws.stable.all():
        return None
    at_end = -20.0 * np.log10(np.abs(broken[:, -1]))
    gain = np.where(np.isfinite(draws.gain_db), draws.gain_db, at_end)
    phase = np.where(np.isfinite(draws.phase_deg), draws.phase_deg, 0.0)
    rejection = np.where(np.isfinite(draws.rejection_hz), draws.rejection_hz, loop.hz[0])
    return {
        "gain_db": _least(gain),
        "phase_deg": _least(phase),
        "peak_db": -_least(-draws.peak_db),
        "rejection_hz": _least(rejection),
    }


def _least(drawn: Floats) -> float:
    """Return the bound above which a margin stays: two hundred draws alone do not know their own tail well."""
    return float(min(np.quantile(drawn, TAIL), np.mean(drawn) - DEVIATIONS * np.std(drawn)))


class ActuatorNoise:
    """The noise of the gyro at the actuators: by which factor settings raise it over those flown.

    The largest of rms and slew of what white noise makes there, from 2 Hz to half the loop rate, and of the
    controller's gain at any frequency beyond the measured band: noise of motors is not white, and lies there.
    """

    def __init__(self, loop: RateLoop) -> None:
        self._hz = np.linspace(2.0, 0.499 * loop.flown.controller.loop_rate, 400)
        self._inside, self._seen = self._hz <= loop.hz[-1], self._hz <= loop.plant.seen
        self._flown = self._to_mixer(loop.with_settings(loop.flown))

    def factor(self, loop: RateLoop) -> float:
        """Return the factor of a loop's settings."""
        raised = self._to_mixer(loop) / self._flown
        power = self._flown**2
        rms, slew = (np.sqrt((raised**2 * values).sum() / values.sum()) for values in (power, power * self._hz**2))
        return float(max(rms, slew, *raised[~self._seen]))

    def _to_mixer(self, loop: RateLoop) -> Floats:
        """Compute the gain from the gyro's noise to the mixer; where the craft is not known the loop is open."""
        settings, inside = loop.settings, self._inside
        gain = np.abs(settings.controller.error_response(self._hz) * settings.gyro.response(self._hz))
        broken = loop.response
        gain[inside] /= np.abs(1.0 + np.interp(self._hz[inside], loop.hz, broken))
        return np.asarray(gain, np.float64)


def others_keep(staying: Iterable[RateLoop], factor: float) -> bool:
    """Return whether axes whose gains stay keep their margins with another gyro filter."""
    for loop in staying:
        other = loop.with_gains(gyro_filter=other_gyro_filter(loop, factor))
        flown, new = loop.best_margins, other.best_margins
        if not new["stable"] or new["phase_deg"] < flown["phase_deg"] - _BYSTANDER_PHASE:
            return False
        if new["gain_db"] < flown["gain_db"] - _BYSTANDER_GAIN:
            return False
        if raised_unseen(loop, other.settings, [{}])[0][0] > may_raise(loop)[0]:
            return False
    return True


def other_gyro_filter(loop: RateLoop, factor: float) -> float:
    """Return INS_GYRO_FILTER raised by a factor, Hz: whole numbers, and as flown where it stays."""
    flown = loop.flown.gyro.low_pass
    return flown if factor == 1.0 else float(round(flown * factor))


def is_calm(logs: Sequence[FlightLog]) -> bool:
    """Return whether horizontal vibration is known to be low, so that the gyro's filter may be opened."""
    for log in logs:
        frame = log.messages.get("VIBE")
        if frame is None or not {"VibeX", "VibeY"} <= set(frame.columns):
            return False
        if not frame[["VibeX", "VibeY"]].median().max(skipna=False) < _CALM:
            return False
    return True
