"""An axis' loop as flown, its margins with error bars, and the same with other gains.

`rate_loop` identifies it from chirps; `ordinary_loop` closes it around the craft's model that flights without chirps
tell, through the controller of the log's parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import pandas as pd

from core.parameter import Parameter
from core.summary import Summarised
from logparse import FlightLog
from sysid.frequency.axes import MIXER_CHIRPS, axis_of
from sysid.frequency.estimate import response, response_of_records
from sysid.frequency.excitation import Chirp, Within, mixer_chirps
from sysid.frequency.fit import fit
from sysid.frequency.fitted import FrequencyFit
from sysid.frequency.flight_records import chirp_record, record_of_chirp
from sysid.frequency.rate_signals import GivenSignals, LogSignals, RateSignals, sources_of
from sysid.frequency.records import AxisRecord
from sysid.frequency.response import FrequencyResponse, lagging
from sysid.loops.controller import LoopError, LoopSettings
from sysid.loops.filters import Complexes, Floats, low_pass_alpha
from sysid.loops.known_margins import MARGINS, Margins
from sysid.loops.margins import margins_of
from sysid.loops.plant import FARTHEST, Plant, followed, plant_of, plant_of_model
from sysid.loops.settings import shared_settings

#: Frequency [Hz] up to which the coherent band must reach.
_COHERENT_TO = 3.0

#: Time between rows [s] beyond which the loop's own frequencies fold.
_LONGEST_STEP = 0.045

#: Standard deviation of the phase margin [deg] and of ln crossover beyond which the margins are of no use.
_PHASE_KNOWN, _CROSSOVER_KNOWN = 12.0, 0.2

#: Slope of ln |L| over ln f below which a crossover is said to be in a level part, and the factor of frequency to both
#: sides over which it is taken.
_LEVEL, _LEVEL_REACH = 0.7, 1.1

#: Times [s] by which the logged chirp may trail its entry into the mixer; one step of loops of 50 to 400 Hz at most.
_LAGS = np.arange(-8, 9) * 1.25e-3

#: Times closer than this [s] are one.
_SAME = 2e-4


@dataclass(frozen=True, slots=True, eq=False)
class LoopRecord:
    """One chirp at the mixer, on a uniform clock."""

    plant: AxisRecord  #: Mixer input, with the chirp, to measured rate.
    #: Mixer input to what the controller fed back; None where the log cannot part it from the chirp.
    feedback: AxisRecord | None


@dataclass(frozen=True, eq=False, repr=False)
class RateLoop(Summarised):
    """One axis' rate and angle loop around an identified craft."""

    name: str  #: The log or logs.
    frf: FrequencyResponse  #: Mixer input to measured rate, as identified.
    plant: Plant  #: The same smoothed, with draws of its error, through the gyro filters as flown.
    #: The autopilot's settings in that flight, and those that this loop is computed with.
    flown: LoopSettings
    settings: LoopSettings
    measured: FrequencyResponse | None  #: Broken-loop response straight from the chirp, of the flown settings.
    records: tuple[LoopRecord, ...] = field(default=())

    @property
    def axis(self) -> str:
        """Return the axis' name."""
        return self.settings.axis

    @property
    def ordinary(self) -> bool:
        """Return whether it is of flights without a chirp at the mixer: of a model, nothing of it measured directly."""
        return not self.records

    @property
    def hz(self) -> Floats:
        """Return the frequencies of the responses, Hz."""
        return self.plant.hz

    @property
    def gyro_change(self) -> Complexes:
        """Return the gyro filters' response over that of the flown ones."""
        return np.asarray(self.settings.gyro.response(self.hz) / self.flown.gyro.response(self.hz))

    @property
    def response(self) -> Complexes:
        """Return the broken-loop response at the mixer, shape (n,)."""
        return np.asarray(self.plant.response * self.gyro_change * self.settings.feedback(self.hz))

    @property
    def draws(self) -> Complexes:
        """Return broken-loop responses that the data leave possible, shape (DRAWS, n)."""
        return np.asarray(self.plant.draws * self.gyro_change * self.settings.feedback(self.hz))

    @property
    def own_draws(self) -> Complexes:
        """Return the same of the flight itself, without what the next one may differ by."""
        return np.asarray(self.plant.own_draws * self.gyro_change * self.settings.feedback(self.hz))

    @cached_property
    def margins(self) -> Margins:
        """Compute margins with errors from the identified response, as the next flight with these settings has them."""
        return summarise(self.hz, self.response, self.draws)

    @property
    def best_margins(self) -> dict[str, float]:
        """Return the margins of the best estimate alone by name; NaN where the band does not show one."""
        return margins_of(self.hz, self.response).row(0)

    @cached_property
    def own_margins(self) -> Margins:
        """Compute the margins of the flight itself: without what the next one may differ by."""
        return summarise(self.hz, self.response, self.own_draws)

    @cached_property
    def measured_margins(self) -> Margins:
        """Compute margins straight from the chirp: the second way, for the settings as flown.

        LoopError where the log does not part feedback from chirp.
        """
        if self.measured is None:
            raise LoopError(
                f"{self.name}: without PID messages the chirp cannot be parted from the controller's output"
            )
        direct = plant_of(self.measured, self._sampling_error)
        return summarise(direct.hz, direct.response, direct.own_draws)

    def rate_transfer(self, craft: Complexes | None = None) -> Complexes:
        """Compute measured rate per rate target with the rate loop closed and the angle loop open.

        `craft` (K, n): other responses of the craft through the flown filters, as those that the data leave possible.
        """
        plant = (self.plant.response if craft is None else craft) * self.gyro_change
        controller = self.settings.controller
        forward = plant * controller.target_response(self.hz)
        return np.asarray(forward / (1.0 + plant * controller.error_response(self.hz)))

    def attitude_loop(self, craft: Complexes | None = None) -> Complexes:
        """Compute the loop broken at the attitude, with the rate loop closed; `craft` as in `rate_transfer`."""
        angle = self.settings.angle
        turned = self.rate_transfer(craft) / self.settings.gyro.response(self.hz) / (2j * np.pi * self.hz)
        return np.asarray(turned * angle.P * angle.delay_response(self.hz))

    @property
    def attitude_bandwidth(self) -> float:
        """Return the frequency, Hz, at which the attitude lags its target by 135 deg; NaN beyond the band."""
        broken = self.attitude_loop()[None]
        return float(lagging(self.hz, broken / (1.0 + broken), -0.75 * np.pi)[0][0])

    def _sampling_error(self, hz: Floats) -> Floats:
        """Return the standard deviation of ln L where the terms of the PID are logged less often than the loop runs.

        A gyro of 1 kHz gives 2 and 3 samples in turn to loops of 400 Hz, and the derivative of a loop differs as much.
        The filter FLTD leaves of that what it lets through at half of the loop rate; every fourth row shows always the
        same side of it (measured in firmware: 3 % at 10 Hz, 5 % at 30 Hz). The loop itself takes the mean.
        """
        controller, gyro = self.flown.controller, self.flown.gyro
        assert self.measured is not None
        if self.measured.step < 1.5 / controller.loop_rate:
            return np.zeros(len(hz))
        alpha = low_pass_alpha(controller.loop_rate, controller.FLTD)
        uneven = 0.5 * controller.loop_rate / gyro.rate * alpha / (2.0 - alpha)
        derivative = 2.0 * controller.loop_rate * np.sin(np.pi * hz / controller.loop_rate)
        return np.asarray(uneven * controller.D * derivative / np.abs(self.flown.feedback(hz)))

    def with_gains(self, **values: float) -> RateLoop:
        """Return the loop with other gains or filters: P, I, D, FF, D_FF, FLTT, FLTE, FLTD, angle_P, gyro_filter.

        Raises
        ------
        LoopError
            For an unknown name or a value that is negative or not finite.
        """
        return replace(self, settings=self.settings.changed(**values))

    def with_settings(self, settings: LoopSettings) -> RateLoop:
        """Return the loop with the settings of another flight."""
        return replace(self, settings=settings)

    def summary(self) -> dict[str, str]:
        """Return the axis, its gains and band, and its margins."""
        c = self.settings.controller
        return {
            "axis": f"{self.axis} of {self.name}, {self.hz[0]:.2g} to {self.hz[-1]:.3g} Hz",
            "gains": f"P {c.P:.4g}, I {c.I:.4g}, D {c.D:.4g}",
            **self.margins.summary(),
        }


