"""A tuning as tuning.json holds it: numbers and text, and of the responses what a page computes with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from core.serialization import cleaned
from sysid.loops.criteria import Criterion
from sysid.loops.filters import cascade
from sysid.loops.known_margins import Margins
from sysid.loops.loop import RateLoop
from sysid.loops.safety import Aim
from sysid.loops.search import AxisTuning
from sysid.loops.tuning import Tuning

#: A value for each frequency.
Numbers = tuple[float | None, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class CraftResponse:
    """The craft's response without notches, the notches as flown, and draws of the response's error."""

    hz: Numbers
    real: Numbers
    imag: Numbers
    notch_real: Numbers
    notch_imag: Numbers
    coherence: Numbers
    #: Of ln gain, and of phase [rad]; a row for each draw.
    draws_gain: tuple[Numbers, ...]
    draws_phase: tuple[Numbers, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class FlownLoop:
    """A loop: settings, margins and the craft's response."""

    axis: str
    logs: str
    parameters: Mapping[str, float]
    loop_rate_hz: float
    gyro_rate_hz: float
    margins: Margins
    attitude_bandwidth_hz: float | None
    response: CraftResponse


@dataclass(frozen=True, slots=True, kw_only=True)
class TunedLoop:
    """Proposed parameters of an axis, and its margins with them."""

    parameters: Mapping[str, float]
    margins: Margins


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisReport:
    """One axis of a tuning, see `sysid.loops.search.AxisTuning`."""

    axis: str
    refused: str | None
    flown: FlownLoop | None
    measured_margins: Margins | None
    tuned: TunedLoop | None
    worst_of_95: Mapping[str, float | None]
    #: One sheet of criteria, as flown and as proposed: value, limit, source of the limit; `kept` tells pass or fail.
    criteria: tuple[Criterion, ...]
    promises: tuple[Criterion, ...]
    actuator_noise_factor: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class TuningReport:
    """What tuning.json holds, see `sysid.loops.tuning.Tuning`."""

    kind: Literal["tuning"] = "tuning"
    logs: tuple[str, ...]
    made: str
    aim: Aim
    refused: str | None
    proposed: Mapping[str, float]
    rollback: Mapping[str, float]
    flown: Mapping[str, float]
    remarks: tuple[str, ...]
    axes: tuple[AxisReport, ...]


def tuning_report(tuning: Tuning) -> TuningReport:
    """Return a tuning as tuning.json holds it."""
    report = TuningReport(
        logs=tuning.logs,
        made=tuning.made,
        aim=tuning.aim,
        refused=tuning.refused,
        proposed=tuning.proposed,
        rollback=tuning.rollback,
        flown=tuning.flown,
        remarks=tuning.remarks,
        axes=tuple(map(_axis, tuning.axes)),
    )
    return cleaned(report, TuningReport)


def _axis(axis: AxisTuning) -> AxisReport:
    flown, tuned = axis.loop, axis.tuned
    measured = flown is not None and flown.measured is not None
    return AxisReport(
        axis=axis.axis,
        refused=axis.refused,
        flown=None if flown is None else _loop(flown),
        measured_margins=flown.measured_margins if flown is not None and measured else None,
        tuned=None if tuned is None else TunedLoop(parameters=tuned.settings.parameters(), margins=tuned.margins),
        worst_of_95=axis.worst,
        criteria=axis.criteria,
        promises=axis.promises,
        actuator_noise_factor=axis.noise,
    )


def _loop(loop: RateLoop) -> FlownLoop:
    # A page gets 180 frequencies and 40 draws of the response.
    rows = np.unique(np.linspace(0, len(loop.hz) - 1, 180).round().astype(int))
    draws = loop.plant.draws[1:41, rows] / loop.plant.response[rows]
    notches = cascade(loop.flown.gyro.notches, loop.hz[rows])
    plant = loop.plant.response[rows] / loop.flown.gyro.response(loop.hz[rows]) * notches
    controller = loop.settings.controller
    return FlownLoop(
        axis=loop.axis,
        logs=loop.name,
        parameters=loop.settings.parameters(),
        loop_rate_hz=controller.loop_rate,
        gyro_rate_hz=loop.settings.gyro.rate,
        margins=loop.margins,
        attitude_bandwidth_hz=loop.attitude_bandwidth,
        response=CraftResponse(
            hz=tuple(loop.hz[rows].tolist()),
            real=tuple(plant.real.tolist()),
            imag=tuple(plant.imag.tolist()),
            notch_real=tuple(notches.real.tolist()),
            notch_imag=tuple(notches.imag.tolist()),
            coherence=tuple(loop.plant.coherence[rows].tolist()),
            draws_gain=tuple(tuple(row) for row in np.log(np.abs(draws)).tolist()),
            draws_phase=tuple(tuple(row) for row in np.angle(draws).tolist()),
        ),
    )
