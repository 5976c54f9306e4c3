"""`rate_loop`: an axis' loop as flown, its margins with error bars, and the same with other gains."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from core.parameter import Parameter
from core.summary import Summarised
from logparse import GivenLogs, logs_of
from sysid.frequency.excitation import Within
from sysid.frequency.response import FrequencyResponse
from sysid.loops.beyond import followed
from sysid.loops.controller import LoopError, LoopSettings
from sysid.loops.filters import Complexes, Floats, low_pass_alpha
from sysid.loops.known_margins import MARGINS, Margins
from sysid.loops.margins import margins_of
from sysid.loops.plant import Plant, plant_of
from sysid.loops.settings import shared_settings
from sysid.loops.signals import LoopRecord, loop_records, loop_response, mixer_chirps, plant_response

#: Slope of ln |L| over ln f below which a crossover is said to be in a level part, and the factor of frequency to both
#: sides over which it is taken.
_LEVEL, _LEVEL_REACH = 0.7, 1.1


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


def rate_loop(log: GivenLogs, axis: str, within: Within | None = None) -> RateLoop:
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
    logs = logs_of(log)
    if not logs:
        raise LoopError("no log was given")
    logs = [one for one in logs if mixer_chirps(one, axis)] or logs
    settings = shared_settings(logs, axis)
    records = tuple(record for one in logs for record in loop_records(one, axis, within))
    return loop_of_records(", ".join(one.path.name for one in logs), records, settings)


def loop_of_records(name: str, records: tuple[LoopRecord, ...], settings: LoopSettings) -> RateLoop:
    """Identify a loop from records that are already cut."""
    frf = plant_response(records, settings.axis, settings.gyro.low_pass or None)
    return RateLoop(
        name=name,
        frf=frf,
        plant=followed(plant_of(frf), frf, settings.gyro),
        flown=settings,
        settings=settings,
        measured=loop_response(records, settings.axis),
        records=records,
    )


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