def rate_loop(log: GivenSignals, axis: str, within: Within | None = None) -> RateLoop:
    """Identify an axis' loop from the chirps of one or several flights with the same settings.

    Flights without a chirp on this axis, of which others are given, do not count: the published procedure flies one
    axis in each.

    Parameters
    ----------
    log : FlightLog, path-like, or a sequence of either
    axis : {"roll", "pitch", "yaw"}
    within : tuple of float, optional
        From when to when chirps of a log count, s on its boot clock; default all of it.

    Raises
    ------
    LoopError
        For firmware or settings that are unknown, or flights that differ in them, or without chirps at the mixer.
    FrequencyError
        Where the signals are missing or too short.
    """
    flights = sources_of(log, within)
    if not flights:
        raise LoopError("no log was given")
    flights = [flight for flight in flights if mixer_chirps(flight.log, axis)] or flights
    settings = shared_settings([flight.log for flight in flights], axis)
    records = tuple(record for flight in flights for record in _records(flight, axis))
    return loop_of_records(", ".join(flight.log.path.name for flight in flights), records, settings)


def loop_of_records(name: str, records: tuple[LoopRecord, ...], settings: LoopSettings) -> RateLoop:
    """Identify a loop from records that are already cut."""
    axis = axis_of(settings.axis)
    frf = response_of_records([r.plant for r in records], axis, gyro_filter_hz=settings.gyro.low_pass or None)
    # Straight from the chirps: minus feedback per mixer input.
    back = [replace(r.feedback, output=-r.feedback.output) for r in records if r.feedback is not None]
    return RateLoop(
        name=name,
        frf=frf,
        plant=followed(plant_of(frf), frf, settings.gyro),
        flown=settings,
        settings=settings,
        measured=response_of_records(back, axis) if back else None,
        records=records,
    )


def ordinary_loop(name: str, frf: FrequencyResponse, model: FrequencyFit, settings: LoopSettings) -> RateLoop:
    """Close the loop around a craft's model that was fitted to ordinary flying.

    Parameters
    ----------
    name : str
        Of the log or logs.
    frf : FrequencyResponse
        From controller output to rate, through the gyro's filters.
    found : FrequencyFit
        To it, of one axis.
    settings : LoopSettings
        As flown.

    Raises
    ------
    LoopError
        Where the model is not known well enough, or says that what flew cannot fly.
    """
    if frf.method == "direct":
        raise LoopError(
            f"{settings.axis}: without the attitude target there is no instrument, and plain regression of a closed "
            "loop takes its controller for the craft; log ATT or ANG"
        )
    if frf.step > _LONGEST_STEP:
        raise LoopError(
            f"{settings.axis}: the rate loop is logged at {1.0 / frf.step:.0f} Hz, which folds what is near its "
            "crossover; log it at 25 Hz or more, and fly a chirp of mode SYSTEMID"
        )
    gain = model.parameters["gain"]
    if gain.value is None:
        raise LoopError(f"{settings.axis}: the craft's gain is not determined: {gain.reason}")
    if gain.value <= 0.0:
        raise LoopError(f"{settings.axis}: the rate answers against the controller's output: the signals are no loop's")
    top = float(frf.hz[frf.usable][-1])
    if top < _COHERENT_TO:
        raise LoopError(
            f"{settings.axis}: this flight tells of the craft up to {top:.1f} Hz only; fly a minute of short, sharp "
            "stick inputs, or a chirp of mode SYSTEMID"
        )
    plant = plant_of_model(model, frf, settings.gyro)
    loop = RateLoop(name, frf, plant, settings, settings, None)
    _useful(loop, top)
    return loop


def loop_of_flights(flights: Sequence[LogSignals], axis: str) -> RateLoop:
    """Identify an axis' loop from what sticks, AutoTune or chirps on targets (SID_AXIS 1 to 9) showed of the craft.

    LoopError, FrequencyError where that is too little, or the flights differ in their settings.
    """
    logs = [flight.log for flight in flights]
    settings = shared_settings(logs, axis)
    frf = response(flights, axis)
    return ordinary_loop(", ".join(log.path.name for log in logs), frf, fit(frf), settings)


def _useful(loop: RateLoop, top: float) -> None:
    """Refuse margins that mean nothing."""
    margins = loop.margins
    axis = loop.axis
    if not margins.stable:
        raise LoopError(
            f"{axis}: by the model of this flight, known up to {top:.1f} Hz, the loop that flew is unstable: it does "
            "not reach to the crossover; fly a chirp of mode SYSTEMID"
        )
    crossover, phase = margins.crossover_hz, margins.phase_deg
    if crossover.value is None or phase.value is None:
        raise LoopError(
            f"{axis}: the crossover lies beyond {FARTHEST * top:.0f} Hz, and this flight tells of the craft up to "
            f"{top:.1f} Hz; fly a chirp of mode SYSTEMID"
        )
    assert crossover.sigma is not None
    assert phase.sigma is not None
    if phase.sigma > _PHASE_KNOWN or crossover.sigma > _CROSSOVER_KNOWN * crossover.value:
        raise LoopError(
            f"{axis}: the margins are too uncertain to be of use (phase margin {phase.value:.0f} +- {phase.sigma:.0f} "
            f"deg): this flight tells of the craft up to {top:.1f} Hz, and the crossover is at {crossover.value:.1f} "
            "Hz; fly a chirp of mode SYSTEMID"
        )


def _records(flight: LogSignals, axis: str) -> tuple[LoopRecord, ...]:
    """Cut the chirps at the mixer on one axis, in order."""
    which, log = axis_of(axis), flight.log
    signals = flight.as_logged(which)
    chirps = mixer_chirps(log, axis, flight.within)
    if not chirps:
        raise LoopError(
            f"{log.path.name} has no chirp at the mixer on the {axis} axis; fly mode SYSTEMID with SID_AXIS "
            f"{MIXER_CHIRPS[axis]} (`rotorid design` writes the parameters), with RATE and PID messages at 100 Hz or "
            "more"
        )
    return tuple(
        LoopRecord(chirp_record(log, signals, which, chirp), _feedback(log, signals, axis, chirp)) for chirp in chirps
    )


def _feedback(log: FlightLog, signals: RateSignals, axis: str, chirp: Chirp) -> AxisRecord | None:
    """Part the mixer input into the chirp and what the controller added.

    The sum of the PID terms is what came back; where it is logged as often as the mixer input it is taken, else it
    tells when the chirp entered, which is then subtracted.
    """
    added, pid = chirp.spline(), pid_rows(log, axis, ("P", "I", "D"))
    first, last = chirp.start, chirp.stop
    chirp = chirp.below_folding(signals.t)
    rows = signals.within(chirp.start, chirp.stop)
    t, total = signals.t[rows], signals.columns[axis_of(axis).input][rows]
    if added is None or pid is None or len(t) < 16 or not signals.with_chirp:
        return None
    sums = pid[[name for name in ("P", "I", "D", "FF", "DFF") if name in pid]].to_numpy(np.float64).sum(axis=1)
    at, sums = (column[np.isfinite(sums)] for column in (pid.index.to_numpy(np.float64), sums))
    nearest = np.clip(np.searchsorted(at, t - _SAME), 0, max(len(at) - 1, 0))
    same = np.abs(at[nearest] - t) < _SAME if len(at) else np.zeros(len(t), bool)
    if same.sum() < 16:
        return None
    chirped = total[same] - sums[nearest[same]]
    inner = np.flatnonzero((t[same] > first + 0.02) & (t[same] < last - 0.02))
    inner = inner[:: max(len(inner) // 2000, 1)]  # as many tell it
    misfits = [float(np.sum((chirped[inner] - added(t[same][inner] + lag)) ** 2)) for lag in _LAGS]
    lag = float(_LAGS[int(np.argmin(misfits))])
    if min(misfits) > 0.05 * float(np.sum(chirped[inner] ** 2)):
        return None
    if same.mean() > 0.9:
        back = np.full(len(t), np.nan)
        back[same] = sums[nearest[same]]
    else:
        back = total - np.where((t + lag >= first) & (t + lag <= last), added(t + lag), 0.0)
    return record_of_chirp(log, chirp, t, [total], back, lambda at: added(at)[:, None])


def pid_rows(log: FlightLog, axis: str, needed: Sequence[str]) -> pd.DataFrame | None:
    """Return what the rate controller says of its terms, in the order of time; None where that is not logged."""
    message = f"PID{axis_of(axis).letter}"
    frame = log.messages.get(message)
    if frame is None or len(frame) < 16 or not set(needed) <= set(frame.columns):
        return None
    return frame[frame.index.notna()].sort_index(kind="stable")


def summarise(hz: Floats, response: Complexes, draws: Complexes) -> Margins:
    """Compute the margins of a broken-loop response, shape (n,), with errors from draws of it, shape (DRAWS, n).

    `hz` (n,): frequencies, Hz; `response` (n,): the loop, broken; `draws` (DRAWS, n): what it may be within its errors.
    """
    best, drawn_set = margins_of(hz, response), margins_of(hz, draws)
    estimates, intervals = {}, {}
    for name, (unit, reason) in MARGINS.items():
        value = float(getattr(best, name)[0])
        drawn = getattr(drawn_set, name)
        drawn = drawn[np.isfinite(drawn)]
        if not np.isfinite(value) or len(drawn) < 0.5 * len(draws):
            estimates[name] = Parameter(None, None, unit, reason)
            continue
        low, high = (float(q) for q in np.quantile(drawn, [0.025, 0.975]))
        intervals[name] = (min(low, value), max(high, value))
        limit = _level(hz, response, value) if name == "crossover_hz" else ""
        estimates[name] = Parameter(value, float(0.5 * (high - low) / 1.96), unit, limit)
    return Margins(
        **estimates,
        intervals=intervals,
        stable=bool(best.stable[0]),
        unstable=float(np.mean(~drawn_set.stable)),
    )


def _level(hz: Floats, response: Complexes, crossover: float) -> str:
    """Return in words that the gain is nearly level at the crossover, which then lies in a wide place; else nothing."""
    ends = crossover * np.array([1.0 / _LEVEL_REACH, _LEVEL_REACH])
    gain = np.interp(np.log(ends), np.log(hz), np.log(np.abs(response)))
    slope = abs(float(gain[1] - gain[0])) / (2.0 * np.log(_LEVEL_REACH))
    if slope >= _LEVEL:
        return ""
    return f"the loop gain is nearly level here: 1 % of gain moves the crossover by {1.0 / max(slope, 0.05):.1f} %"
